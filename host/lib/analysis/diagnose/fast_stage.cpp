// SPDX-License-Identifier: MIT
#include "analysis/diagnose/fast_stage.h"

#include <algorithm>

namespace imucal {

namespace {

// Block means found no kind of slow noise: where the spectrum of the seconds does not fit theirs, the seconds are asked.
bool may_ask_slow_noise(const Found& found) {
  const SlowModel& best = found.slow.found.best;
  return !best.noise_effect && best.steps.empty();
}
void leave_hits_that_stay(const AxisQuestion& question, const SecondsAnswer& seconds, FastScan* scan) {
  std::vector<FastFinding>& list = scan->findings;
  const auto stays = [&](const FastFinding& f) {
    const NoiseModel noise = f.effect->estimator()->noise(f.base, f.theta);
    return noise.hit_probability > 0 &&
           do_hits_stay(question.campaign, seconds.fit.residual, noise, question.constants);
  };
  list.erase(std::remove_if(list.begin(), list.end(), stays), list.end());
}

// The noise of the seconds where a better one was found; the believed one stays.
void take_plain(const AxisQuestion& question, const SecondsNoise& plain, SecondsAnswer* seconds) {
  if (seconds->is_believed) return;
  if (question.belief.has_believed) seconds->retuned_nats += plain.log_likelihood - seconds->noise.log_likelihood;
  seconds->noise = plain;
}

// Whether the believed noise holds was asked while hits, or a white noise that follows the temperature, passed for a part
// of it: it is asked again beside them.
void believe_beside(const AxisQuestion& question, Found* found) {
  SecondsAnswer& seconds = found->seconds;
  if (!question.belief.has_believed || seconds.is_believed || !found->fast.best(question.constants)) return;
  FastFinding& best = found->fast.scan.findings.front();
  if (best.effect->estimator()->is_jumping()) return;
  SlowModel m = found->slow.found.best;
  m.is_believed = true;
  const ResidualLikelihood log_likelihood(question.campaign, seconds.fit.residual);
  FastFinding refitted = best, believed = best;
  believed.base = found->slow.search->seconds_noise_of(m);
  seconds.retuned_nats = fit_again(log_likelihood, true, &refitted) - fit_again(log_likelihood, false, &believed);
  if (seconds.retuned_nats > question.constants.retuned_nats) return;
  set_errors(log_likelihood, &believed);
  best = believed;
  seconds.is_believed = found->slow.found.best.is_believed = true;
}

// What the fast noise explains better than a kind of slow noise takes its place.
void take_best(const AxisQuestion& question, Found* found) {
  const FastFinding* best = found->fast.best(question.constants);
  if (!best) return;
  Term term = term_of(best->effect, best->effect->estimator(), best->theta);
  term.shape_errors = best->theta_errors;
  SecondsAnswer& seconds = found->seconds;
  seconds.noise.base = best->base;
  if (seconds.is_believed)
    fit_own_base(question, found->slow, &seconds);
  else if (found->slow.found.best.noise_effect)
    fit_own_base_beside(best->effect->estimator(), best->theta, question, found->slow, &seconds);
  seconds.final.terms.push_back(term);
}

} // namespace

const FastFinding* FastAnswer::best(const SelectorConstants& constants) const {
  const bool has_one = !scan.findings.empty() && !(scan.findings.front().gain_nats < constants.fast_nats);
  return has_one ? &scan.findings.front() : nullptr;
}

void ask_fast(const AxisQuestion& question, Found* found) {
  if (question.is_censored) return; // the spread of what is left is not that of the noise
  FastScan& scan = found->fast.scan;
  SecondsAnswer& seconds = found->seconds;
  scan = scan_fast_noise(question.campaign, seconds.noise, seconds.fit.residual, question.library, question.active,
                         question.constants, may_ask_slow_noise(*found));
  take_plain(question, scan.plain, &seconds);
  leave_hits_that_stay(question, seconds, &scan);
  found->fast.jumping = ask_jumping_noise(question, &found->slow, &seconds, &scan);
  believe_beside(question, found);
  take_best(question, found);
}

} // namespace imucal
