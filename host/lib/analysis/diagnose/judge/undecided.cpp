// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/undecided.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/evidence/minutes.h"
#include "analysis/diagnose/judge/noise_kinds.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr size_t kUndecidedTried = 4;

// Root mean square of what a hypothesis leaves, in minutes.
double spread_left(const SlowAnswer& slow, const SlowModel& m) {
  const std::vector<MeanPart> parts = slow.search->parts_on(*slow.data, m);
  const RunGrams::Posterior at = slow.search->grams_of(m).posterior();
  Minutes left;
  for (size_t r = 0; r < slow.data->y.size(); ++r)
    add_minutes(residual_of(*slow.data, parts, at, r), slow.data->campaign.dt_s, &left);
  return left.n > 0 ? std::sqrt(mean_square({left})) : slow.data->spread_dph;
}
// Part of the spread of the data that a hypothesis leaves to the noise.  Lines in the mean are no part of that spread:
// no hypothesis would have to take them.
double part_left(const SlowAnswer& slow, bool has_lines, const SlowModel& m) {
  const double spread = has_lines ? spread_left(slow, slow.found.null) : slow.data->spread_dph;
  return spread_left(slow, m) / std::max(spread, 1e-6);
}
// Whether a cause gains hardly less than slow noise and takes most of what that takes.  `has_lines`: lines of the spectrum
// stand in the mean; they are no part of what is to be taken.
bool is_undecided(const SlowAnswer& slow, const SelectorConstants& constants, bool has_lines, const SlowModel& noise,
                  const SlowModel& cause) {
  return noise.free_score() - cause.free_score() < constants.undecided_nats &&
         part_left(slow, has_lines, cause) < constants.carried_part;
}

// A kind of slow noise that is not worth its name is not what stands against a repeatable cause: the plain noise is.
const SlowModel& slow_answer(const SlowAnswer& slow, const Names& names) {
  return names.effects.empty() ? slow.found.null : slow.found.best;
}
// Repeatable causes that do as well as slow noise, beside the same kind of it, and take most of what it takes.
std::vector<CandidateEvidence> repeatable_rivals(const AxisQuestion& question, const SlowAnswer& slow,
                                                 const SlowModel& best) {
  std::vector<std::pair<double, size_t>> order;
  for (size_t j = 0; j < slow.found.singles.size(); ++j)
    if (!slow.found.singles[j].model.names.empty() && slow.candidate(j).effect &&
        slow.candidate(j).effect->estimator()->is_repeatable())
      order.push_back({slow.found.singles[j].score_nats, j});
  std::sort(order.rbegin(), order.rend());
  std::vector<CandidateEvidence> rivals;
  for (size_t i = 0; i < order.size() && i < kUndecidedTried; ++i) {
    SlowModel m = slow.found.singles[order[i].second].model;
    m.steps.clear(); // jumps in time are what it would have to take, too
    m.noise_effect = best.noise_effect, m.noise_theta = best.noise_theta, m.noise_charge = best.noise_charge;
    m = slow.search->polished(m);
    if (is_undecided(slow, question.constants, !question.lines.empty(), best, m))
      rivals.push_back(
          slow.evidence_of(order[i].second, m.free_score() - best.free_score(), question.constants.mean_nats));
  }
  std::sort(rivals.begin(), rivals.end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
  return rivals;
}
// Whether a noise has a process so slow that it could be taken for a repeatable cause.  Where no model says another noise, that it
// could be taken for one is no gap: it has to be as slow as a cause.
bool has_slow_noise(const AxisQuestion& question, const SlowModel& m, const NoiseModel& noise) {
  const SelectorConstants& constants = question.constants;
  const bool is_agreed = !m.noise_effect && (m.is_believed || !question.belief.has_believed);
  const double part = is_agreed ? constants.agreed_tau_part : constants.slow_tau_part;
  double slowest = 0;
  for (const Markov& process : noise.markov) slowest = std::max(slowest, process.tau_s);
  return slowest >= part * question.campaign.longest_s() || noise.walk_dph_per_rt_s > 0;
}

} // namespace

void name_undecided(const AxisQuestion& question, const SlowAnswer& slow, Names* names) {
  // What is left of a shape that gains more is not slow noise.
  if (!names->dropped.empty() || !names->remainders.empty()) return;
  const SlowModel& best = slow_answer(slow, *names);
  if (!names->effects.empty() && !(names->effects.size() == 1 && names->effects[0].family == Family::kSlowNoise))
    return;
  if (!has_slow_noise(question, best, slow.search->seconds_noise_of(best))) return;
  const std::vector<CandidateEvidence> rivals = repeatable_rivals(question, slow, best);
  if (rivals.empty()) return;
  SelectedEffect effect;
  if (!names->effects.empty()) effect = names->effects[0];
  effect.family = Family::kSlowNoise;
  effect.is_family = true;
  effect.doubt = Doubt::kSlowNoise;
  effect.held_out_nats = kPredictsNothing;
  CandidateEvidence own;
  own.is_family = true, own.family = Family::kSlowNoise;
  effect.set.insert(effect.set.begin(), own);
  for (CandidateEvidence family : rivals) {
    family.effect = nullptr, family.is_family = true;
    add_to_set({family}, &effect);
  }
  add_to_set(rivals, &effect);
  if (names->effects.empty()) {
    add_kinds_within(question, slow, question.constants.noise_margin_nats, best, &effect);
    add_same_spectrum(question, &effect);
  }
  names->effects = {effect};
}

} // namespace imucal
