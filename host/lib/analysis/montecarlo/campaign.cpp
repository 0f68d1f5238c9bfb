// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/campaign.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <ctime>
#include <mutex>

#include "analysis/montecarlo/residual.h"
#include "base/clock.h"
#include "base/error.h"
#include "base/parallel.h"

namespace imucal {

// The residual's DP type 2 needs something to predict.
static bool has_markov(const ErrorModel& model) {
  return std::any_of(model.markov.begin(), model.markov.end(), [](const Markov& m) { return m.sigma_dph > 0; });
}

std::vector<long> residual_windows(const CampaignOptions& options) {
  std::vector<long> windows;
  if (options.residual_every == 0 || !has_markov(options.model)) return windows;
  const size_t duration_s = options.profile.temperatures(1.0).size();
  for (const long n : {1L, 2L, 5L, 10L, 20L, 50L, 100L, 200L, 400L, 600L})
    if (static_cast<size_t>(n) < duration_s / 4) windows.push_back(n);
  return windows;
}

static void plan_residual(CampaignPlan* plan) {
  if (!has_markov(plan->options.model)) plan->options.residual_every = 0;
  plan->dp_n = residual_windows(plan->options);
  if (plan->dp_n.empty()) return;
  ResidualExpectation expected = expect_residual(*plan);
  plan->residual_weight = std::move(expected.weight);
  plan->residual_model_dph = std::move(expected.model_dp_dph);
}

CampaignPlan plan_campaign(const CampaignOptions& options) {
  if (options.order < 1 || options.order > IMUCAL_MAX_ORDER)
    throw usage_error("--order must be from 1 to " + std::to_string(IMUCAL_MAX_ORDER));
  if (options.points < 2) throw usage_error("--points must be at least 2");
  CampaignPlan plan;
  plan.options = options;
  const double lo = options.profile.min_degc(), hi = options.profile.max_degc();
  if (!(hi - lo > 0.1))
    throw data_error("the profile does not move (" + std::to_string(lo) + " to " + std::to_string(hi) +
                     " degC): nothing can be learnt about temperature; add a ramp");
  plan.chain.filter = options.filter;
  plan.chain.order = options.order;
  plan.chain.raw = options.raw;
  plan.chain.is_tracked =
      !options.no_track && options.raw.temp_lsb_degc > static_cast<double>(IMUCAL_TRACK_COARSE_DEGC);
  plan.chain.prior_sigma_dph = options.prior_sigma_dph;
  plan.chain.t0_degc = 0.5 * (lo + hi);
  plan.chain.range_degc = 0.5 * (hi - lo);
  const auto& bias = options.model.bias;
  if (bias && lo >= bias->t0_degc - bias->range_degc && hi <= bias->t0_degc + bias->range_degc) {
    plan.chain.t0_degc = bias->t0_degc;
    plan.chain.range_degc = bias->range_degc;
  }
  plan.chain.span_lo_degc = lo;
  plan.chain.span_hi_degc = hi;
  plan.truth = bias.value_or(ThermalPolynomial{0, 1, {0.0}}).renormalised(plan.chain.t0_degc, plan.chain.range_degc);
  plan.chamber_degc = options.profile.temperatures(1.0);
  for (size_t k = 0; k < plan.chamber_degc.size(); ++k) plan.t_s.push_back(static_cast<double>(k + 1));
  plan.chain.white_from_s = plan.t_s.size() / 2;
  for (size_t i = 0; i < options.points; ++i)
    plan.temp_degc.push_back(lo + (hi - lo) * static_cast<double>(i) / static_cast<double>(options.points - 1));
  filter_config(plan.chain); // refuses what the filter cannot take, before the first run
  plan_residual(&plan);
  return plan;
}

namespace {

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

using BatchScore = std::function<void(const CampaignPlan&, uint64_t first_run, uint64_t n, Tally*)>;

// Shared by the threads of a campaign.
class Workers {
public:
  Workers(const CampaignPlan& plan, const BatchScore& score, uint64_t batch, const std::function<bool()>& stop)
      : plan_(plan), score_(score), batch_(batch), stop_(stop) {}

  void work() {
    Tally mine;
    for (;;) {
      if (stop_ && stop_()) stopped_ = true;
      if (stopped_) break;
      const uint64_t i = next_.fetch_add(batch_);
      if (i >= plan_.options.runs) break;
      const uint64_t n = std::min(batch_, plan_.options.runs - i);
      score_or_stop(i, n, &mine);
      done_ += n;
      if (++unmerged_ % 8 == 0) hand_over(&mine);
    }
    hand_over(&mine);
  }

  uint64_t done() const { return done_; }
  bool stopped() const { return stopped_; }
  void snapshot(CampaignResult* result) {
    const std::lock_guard<std::mutex> lock(mutex_);
    result->tally = tally_;
  }

private:
  // A batch that fails stops the others.
  void score_or_stop(uint64_t i, uint64_t n, Tally* mine) {
    try {
      score_(plan_, plan_.options.first_run + i, n, mine);
    } catch (...) {
      stopped_ = true;
      throw;
    }
  }
  void hand_over(Tally* mine) {
    const std::lock_guard<std::mutex> lock(mutex_);
    tally_.merge(*mine);
    *mine = Tally();
  }

  const CampaignPlan& plan_;
  const BatchScore& score_;
  const uint64_t batch_;
  const std::function<bool()>& stop_;
  // Every number taken is finished: after a stop, too, the runs done are the first ones without a hole.
  std::atomic<uint64_t> next_{0}, done_{0}, unmerged_{0};
  std::atomic<bool> stopped_{false};
  std::mutex mutex_;
  Tally tally_;
};

CampaignResult run_batches(const CampaignPlan& plan, const BatchScore& score, uint64_t batch,
                           const std::function<void(const CampaignResult&)>& progress,
                           const std::function<bool()>& stop) {
  CampaignResult result;
  result.first_run = plan.options.first_run;
  const double start_s = now_s(), cpu_start_s = cpu_seconds();
  Workers workers(plan, score, batch, stop);
  const auto watch = [&] {
    if (!progress) return;
    workers.snapshot(&result);
    result.runs_done = workers.done();
    progress(result);
  };
  const int threads = std::max(1, plan.options.threads);
  parallel_for(
      threads, threads, [&](long) { workers.work(); }, watch);
  workers.snapshot(&result);
  result.runs_done = workers.done();
  result.is_interrupted = workers.stopped() && result.runs_done < plan.options.runs;
  result.elapsed_s = now_s() - start_s;
  result.cpu_s = cpu_seconds() - cpu_start_s;
  return result;
}

} // namespace

CampaignResult run_campaign(const CampaignPlan& plan, const std::function<void(const CampaignResult&)>& progress,
                            const std::function<bool()>& stop) {
  // Few runs are shared among the threads first.
  const auto threads = static_cast<uint64_t>(std::max(1, plan.options.threads));
  const uint64_t batch = std::clamp<uint64_t>((plan.options.runs + threads - 1) / threads, 1, kBatch);
  return run_batches(plan, score_runs, batch, progress, stop);
}

CampaignResult run_campaign(const CampaignPlan& plan, const RunScore& score,
                            const std::function<void(const CampaignResult&)>& progress,
                            const std::function<bool()>& stop) {
  const auto one = [&score](const CampaignPlan& p, uint64_t run, uint64_t, Tally* tally) { score(p, run, tally); };
  return run_batches(plan, one, 1, progress, stop);
}

} // namespace imucal
