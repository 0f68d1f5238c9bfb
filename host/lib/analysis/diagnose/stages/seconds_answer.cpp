// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/seconds_answer.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/stages/sloped_noise.h"
#include "analysis/diagnose/stages/slow_stage.h"

namespace imucal {

using Eigen::VectorXd;

Hypothesis hypothesis_of(const AxisQuestion& question, const SlowSearch& search, const SlowModel& m, bool with_names) {
  Hypothesis h;
  h.base_noise = search.base_noise_of(m);
  for (const NoiseBelief::Known& known : question.belief.known)
    if (known.estimator->form() != Form::kTone) h.known.push_back(term_of(nullptr, known.estimator, known.shape));
  if (!with_names) return h;
  for (const NamedLine& line : question.lines)
    h.terms.push_back(term_of(line.effect, line.effect->estimator(), line.shape));
  for (const SlowModel::Name& name : m.names) {
    const Candidate& c = search.candidates()[name.candidate];
    h.terms.push_back(term_of(c.effect, c.scan.estimator, name.shape));
  }
  if (!m.steps.empty()) {
    Theta shape;
    for (const Theta& step : m.steps) shape.insert(shape.end(), step.begin(), step.end());
    for (const Effect* effect : question.library)
      if (effect->estimator() && effect->estimator()->form() == Form::kSteps)
        h.terms.push_back(term_of(effect, effect->estimator(), shape));
  }
  if (m.noise_effect) h.terms.push_back(term_of(m.noise_effect, m.noise_effect->estimator(), m.noise_theta));
  return h;
}

NoiseModel believed_noise(const SlowSearch& search, SlowModel m) {
  m.is_believed = true;
  return search.seconds_noise_of(m);
}

void fit_own_base(const AxisQuestion& question, const SlowAnswer& slow, SecondsAnswer* seconds) {
  const SlowModel& m = slow.found.best;
  if (!m.noise_effect) return;
  seconds->own_base = slow.search->base_noise_of(m);
  if (seconds->is_believed) return;
  fit_own_base_beside({}, question, slow, seconds);
}
void fit_own_base_beside(const std::function<NoiseModel(const NoiseModel&)>& fast, const AxisQuestion& question,
                         const SlowAnswer& slow, SecondsAnswer* seconds) {
  const SlowModel& m = slow.found.best;
  const auto with = [&](const NoiseModel& base) {
    const NoiseModel with_slow = m.noise_effect->estimator()->noise(base, m.noise_theta);
    return fast ? fast(with_slow) : with_slow;
  };
  const std::vector<VectorXd>& residual = fast ? seconds->fit.residual : seconds->without_hits();
  seconds->own_base = fit_seconds_noise(question.campaign, seconds->own_base, residual, with).base;
}

namespace {

void fit_final(const AxisQuestion& question, SecondsAnswer* seconds) {
  seconds->fit = fit_hypothesis(question.campaign, seconds->final);
  seconds->hits = standing_out(question.campaign, seconds->fit.residual);
}

constexpr double kPlaceBlocks = 1.5; // how far from its place in block means a jump is looked for

// What was found in the mean, beside this noise of the seconds.
Fit fit_beside(const AxisQuestion& question, const SlowAnswer& slow, const NoiseModel& noise) {
  SlowModel mean = slow.found.best;
  mean.noise_effect = nullptr; // the noise of the seconds has it
  Hypothesis h = hypothesis_of(question, *slow.search, mean, true);
  h.base_noise = noise;
  return fit_hypothesis(question.campaign, h);
}
// What the seconds say for the fitted noise against the likeliest of others, the mean estimated under each and what it costs
// counted (REML): a mean that was fitted beside one noise is no judge of the other.
double gain_over(const AxisQuestion& question, const SlowAnswer& slow, const std::vector<NoiseModel>& others,
                 const SecondsAnswer& seconds) {
  double other = -1e300;
  for (const NoiseModel& noise : others) other = std::max(other, fit_beside(question, slow, noise).reml());
  return fit_beside(question, slow, seconds.noise.base).reml() - other;
}
// Whether the believed noise parameters hold is a question to the seconds, under the causes found.
void believe_again(const AxisQuestion& question, SlowAnswer* slow, SecondsAnswer* seconds) {
  seconds->is_believed = false;
  if (!question.belief.has_believed) return;
  SlowModel beside = slow->found.best;
  if (is_noise_sloped(beside)) {
    SlowModel plain = beside;
    plain.noise_effect = nullptr;
    beside.noise_theta = slope_beside(question, seconds->without_hits(), beside, believed_noise(*slow->search, plain));
  }
  const NoiseModel believed = believed_noise(*slow->search, beside);
  const double as_believed = ResidualLikelihood(question.campaign, seconds->without_hits())(believed);
  seconds->retuned_nats = seconds->noise.log_likelihood - as_believed;
  if (seconds->retuned_nats > question.constants.retuned_nats)
    seconds->retuned_nats = gain_over(question, *slow, {believed}, *seconds);
  if (seconds->retuned_nats > question.constants.retuned_nats) return;
  seconds->is_believed = true;
  seconds->noise.base = believed, seconds->noise.log_likelihood = as_believed;
  slow->found.best = beside;
  slow->found.best.is_believed = true; // its noise is the believed one from here on
  seconds->final = hypothesis_of(question, *slow->search, slow->found.best, true);
}
// Two parts of one jump inside a block come to the same sample: they are one.
void drop_doubles(std::vector<Theta>* steps) {
  std::vector<Theta> apart;
  for (const Theta& step : *steps)
    if (std::find(apart.begin(), apart.end(), step) == apart.end()) apart.push_back(step);
  *steps = apart;
}
// Block means tell the block of a jump, the seconds its sample.  Returns whether one has moved.
bool place_jumps(const AxisQuestion& question, SlowAnswer* slow, SecondsAnswer* seconds) {
  const Design design = make_design(question.campaign, seconds->final);
  std::vector<double> sizes_dph;
  for (size_t t = 0; t < seconds->final.terms.size(); ++t)
    if (seconds->final.terms[t].form() == Form::kSteps)
      for (const long c : columns_of(design, t)) sizes_dph.push_back(seconds->fit.beta[c]);
  std::vector<Theta>& steps = slow->found.best.steps;
  const long reach = std::lround(kPlaceBlocks * slow->data->campaign.dt_s / question.campaign.dt_s);
  std::vector<VectorXd> residual = seconds->without_hits();
  bool has_moved = false;
  for (size_t s = 0; s < steps.size() && s < sizes_dph.size(); ++s) {
    const auto r = static_cast<size_t>(steps[s][0]);
    const CampaignRun& run = question.campaign.runs[r];
    const auto t_s = [&](long k) { return run.input.t_s[static_cast<size_t>(run.used[static_cast<size_t>(k)])]; };
    long at = 0;
    while (at < static_cast<long>(run.n()) && t_s(at) < steps[s][1]) ++at;
    if (at == static_cast<long>(run.n())) continue;
    const long k = sample_of_jump(run, seconds->noise.base, residual[r], sizes_dph[s], at, reach);
    residual[r] = with_jump_moved(residual[r], sizes_dph[s], at, k);
    const double place_s = t_s(k) - 0.5 * question.campaign.dt_s;
    has_moved = has_moved || k != at || std::fabs(place_s - steps[s][1]) >= question.campaign.dt_s;
    steps[s][1] = place_s;
  }
  const size_t n_before = steps.size();
  drop_doubles(&steps);
  return has_moved || steps.size() < n_before;
}
// Single processes that several may be taken for: the first, the strongest, and one of all their variance.
std::vector<Markov> in_one(const std::vector<Markov>& processes) {
  if (processes.size() == 1) return processes;
  double variance = 0, log_tau = 0;
  Markov strongest = processes.front();
  for (const Markov& m : processes) {
    const double own = m.sigma_dph * m.sigma_dph;
    variance += own, log_tau += own * std::log(m.tau_s);
    if (m.sigma_dph > strongest.sigma_dph) strongest = m;
  }
  return {processes.front(), strongest, {std::sqrt(variance), std::exp(log_tau / std::max(1e-300, variance))}};
}
// The likeliest noise of one process.
NoiseModel noise_of_one(const AxisQuestion& question, const SlowAnswer& slow, const SecondsAnswer& seconds) {
  SecondsNoise best;
  for (const Markov& process : in_one(seconds.noise.base.markov)) {
    NoiseModel alone;
    alone.white_sigma_dph = seconds.noise.base.white_sigma_dph, alone.markov = {process};
    const SecondsNoise fitted = fit_seconds_noise(question.campaign, alone, seconds.without_hits());
    if (fitted.log_likelihood > best.log_likelihood) best = fitted;
  }
  SecondsAnswer beside;
  beside.fit = fit_beside(question, slow, best.base);
  beside.hits = standing_out(question.campaign, beside.fit.residual);
  return fit_seconds_noise(question.campaign, best.base, beside.without_hits()).base;
}
// Block means hardly show a process of few seconds.  What a kind of slow noise that is not worth its name in them gains in the
// seconds, over one process alone and over the believed noise, tells too.  Returns whether it is less likely than these there.
bool weigh_noise_in_seconds(const AxisQuestion& question, const SecondsAnswer& seconds, SlowAnswer* slow) {
  const SlowModel& best = slow->found.best;
  std::optional<double>& evidence = slow->found.noise_evidence;
  if (!best.noise_effect || !evidence || *evidence > 0) return false;
  if (seconds.noise.base.markov.empty()) return false;
  std::vector<NoiseModel> others = {noise_of_one(question, *slow, seconds)};
  if (question.belief.has_believed) {
    SlowModel plain = best;
    plain.noise_effect = nullptr;
    others.push_back(believed_noise(*slow->search, plain));
  }
  const double gain = gain_over(question, *slow, others, seconds);
  evidence = std::max(*evidence, gain - question.constants.fast_nats);
  return gain < 0;
}
// The believed noise does beside a kind of noise that is not worth its name, and does not without it; or the seconds are likelier
// without it: other parameters are the simpler answer.
bool gives_up_unnamed_noise(const AxisQuestion& question, SlowAnswer* slow) {
  SlowModel& best = slow->found.best;
  if (!best.names.empty() || !best.steps.empty() || !best.noise_effect) return false;
  if (slow->found.has_noise() || slow->found.null.is_believed) return false;
  best = slow->found.null;
  slow->found.noise_evidence.reset();
  slow->measure();
  look_beside(question, slow);
  return true;
}

} // namespace

SecondsAnswer ask_seconds(const AxisQuestion& question, SlowAnswer* slow) {
  SecondsAnswer out;
  SlowModel nominal = slow->found.null;
  nominal.is_believed = nominal.is_believed || question.belief.has_believed;
  out.nominal = hypothesis_of(question, *slow->search, nominal, false);
  out.final = hypothesis_of(question, *slow->search, slow->found.best, true);
  fit_final(question, &out);
  out.noise = fit_seconds_noise(question.campaign, out.final.noise(), out.without_hits());
  if (!slow->found.best.steps.empty() && place_jumps(question, slow, &out)) {
    out.final = hypothesis_of(question, *slow->search, slow->found.best, true);
    fit_final(question, &out);
    out.noise = fit_seconds_noise(question.campaign, out.noise.base, out.without_hits());
  }
  if (const std::optional<SecondsNoise> sloped = fit_sloped_noise(question, out.without_hits(), slow)) {
    out.noise = *sloped;
    out.final = hypothesis_of(question, *slow->search, slow->found.best, true);
  }
  believe_again(question, slow, &out);
  const bool is_less_likely = weigh_noise_in_seconds(question, out, slow);
  if ((out.is_believed || is_less_likely) && gives_up_unnamed_noise(question, slow)) return ask_seconds(question, slow);
  fit_own_base(question, *slow, &out);
  return out;
}
std::vector<VectorXd> whitened(const Campaign& campaign, const SecondsAnswer& seconds) {
  return whitened(campaign.runs, gaussian_equivalent(seconds.noise.base), seconds.without_hits());
}

} // namespace imucal
