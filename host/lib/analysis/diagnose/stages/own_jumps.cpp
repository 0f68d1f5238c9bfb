// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/own_jumps.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/stages/seconds.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kLeast_nats = 12; // that a jump gains over none: 1 in 100 over the places of a few logs of white noise
constexpr double kSudden_nats = 5; // and over a change that lasts
constexpr double kLasts_s[] = {200, 600};
constexpr size_t kPlaces = 40;       // of a log where one is looked for
constexpr size_t kMostJumps = 2;     // of one log
constexpr double kReachBlocks = 1.5; // from its place in block means to its sample
constexpr long kFromEnd = 3;         // rows: a jump nearer to the end of a log is one of a few rows

// What is left of a run, and what a change of level in it would be, both less what a constant takes.
class LevelOfRun {
public:
  LevelOfRun(const CampaignRun& run, double dt_s, const NoiseModel& noise, const VectorXd& rest)
      : run_(run), dt_s_(dt_s), gains_(compute_gains(run, noise)), constant_(white(VectorXd::Ones(rest.size()))),
        rest_(less_constant(white(rest))) {}

  struct Change {
    double gain_nats = 0, size_dph = 0, error_dph = 0;
  };
  // Of a change over lasts_s (0: within a row) about t_s.
  Change change_at(double t_s, double lasts_s) const {
    const VectorXd column = changed(t_s, lasts_s);
    const double square = column.squaredNorm(), product = column.dot(rest_);
    if (!(square > 0)) return {};
    return {0.5 * product * product / square, product / square, 1 / std::sqrt(square)};
  }
  void take(double t_s, const Change& change) { rest_ -= change.size_dph * changed(t_s, 0); }
  // Where innovations are largest: a jump shows there.
  std::vector<long> likely_rows() const {
    std::vector<long> rows;
    for (long k = kFromEnd; k + kFromEnd <= rest_.size(); ++k) rows.push_back(k);
    const auto is_larger = [this](long a, long b) { return std::fabs(rest_[a]) > std::fabs(rest_[b]); };
    const size_t n = std::min(kPlaces, rows.size());
    std::partial_sort(rows.begin(), rows.begin() + static_cast<long>(n), rows.end(), is_larger);
    rows.resize(n);
    return rows;
  }
  double t_s(long k) const { return run_.input.t_s[static_cast<size_t>(run_.used[static_cast<size_t>(k)])]; }
  double dt_s() const { return dt_s_; }

private:
  VectorXd changed(double t_s, double lasts_s) const {
    return less_constant(white(share_after(run_, t_s, std::max(dt_s_, lasts_s))));
  }
  VectorXd white(VectorXd x) const {
    whiten(gains_, x.data(), static_cast<size_t>(x.size()));
    return x;
  }
  VectorXd less_constant(const VectorXd& x) const {
    return x - constant_ * (constant_.dot(x) / constant_.squaredNorm());
  }

  const CampaignRun& run_;
  double dt_s_;
  RunGains gains_;
  VectorXd constant_, rest_;
};

// The jumps of one run, one after the other; more than a few: none.
std::vector<OwnJump> jumps_of(LevelOfRun run) {
  std::vector<OwnJump> out;
  while (true) {
    double t_s = 0;
    LevelOfRun::Change best;
    for (long k : run.likely_rows()) {
      const double at_s = run.t_s(k) - 0.5 * run.dt_s();
      const LevelOfRun::Change change = run.change_at(at_s, 0);
      if (change.gain_nats > best.gain_nats) best = change, t_s = at_s;
    }
    if (best.gain_nats < kLeast_nats) return out;
    for (const double lasts_s : kLasts_s)
      if (run.change_at(t_s, lasts_s).gain_nats > best.gain_nats - kSudden_nats) return out;
    if (out.size() == kMostJumps) return {};
    out.push_back({t_s, best.size_dph, best.error_dph});
    run.take(t_s, best);
  }
}

// Something in a hypothesis jumps.
bool jumps(const SlowAnswer& slow, const SlowModel& m) {
  const auto can_jump = [&](const SlowModel::Name& name) {
    return slow.candidate(name.candidate).scan.estimator->can_jump();
  };
  return !m.steps.empty() || std::any_of(m.names.begin(), m.names.end(), can_jump) ||
         (m.noise_effect && m.noise_effect->estimator()->is_jumping());
}

} // namespace

void find_own_jumps(const AxisQuestion& question, SlowAnswer* slow) {
  for (CampaignRun& run : slow->held_blocks->runs) run.own_jumps.clear();
  const bool can_be_named = question.first_kind([](const auto& e) { return e.form() == Form::kSteps; }) != nullptr;
  const SlowModel& best = slow->found.best;
  if (!can_be_named || jumps(*slow, best)) return;
  if (slow->found.without_steps && jumps(*slow, slow->found.without_steps->best)) return;
  const SlowData all = with_held_out(*slow->data, *slow->held_blocks);
  const std::vector<MeanPart> parts = slow->search->parts_on(all, best);
  const NoiseModel noise = slow->search->noise_of(best);
  std::vector<char> is_fitted(all.campaign.runs.size(), 1);
  const size_t n_fitted = slow->data->campaign.runs.size();
  std::fill(is_fitted.begin() + static_cast<long>(n_fitted), is_fitted.end(), 0);
  const RunGrams::Posterior at = RunGrams(all, pointers_of(parts), noise).posterior(is_fitted);
  for (size_t r = n_fitted; r < all.campaign.runs.size(); ++r)
    slow->held_blocks->runs[r - n_fitted].own_jumps =
        jumps_of({all.campaign.runs[r], all.campaign.dt_s, noise, residual_of(all, parts, at, r)});
}

void place_own_jumps(const Campaign& blocks, const Hypothesis& found, Campaign* seconds) {
  bool has_any = false;
  for (size_t r = 0; r < seconds->runs.size(); ++r) {
    seconds->runs[r].own_jumps = blocks.runs[r].own_jumps;
    has_any = has_any || !blocks.runs[r].own_jumps.empty();
  }
  if (!has_any) return;
  const Fit fit = fit_hypothesis(*seconds, found);
  const long reach = std::lround(kReachBlocks * blocks.dt_s / seconds->dt_s);
  for (size_t r = 0; r < seconds->runs.size(); ++r) {
    CampaignRun& run = seconds->runs[r];
    const auto t_s = [&](long k) { return run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(k)])]; };
    for (OwnJump& jump : run.own_jumps) {
      long at = 0;
      while (at + 1 < static_cast<long>(run.n()) && t_s(at) < jump.t_s) ++at;
      const long k = sample_of_jump(run, found.noise(), fit.residual[r], jump.size_dph, at, reach);
      jump.t_s = t_s(k) - 0.5 * seconds->dt_s;
    }
  }
}
void measure_own_jumps(const Fit& fit, Campaign* seconds) {
  size_t n = 0;
  for (const CampaignRun& run : seconds->runs) n += run.own_jumps.size();
  long at = fit.beta.size() - static_cast<long>(n); // their columns are the last ones
  for (CampaignRun& run : seconds->runs)
    for (OwnJump& jump : run.own_jumps) {
      jump.size_dph = fit.beta[at], jump.error_dph = std::sqrt(fit.beta_covariance(at, at));
      ++at;
    }
}

} // namespace imucal
