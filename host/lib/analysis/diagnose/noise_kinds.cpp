// SPDX-License-Identifier: MIT
#include "analysis/diagnose/noise_kinds.h"

#include <algorithm>

namespace imucal {

namespace {

// Whether the kind of noise of a hypothesis takes anything: one that could be left out of it is no rival.
bool is_needed(const SelectorConstants& constants, const SlowSearch& search, const SlowModel& m) {
  if (!m.noise_effect) return false;
  SlowModel less = m;
  less.noise_effect = nullptr;
  const auto value = [&](const SlowModel& at) { return search.grams_of(at).log_marginal_any_scale(); };
  return value(m) - value(less) > constants.rivals_nats;
}

} // namespace

void add_kinds_within(const AxisQuestion& question, const SlowAnswer& slow, double margin_nats, const SlowModel& answer,
                      SelectedEffect* effect) {
  std::vector<CandidateEvidence> kinds;
  const bool is_alone = answer.names.empty() && answer.steps.empty();
  for (const SlowCandidateScore& s : is_alone ? slow.found.noises : slow.search->kinds_beside(answer)) {
    if (!s.model.noise_effect || is_in_set(*effect, s.model.noise_effect)) continue;
    const SlowModel m =
        is_needed(question.constants, *slow.search, s.model) ? s.model : slow.search->in_place_of_base(s.model);
    const double gap = answer.free_score() - m.free_score();
    if (gap >= margin_nats || !is_needed(question.constants, *slow.search, m)) continue;
    kinds.push_back({s.model.noise_effect, nullptr, false, Family::kSlowNoise, effect->gain_nats - gap,
                     question.constants.noise_nats});
  }
  add_to_set(std::move(kinds), effect);
}
void add_means_that_do_as_well(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* effect) {
  const SlowModel& best = slow.found.best;
  std::vector<CandidateEvidence> means;
  for (size_t j = 0; j < slow.found.singles.size(); ++j) {
    const SlowCandidateScore& s = slow.found.singles[j];
    const double gap = best.free_score() + best.noise_charge - s.gain_nats;
    if (!slow.candidate(j).effect || s.model.names.empty() || gap >= question.constants.rivals_nats) continue;
    means.push_back(slow.evidence_of(j, effect->gain_nats - gap, question.constants.mean_nats));
  }
  add_to_set(std::move(means), effect);
}
void add_kinds_of_noise(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* retuned) {
  const SlowModel& null = slow.found.null;
  const SlowModel& best = slow.found.best;
  if (!best.names.empty() || (best.noise_effect && slow.found.evidence.back() > 0)) return;
  std::vector<CandidateEvidence> kinds;
  for (const SlowCandidateScore& s : slow.found.noises) {
    if (!s.model.noise_effect) continue;
    const SlowModel m = slow.search->beside_believed(s.model);
    const double gap = null.free_score() - m.free_score() - question.constants.noise_kind_nats;
    const double gap_beside_others =
        is_needed(question.constants, *slow.search, s.model) ? best.free_score() - s.gain_nats : 1e300;
    if (gap < question.constants.noise_margin_nats || gap_beside_others < question.constants.rivals_nats)
      kinds.push_back({m.noise_effect, nullptr, false, retuned->family,
                       retuned->gain_nats - std::min(gap, gap_beside_others), question.constants.noise_nats});
  }
  add_to_set(std::move(kinds), retuned);
  add_same_spectrum(question, retuned);
}
void add_same_spectrum(const AxisQuestion& question, SelectedEffect* effect) {
  const auto has_markov_spectrum = [](const CandidateEvidence& e) {
    return e.effect && e.effect->estimator() && e.effect->estimator()->has_markov_spectrum();
  };
  const auto own = std::find_if(effect->set.begin(), effect->set.end(), has_markov_spectrum);
  if (own == effect->set.end()) return;
  const CandidateEvidence as_well = *own;
  for (size_t j = 0; j < question.library.size(); ++j) {
    CandidateEvidence other = as_well;
    other.effect = question.library[j];
    if (question.active[j] && !is_in_set(*effect, question.library[j]) && has_markov_spectrum(other))
      effect->set.push_back(other);
  }
}

void open_jumps(const AxisQuestion& question, SelectedEffect* effect) {
  effect->family = Family::kSlowNoise;
  open_member(effect);
  add_equal(question.jumping_kind(), effect);
  effect->statement = "jumps come again and again: a noise that jumps, not single events; what makes it is open";
}

} // namespace imucal
