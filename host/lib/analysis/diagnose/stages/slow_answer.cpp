// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/slow_answer.h"

#include <algorithm>
#include <cmath>

namespace imucal {

CandidateEvidence SlowAnswer::evidence_of(size_t j, double gain, double threshold) const {
  const Candidate& c = candidate(j);
  return {c.effect, c.reference, false, c.family(), gain, threshold};
}
bool SlowAnswer::leaves_much(double nats, const SelectorConstants& constants) const {
  return nats > constants.lack_nats && nats > constants.lack_part * (std::max(0.0, gain_nats()) + nats);
}
bool SlowAnswer::has_free_function() const {
  for (size_t i = 0; i < found.best.names.size(); ++i)
    if (is_free_function(i)) return true;
  return false;
}
bool SlowAnswer::can_test(size_t i, const SelectorConstants& constants) const {
  return gap.method == HeldOut::kQuarters || can_show(gap.foretold.beyond_start[i], constants) ||
         can_show(gap.foretold.at_all[i], constants);
}
std::vector<size_t> SlowAnswer::rows_of_jumps(const RunInput& in) const {
  std::vector<size_t> rows;
  for (const SlowModel::Name& name : found.best.names) {
    const EffectEstimator& effect = *candidate(name.candidate).scan.estimator;
    if (!effect.can_jump()) continue;
    const Column level = effect.columns(in, name.shape).front();
    for (size_t k = 1; k < level.size(); ++k)
      if (level[k] != level[k - 1]) rows.push_back(k);
  }
  return rows;
}
bool SlowAnswer::is_against(const SelectorConstants& constants) const {
  return held_blocks && !is_noise_of_all && over_null_nats < -constants.against_nats;
}
void SlowAnswer::forget_causes() {
  found.best = found.null;
  found.evidence.clear(), found.noise_evidence.reset(), found.rivals.clear(), found.replaced.clear();
  beside.clear(), dropped.clear(), is_told_by_held_out = false, is_noise_of_all = false;
}
void SlowAnswer::measure() {
  const auto over = [&](const SlowModel& null) {
    return measure_gap(*search, *data, held_blocks.get(), null, found.best);
  };
  gap = over(found.null);
  over_null_nats = 0.5 * gap.foretold.delta_deviance;
  if (!has_lines) return;
  SlowModel nothing = found.null;
  nothing.is_without_lines = true;
  gap = over(nothing);
}

namespace {

// The members of a family whose shape is open, by what each gains alone.
void add_members(const SlowAnswer& slow, const SelectorConstants& constants, SelectedEffect* effect) {
  std::vector<CandidateEvidence> members;
  for (size_t j = 0; j < slow.found.singles.size(); ++j) {
    const Effect* member = slow.candidate(j).effect;
    const double gain = slow.found.singles[j].score_nats - slow.found.null.free_score();
    if (!member || member == effect->term.effect || member->family() != effect->family || gain <= 0) continue;
    members.push_back(slow.evidence_of(j, gain, constants.mean_nats));
  }
  add_to_set(std::move(members), effect);
}

} // namespace

bool can_show(const Support& support, const SelectorConstants& constants) {
  return constants.predicted_part * support.expected > constants.least_held_out_nats;
}

SelectedEffect effect_of_name(const SlowAnswer& slow, const SelectorConstants& constants, size_t i) {
  const SlowModel::Name& name = slow.found.best.names[i];
  const Candidate& c = slow.candidate(name.candidate);
  SelectedEffect effect;
  effect.family = c.family();
  effect.term = term_of(c.effect, c.scan.estimator, name.shape);
  effect.evidence_nats = slow.found.evidence[i];
  effect.gain_nats = effect.evidence_nats + constants.mean_nats;
  effect.held_out_nats = c.scan.estimator->form() == Form::kRunRandom ? kPredictsNothing
                         : i < slow.gap.foretold.beyond_start.size()  ? slow.gap.foretold.beyond_start[i].nats
                                                                      : kPredictsNothing;
  effect.is_untested = std::isfinite(effect.held_out_nats) && !slow.can_test(i, constants);
  effect.is_of_starts = effect.held_out_nats <= 0 && i < slow.gap.foretold.at_all.size() &&
                        slow.gap.foretold.at_all[i].nats > constants.least_held_out_nats;
  const double threshold = constants.mean_nats;
  effect.set.push_back(slow.evidence_of(name.candidate, effect.gain_nats, threshold));
  double nearest = 1e300; // of another member of the family
  std::vector<CandidateEvidence> rivals;
  for (const SlowResult::Rival& rival : slow.found.rivals[i]) {
    const Effect* other = rival.noise_effect ? rival.noise_effect : slow.candidate(rival.candidate).effect;
    if (!other || other == c.effect || rival.gap_nats >= constants.rivals_nats) continue;
    const bool is_at_bound = !rival.noise_effect && rival.model.names.back().is_at_bound; // no name itself
    if (other->family() == effect.family && !is_at_bound) nearest = std::min(nearest, rival.gap_nats);
    rivals.push_back(evidence_for(*other, effect.gain_nats - rival.gap_nats, threshold));
  }
  add_to_set(std::move(rivals), &effect);
  if (!c.effect || name.is_at_bound) {
    effect.is_family = true;
    effect.doubt = Doubt::kShapeOpen;
    add_members(slow, constants, &effect);
  } else if (nearest < constants.family_margin_nats) {
    open_member(&effect);
  }
  return effect;
}

} // namespace imucal
