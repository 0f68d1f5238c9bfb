// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/selected.h"

#include <algorithm>

namespace imucal {

namespace {

constexpr double kSmallPart = 0.05; // of the variance from second to second

} // namespace

CandidateEvidence evidence_for(const Effect& effect, double gain_nats, double threshold_nats) {
  return {&effect, nullptr, false, effect.family(), gain_nats, threshold_nats};
}

Term term_of(const Effect* effect, const EffectEstimator* estimator, const Theta& shape) {
  Term term;
  term.effect = effect, term.estimator = estimator, term.shape = shape;
  return term;
}

bool is_free(const SelectedEffect& effect) {
  return !effect.term.effect;
}
void open_member(SelectedEffect* effect) {
  effect->is_family = true, effect->doubt = Doubt::kMemberOpen;
}
void open_shape(SelectedEffect* effect) {
  effect->is_family = true, effect->doubt = Doubt::kShapeOpen;
}
void open_loop(SelectedEffect* effect) {
  effect->is_family = true, effect->doubt = Doubt::kLoopOpen;
}
bool are_steps_unfelt(const SelectedEffect& effect) {
  return effect.term.estimator && effect.term.estimator->concerns_coarse_thermometer() && !effect.is_family &&
         effect.doubt == Doubt::kNone && effect.evidence_nats < kWeak_nats;
}
bool is_note(const SelectedEffect& effect, double white_dph) {
  if (are_steps_unfelt(effect)) return true;
  const bool is_beside = effect.is_structural || (effect.term.estimator && effect.term.form() == Form::kAxes);
  return is_beside && effect.rms_dph * effect.rms_dph < kSmallPart * white_dph * white_dph;
}
bool is_shape_unknown(const SelectedEffect& effect) {
  return effect.doubt == Doubt::kShapeOpen || effect.doubt == Doubt::kLoopOpen;
}

bool is_in_set(const SelectedEffect& effect, const Effect* member) {
  return std::any_of(effect.set.begin(), effect.set.end(), [&](const auto& e) { return e.effect == member; });
}
void add_to_set(std::vector<CandidateEvidence> list, SelectedEffect* effect) {
  std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
  // Without an effect an entry is called by its family.
  const auto has_name = [&](const CandidateEvidence& c) {
    return std::any_of(effect->set.begin(), effect->set.end(), [&](const CandidateEvidence& e) {
      return e.effect == c.effect && (c.effect || e.family == c.family);
    });
  };
  for (const CandidateEvidence& candidate : list)
    if (!has_name(candidate)) effect->set.push_back(candidate);
}
void raise_family(SelectedEffect* effect) {
  if (!effect->is_family || effect->doubt == Doubt::kSlowNoise) return;
  double most = effect->evidence_nats;
  for (const CandidateEvidence& e : effect->set)
    if (e.family == effect->family) most = std::max(most, e.evidence_nats());
  effect->gain_nats += most - effect->evidence_nats;
  effect->evidence_nats = most;
}
void add_equal(const Effect* kind, SelectedEffect* effect) {
  if (!kind || is_in_set(*effect, kind)) return;
  effect->set.push_back(evidence_for(*kind, effect->gain_nats, effect->gain_nats - effect->evidence_nats));
}

} // namespace imucal
