// SPDX-License-Identifier: MIT
#include "analysis/diagnose/selected.h"

#include <algorithm>

namespace imucal {

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

bool is_in_set(const SelectedEffect& effect, const Effect* member) {
  return std::any_of(effect.set.begin(), effect.set.end(), [&](const auto& e) { return e.effect == member; });
}
void add_to_set(std::vector<CandidateEvidence> list, SelectedEffect* effect) {
  std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.gain_nats > b.gain_nats; });
  effect->set.insert(effect->set.end(), list.begin(), list.end());
}
void add_equal(const Effect* kind, SelectedEffect* effect) {
  if (!kind) return;
  effect->set.push_back(
      {kind, nullptr, false, kind->family(), effect->gain_nats, effect->gain_nats - effect->evidence_nats});
}

} // namespace imucal
