// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/sloped_noise.h"

#include <algorithm>

#include "analysis/diagnose/stages/slow_stage.h"

namespace imucal {

namespace {

constexpr int kSlopeRounds = 5;
constexpr double kSlopeGains_nats = 0.5;

bool is_slow(const FastFinding& kind) {
  return kind.effect->estimator()->is_slow_noise();
}

// A kind with its slope and the parameters of the noise beside it, searched anew from where a search ended while that gains:
// block means may be far off.  gain_nats: over `level`, the log-likelihood without a slope.
FastFinding fitted(const ResidualLikelihood& log_likelihood, double level, const Effect& kind, const Theta& theta,
                   const NoiseModel& base) {
  FastFinding f;
  f.effect = &kind, f.theta = theta, f.base = base, f.gain_nats = -1e300;
  for (int round = 0; round < kSlopeRounds; ++round) {
    const double before = f.gain_nats;
    f.gain_nats = fit_again(log_likelihood, true, &f) - level;
    if (f.gain_nats < before + kSlopeGains_nats) break;
  }
  return f;
}
// Every kind of noise that follows the temperature, slow or fast, the likeliest first.
std::vector<FastFinding> sloped_kinds(const AxisQuestion& question, const SlowModel& best, const NoiseModel& base,
                                      const ResidualLikelihood& log_likelihood, double level) {
  std::vector<FastFinding> kinds;
  for (size_t j = 0; j < question.library.size(); ++j) {
    const Effect& kind = *question.library[j];
    const EffectEstimator* e = kind.estimator();
    if (!question.active[j] || !e || e->form() != Form::kNoise || !e->needs_temperature()) continue;
    const bool is_named = &kind == best.noise_effect;
    for (const Theta& theta : is_named ? std::vector<Theta>{best.noise_theta} : e->starts(base))
      kinds.push_back(fitted(log_likelihood, level, kind, theta, base));
  }
  std::sort(kinds.begin(), kinds.end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
  return kinds;
}
// The search for a kind may have come to a better noise beside it: what that gains without a slope is not the slope's.
void raise_level(const AxisQuestion& question, const std::vector<Eigen::VectorXd>& residual, SecondsNoise* level,
                 std::vector<FastFinding>* kinds) {
  const SecondsNoise again = fit_seconds_noise(question.campaign, kinds->front().base, residual);
  const double more_nats = again.log_likelihood - level->log_likelihood;
  if (!(more_nats > 0)) return;
  for (FastFinding& kind : *kinds) kind.gain_nats -= more_nats;
  *level = again;
}
// The hypothesis with another kind: as likely in block means as it can be, with the slope of the seconds.
SlowModel with_kind(const SlowAnswer& slow, const FastFinding& kind) {
  SlowModel m = slow.found.best;
  m.noise_effect = kind.effect, m.noise_theta = kind.theta;
  m = slow.search->polished(m);
  m.noise_theta = kind.theta;
  return m;
}
// Block means took white noise for slow noise: the seconds are asked for it later.  Or the noise beside the kind, to which its
// search came, is what gains: other parameters, or another kind, do as well without a slope.
void drop_kind(const AxisQuestion& question, SlowAnswer* slow) {
  SlowModel& best = slow->found.best;
  best.noise_effect = nullptr;
  best = best.names.empty() && best.steps.empty() ? slow->found.null : slow->search->polished(best);
  slow->found.noise_evidence.reset();
  slow->measure();
  look_beside(question, slow);
}

} // namespace

bool is_noise_sloped(const SlowModel& m) {
  return m.noise_effect && m.noise_effect->estimator()->needs_temperature();
}

std::optional<SecondsNoise> fit_sloped_noise(const AxisQuestion& question, const std::vector<Eigen::VectorXd>& residual,
                                             SlowAnswer* slow) {
  slow->sloped.clear();
  SlowModel& best = slow->found.best;
  if (!is_noise_sloped(best) || !slow->found.noise_evidence) return std::nullopt;
  const ResidualLikelihood log_likelihood(question.campaign, residual);
  const NoiseModel base = slow->search->base_noise_of(best);
  SecondsNoise level = fit_seconds_noise(question.campaign, base, residual);
  std::vector<FastFinding> kinds = sloped_kinds(question, best, base, log_likelihood, level.log_likelihood);
  raise_level(question, residual, &level, &kinds);
  FastFinding first = kinds.front();
  if (is_slow(first) && first.gain_nats < question.constants.rivals_nats) {
    drop_kind(question, slow);
    return level;
  }
  kinds.erase(std::stable_partition(kinds.begin(), kinds.end(), is_slow), kinds.end());
  if (is_slow(first)) {
    for (const FastFinding& kind : kinds) slow->sloped.push_back({kind.effect, first.gain_nats - kind.gain_nats});
  } else {
    FastFinding white = first;
    first = second_kind(log_likelihood, true, kinds, question.constants.noise_nats, &white);
    if (!first.effect) {
      drop_kind(question, slow);
      return level;
    }
  }
  if (first.effect != best.noise_effect) best = with_kind(*slow, first), slow->measure();
  best.noise_theta = first.theta;
  double& evidence = *slow->found.noise_evidence;
  evidence = std::max(evidence, first.gain_nats - question.constants.noise_nats);
  const NoiseModel noise = first.effect->estimator()->noise(first.base, first.theta);
  return fit_seconds_noise(question.campaign, noise, residual);
}

Theta slope_beside(const AxisQuestion& question, const std::vector<Eigen::VectorXd>& residual, const SlowModel& m,
                   const NoiseModel& noise) {
  FastFinding slope;
  slope.effect = m.noise_effect, slope.theta = m.noise_theta, slope.base = noise;
  fit_again(ResidualLikelihood(question.campaign, residual), false, &slope);
  return slope.theta;
}

} // namespace imucal
