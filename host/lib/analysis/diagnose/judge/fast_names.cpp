// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/fast_names.h"

#include <algorithm>

#include "analysis/diagnose/judge/noise_kinds.h"
#include "analysis/diagnose/stages/mean_lines.h"

namespace imucal {

namespace {

constexpr double kBroadPart = 0.1;

// The strongest first; but what these logs leave open stands before what is beside it.
void insert_by_evidence(const SelectedEffect& effect, Names* names) {
  const bool is_first = names->effects.empty() || (names->effects[0].doubt != Doubt::kSlowNoise &&
                                                   names->effects[0].evidence_nats < effect.evidence_nats);
  names->effects.insert(is_first ? names->effects.begin() : names->effects.end(), effect);
}
// Whether a process that jumps is expected to do so in a log no more often than what is said to be single events.
bool jumps_seldom(const Campaign& campaign, const FastFinding& found) {
  if (!found.effect->estimator()->is_jumping()) return false;
  const NoiseModel noise = found.noise();
  double longest_s = 0;
  for (const CampaignRun& run : campaign.runs)
    longest_s = std::max(longest_s, static_cast<double>(run.used.size()) * campaign.dt_s);
  return longest_s / (2 * noise.telegraph_tau_s) <= static_cast<double>(kMostJumps);
}
// Two levels are not told from single jumps by so few of them.
void open_seldom_jumps(const AxisQuestion& question, Names* names, SelectedEffect* effect) {
  open_member(effect);
  effect->statement = "only the family is known: so few jumps are single events or a noise that jumps";
  const auto is_steps = [](const SelectedEffect& e) { return e.term.effect && e.term.form() == Form::kSteps; };
  names->effects.erase(std::remove_if(names->effects.begin(), names->effects.end(), is_steps), names->effects.end());
  add_equal(question.first_kind([](const EffectEstimator& e) { return e.form() == Form::kSteps; }), effect);
}

// As many lines as are looked for, two of them closer than a tenth of their frequency: a broad band has as many more, and is
// no tone.
bool is_broad_band(const AxisQuestion& question) {
  if (question.lines.size() < kMostLines) return false;
  std::vector<double> frequency_hz;
  const double middle_degc = 0.5 * (question.campaign.lo_degc + question.campaign.hi_degc);
  for (const NamedLine& line : question.lines)
    frequency_hz.push_back(line.shape[0] + (line.shape.size() > 1 ? line.shape[1] * middle_degc : 0));
  std::sort(frequency_hz.begin(), frequency_hz.end());
  for (size_t i = 1; i < frequency_hz.size(); ++i)
    if (frequency_hz[i] - frequency_hz[i - 1] < kBroadPart * frequency_hz[i]) return true;
  return false;
}

// With nothing in its set yet.
SelectedEffect effect_of(const FastFinding& finding, const SelectorConstants& constants) {
  SelectedEffect effect;
  effect.family = finding.effect->family();
  effect.term = term_of(finding);
  effect.gain_nats = finding.gain_nats, effect.evidence_nats = finding.gain_nats - constants.fast_nats;
  effect.held_out_nats = kPredictsNothing;
  return effect;
}
CandidateEvidence evidence_of(const FastFinding& finding, const SelectorConstants& constants) {
  return evidence_for(*finding.effect, finding.gain_nats, constants.fast_nats);
}
void name_second(const AxisQuestion& question, const FastFinding& second, Names* names) {
  if (!second.effect) return;
  SelectedEffect effect = effect_of(second, question.constants);
  effect.set = {evidence_of(second, question.constants)};
  insert_by_evidence(effect, names);
}

// One process, or none, is told beside white noise; of several the first is not the slow noise, and none is.
Theta parameters_of(const Found& found) {
  const NoiseModel& noise = found.seconds.noise.base;
  const bool is_kind_named = found.slow.found.has_noise(); // its process comes last, and is told there
  if ((is_kind_named ? found.seconds.own_base : noise).markov.size() > 1) return {noise.white_sigma_dph};
  const Markov process = noise.markov.empty() ? Markov{0, 1} : noise.markov[0];
  return {noise.white_sigma_dph, process.sigma_dph, process.tau_s};
}

} // namespace

void name_fast(const AxisQuestion& question, const Found& found, Names* names) {
  const bool is_broad = is_broad_band(question);
  for (const NamedLine& line : question.lines)
    if (is_broad || is_of_temperature(question.campaign, line))
      names->reject(effect_of_line(line));
    else
      insert_by_evidence(effect_of_line(line), names);
  const FastFinding* first = found.fast.best(question.constants);
  if (!first) return;
  const FastFinding& best = *first;
  SelectedEffect effect = effect_of(best, question.constants);
  const bool is_slow = effect.family == Family::kSlowNoise;
  for (const FastFinding& f : found.fast.scan.findings)
    if (f.gain_nats >
        best.gain_nats - (is_slow ? question.constants.noise_margin_nats : question.constants.rivals_nats))
      effect.set.push_back(evidence_of(f, question.constants));
  const bool is_jumping = effect.term.estimator->is_jumping();
  const auto has_no_owner = [&] {
    const double gain = gain_of_free_spectrum(question.campaign, found.seconds.fit.residual, best);
    return gain > (effect.term.estimator->has_markov_spectrum() ? -1 : 1) * question.constants.rivals_nats;
  };
  if (is_slow && (effect.set.size() > 1 || (!is_jumping && has_no_owner()))) open_member(&effect);
  if (is_slow && !is_jumping) add_same_spectrum(question, &effect);
  if (found.fast.jumping.has_teeth && best.effect->estimator()->is_jumping()) {
    open_member(&effect);
    effect.statement = "only the family is known: it jumps one way more than the other, as teeth do";
  } else if (jumps_seldom(question.campaign, best)) {
    open_seldom_jumps(question, names, &effect);
  }
  insert_by_evidence(effect, names);
  name_second(question, found.fast.second, names);
}

void name_retuned(const AxisQuestion& question, const Found& found, Names* names) {
  // Where samples are gone because of their size, the spread of the rest is not that of the noise.
  if (!question.belief.has_believed || found.seconds.is_believed || question.is_censored) return;
  for (size_t j = 0; j < question.library.size(); ++j) {
    const EffectEstimator* e = question.library[j]->estimator();
    if (!e || !question.active[j] || !e->is_nominal_noise()) continue;
    SelectedEffect effect;
    effect.family = question.library[j]->family();
    effect.term = term_of(question.library[j], e, parameters_of(found));
    effect.gain_nats = found.seconds.retuned_nats;
    effect.evidence_nats = found.seconds.retuned_nats - question.constants.retuned_nats;
    effect.held_out_nats = kPredictsNothing;
    effect.set = {evidence_for(*question.library[j], effect.gain_nats, question.constants.retuned_nats)};
    add_kinds_of_noise(question, found.slow, &effect);
    names->retuned.push_back(effect);
  }
}

} // namespace imucal
