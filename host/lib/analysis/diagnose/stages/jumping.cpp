// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/jumping.h"

#include <algorithm>

#include "analysis/diagnose/stages/rest.h"
#include "analysis/diagnose/stages/slow_stage.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr int kJumpingRounds = 3; // of levels and of what is found without them
constexpr int kJumpingPasses = 2; // of the mean and of the noise beside noise that jumps, in turn
constexpr size_t kMany = 50000;   // samples from which one round and one pass have to do: each takes seconds there

// Noise that jumps, beside what a hypothesis of the slow stage puts into the mean.
struct Jumping {
  SlowModel mean;
  FastFinding noise;
  Fit fit;
  bool is_believed = false; // the noise beside it
  double log_likelihood = -1e300, retuned_nats = 0;
  double score = -1e300; // less what its names and its noise cost
};

class JumpingSearch {
public:
  JumpingSearch(const AxisQuestion& question, SlowAnswer* slow, SecondsAnswer* seconds, FastScan* fast)
      : question_(question), slow_(*slow), seconds_(*seconds), fast_(*fast) {}

  JumpingAnswer run() {
    const FastFinding* found = jumping_finding();
    if (!question_.jumping_kind() || !(fast_.changes_suddenly || (found && found->gain_nats > constants().fast_nats)))
      return out_;
    if (!found && !question_.belief.has_believed) return out_;
    out_.has_teeth = found && has_teeth(seconds_.fit.residual, *found);
    if (out_.has_teeth) return out_;
    const double gaussian = seconds_.noise.log_likelihood - charges(slow_.found.best, seconds_.is_believed);
    const double fast = fast_.findings.empty() ? 0 : fast_.findings.front().gain_nats - constants().fast_nats;
    Jumping alone = beside_mean(slow_.found.null, jumping_start(slow_.found.null));
    Jumping first = first_jumping(alone);
    SlowAnswer other;
    const Jumping with = ask_in_turn(first, &alone, &other);
    out_.has_teeth = has_teeth(with.fit.residual, with.noise);
    if (!out_.has_teeth && with.score > gaussian + std::max(0.0, fast) + foretold_by_lost(other))
      take_jumping(with, gaussian, other);
    else
      std::swap(slow_, other);
    return out_;
  }

private:
  const SelectorConstants& constants() const { return question_.constants; }
  // By the jumps in time that are found, or by what the levels leave.
  bool has_teeth(const std::vector<VectorXd>& residual, const FastFinding& noise) const {
    return slow_.search->has_teeth(slow_.found.best) || is_one_sided(question_.campaign, residual, with_jumps(noise));
  }
  bool is_long() const { return question_.campaign.n() > kMany; }

  // Levels follow a jump at a temperature as well as one by chance, but foretell nothing: what the names that would go
  // foretell of logs that were not fitted, as right names do, stands against them.
  double foretold_by_lost(const SlowAnswer& before) const {
    if (before.gap.method == HeldOut::kQuarters) return 0; // parts of one passage foretell nothing of another
    const std::vector<SlowModel::Name>& now = slow_.found.best.names;
    double sum = 0;
    for (size_t i = 0; i < before.found.best.names.size() && i < before.gap.foretold.at_all.size(); ++i) {
      const size_t j = before.found.best.names[i].candidate;
      const Support& all = before.gap.foretold.at_all[i];
      const bool is_kept = std::any_of(now.begin(), now.end(), [&](const auto& name) { return name.candidate == j; });
      if (!is_kept && all.nats > constants().foretold_part * all.expected) sum += std::max(0.0, all.nats);
    }
    return sum;
  }
  // Levels, and what is found without them, until nothing else is found.  Jumps in time are levels that are wrong, unless
  // the seconds are less likely without them.
  // `before`: where the answer goes that stood.
  Jumping ask_in_turn(Jumping first, Jumping* alone, SlowAnswer* before) {
    Jumping with;
    for (int round = 0; round < (is_long() ? 1 : kJumpingRounds); ++round) {
      Campaign quiet = question_.campaign, quiet_held;
      take_levels(first.noise, first.fit.residual, &quiet);
      if (question_.held_out) {
        quiet_held = *question_.held_out;
        take_levels(first.noise, fit_hypothesis(quiet_held, hypothesis_beside(first)).residual, &quiet_held);
      }
      if (round == 0) std::swap(slow_, *before);
      prepare_slow(question_, &quiet, question_.held_out ? &quiet_held : nullptr, &slow_);
      run_slow(question_, &slow_);
      const double before_score = with.score;
      with = last_jumping(first, *alone);
      if (with.score < before_score) return with; // this way it only gets worse
      SlowModel causes = slow_.found.best;
      if (is_bare(causes)) return with;
      if (causes.steps.empty() && have_same_names(causes, first.mean)) return with;
      if (causes.steps.empty() && !causes.noise_effect) {
        first = with;
        continue;
      }
      causes.steps.clear(), causes.noise_effect = nullptr;
      first = beside_mean(causes, with.noise, less_steps(with));
      if (!causes.names.empty()) continue;
      if (first.score > alone->score) *alone = first;
      if (first.score < with.score) continue;
      slow_.forget_causes();
      return first;
    }
    return with;
  }
  // What the mean would leave if it had no jumps in time.
  std::vector<VectorXd> less_steps(const Jumping& jumping) const {
    std::vector<VectorXd> residual = jumping.fit.residual;
    const Hypothesis h = hypothesis_beside(jumping);
    const Design design = make_design(question_.campaign, h);
    for (size_t t = 0; t < h.terms.size(); ++t) {
      if (h.terms[t].form() != Form::kSteps) continue;
      for (const long c : columns_of(design, t))
        for (size_t r = 0; r < residual.size(); ++r) residual[r] += jumping.fit.beta[c] * design.x[r].col(c);
    }
    return residual;
  }
  const FastFinding* jumping_finding() const {
    for (const FastFinding& f : fast_.findings)
      if (f.effect->estimator()->is_jumping()) return &f;
    return nullptr;
  }
  static bool is_bare(const SlowModel& m) { return m.names.empty() && m.steps.empty() && !m.noise_effect; }
  static NoiseModel with_jumps(const FastFinding& f) { return f.effect->estimator()->noise(f.base, f.theta); }
  // What the names of a hypothesis and other noise than the believed one cost.
  double charges(const SlowModel& m, bool is_believed) const {
    const bool is_retuned = question_.belief.has_believed && !is_believed;
    return m.value - slow_.search->score(m) + (is_retuned ? constants().retuned_nats : 0);
  }
  Hypothesis hypothesis_beside(const Jumping& jumping) const {
    SlowModel mean = jumping.mean;
    mean.noise_effect = nullptr;
    Hypothesis h = hypothesis_of(question_, *slow_.search, mean, true);
    h.base_noise = jumping.noise.base;
    h.terms.push_back(term_of(jumping.noise.effect, jumping.noise.effect->estimator(), jumping.noise.theta));
    return h;
  }
  // The mean and the noise in turn, from what they are; returns the log-likelihood.
  double improve(bool is_base_free, Jumping* jumping) const {
    const std::vector<VectorXd> near = jumping->fit.residual;
    jumping->fit = fit_hypothesis(question_.campaign, hypothesis_beside(*jumping), near.empty() ? nullptr : &near);
    return fit_again(ResidualLikelihood(question_.campaign, jumping->fit.residual), is_base_free, &jumping->noise);
  }
  // Beside this mean, from this start: beside the believed noise, and beside other parameters where these gain more than
  // they cost.  They also stand in for levels that are wrong: where they gain, the believed ones are tried with theirs.
  // `near`: a residual that may be like that of this mean.
  Jumping beside_mean(const SlowModel& mean, const FastFinding& start, const std::vector<VectorXd>& near = {}) const {
    const bool has_believed = question_.belief.has_believed;
    Jumping out;
    out.mean = mean, out.noise = start, out.fit.residual = near;
    if (has_believed) out.noise.base = believed_noise(*slow_.search, mean);
    const int passes = is_long() ? 1 : kJumpingPasses;
    for (int pass = 0; pass < passes; ++pass) out.log_likelihood = improve(!has_believed, &out);
    for (int pass = 0; has_believed && !out.is_believed && pass < passes; ++pass) {
      Jumping free = out;
      const double value = improve(true, &free);
      out.fit = free.fit, out.noise.theta = free.noise.theta;
      out.log_likelihood = improve(false, &out);
      out.retuned_nats = value - out.log_likelihood;
      out.is_believed = out.retuned_nats <= constants().retuned_nats;
      if (out.is_believed || pass + 1 < passes) continue;
      out.noise = free.noise, out.fit = free.fit, out.log_likelihood = value;
    }
    out.score = out.log_likelihood - charges(mean, out.is_believed) - constants().fast_nats;
    return out;
  }
  // Like the finding, or like the process that the noise without it has taken it for, beside the believed noise.
  FastFinding jumping_start(const SlowModel& mean) const {
    FastFinding best;
    best.effect = question_.jumping_kind();
    const EffectEstimator& e = *best.effect->estimator();
    const FastFinding* found = jumping_finding();
    if (!question_.belief.has_believed) return *found;
    SlowModel causes = mean;
    causes.noise_effect = nullptr;
    Hypothesis h = hypothesis_of(question_, *slow_.search, causes, true);
    h.base_noise = hypothesis_of(question_, *slow_.search, slow_.found.null, false).base_noise;
    const Fit fit = fit_hypothesis(question_.campaign, h);
    const ResidualLikelihood log_likelihood(question_.campaign, fit.residual);
    best.base = believed_noise(*slow_.search, mean);
    std::vector<Theta> starts = e.starts(best.base);
    if (found) starts.push_back(found->theta);
    if (!h.base_noise.markov.empty()) starts.push_back(e.like(slowest(h.base_noise)));
    double highest = -1e300;
    for (const Theta& theta : starts)
      if (const double v = log_likelihood(e.noise(best.base, theta)); best.theta.empty() || v > highest)
        highest = v, best.theta = theta;
    return best;
  }
  // Beside the causes that the slow stage named, or without them.
  Jumping first_jumping(const Jumping& alone) const {
    if (slow_.found.best.names.empty()) return alone;
    SlowModel causes = slow_.found.best;
    causes.steps.clear(), causes.noise_effect = nullptr;
    const Jumping beside = beside_mean(causes, jumping_start(causes));
    return beside.score > alone.score ? beside : alone;
  }
  // What these logs show of the levels goes.
  static void take_levels(const FastFinding& jumping, const std::vector<VectorXd>& residual, Campaign* logs) {
    const NoiseModel noise = with_jumps(jumping);
    for (size_t r = 0; r < logs->runs.size(); ++r) {
      CampaignRun& run = logs->runs[r];
      const VectorXd level = telegraph_level(run, noise, residual[r]).mean_dph;
      for (long k = 0; k < level.size(); ++k)
        run.input.rate_dph[static_cast<size_t>(run.used[static_cast<size_t>(k)])] -= level[k];
    }
  }
  // Beside what is found without the levels, as far as the seconds are more likely with it.
  Jumping last_jumping(const Jumping& first, const Jumping& alone) {
    const SlowModel& best = slow_.found.best;
    if (is_bare(best)) return alone;
    const Jumping with = beside_mean(best, first.noise);
    if (alone.score < with.score) return with;
    slow_.forget_causes();
    return alone;
  }
  // `gaussian`: score of the best answer without noise that jumps; `before`: that answer.
  void take_jumping(const Jumping& jumping, double gaussian, const SlowAnswer& before) {
    FastFinding found = jumping.noise;
    found.gain_nats = out_.gain_nats = jumping.score + constants().fast_nats - gaussian;
    std::vector<FastFinding>& list = fast_.findings;
    list.erase(std::remove_if(list.begin(), list.end(), [&](const auto& f) { return f.effect == found.effect; }),
               list.end());
    list.insert(list.begin(), found);
    seconds_.fit = jumping.fit, seconds_.hits.reset();
    seconds_.noise.base = found.base, seconds_.noise.log_likelihood = jumping.log_likelihood;
    seconds_.is_believed = jumping.is_believed, seconds_.retuned_nats = jumping.retuned_nats;
    SlowModel& best = slow_.found.best;
    if (question_.belief.has_believed) best.is_believed = seconds_.is_believed;
    if (seconds_.is_believed && is_bare(best)) slow_.found.null.is_believed = true; // no slow noise beside the jumps
    seconds_.final = hypothesis_of(question_, *slow_.search, best, true);
    fit_own_base(question_, slow_, &seconds_);
    // Of the logs as they are.
    SlowModel nominal = before.found.null, causes = best;
    causes.noise_effect = nullptr;
    causes.take_noise_of(nominal);
    nominal.is_without_lines = !question_.lines.empty();
    slow_.gap = measure_gap(*before.search, *before.data, before.held_blocks.get(), nominal, causes);
    slow_.over_null_nats = 0.5 * slow_.gap.foretold.delta_deviance;
  }

  const AxisQuestion& question_;
  SlowAnswer& slow_;
  SecondsAnswer& seconds_;
  FastScan& fast_;
  JumpingAnswer out_;
};

} // namespace

JumpingAnswer ask_jumping_noise(const AxisQuestion& question, SlowAnswer* slow, SecondsAnswer* seconds,
                                FastScan* fast) {
  return JumpingSearch(question, slow, seconds, fast).run();
}

} // namespace imucal
