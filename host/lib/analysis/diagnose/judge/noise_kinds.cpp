// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/noise_kinds.h"

#include <algorithm>

#include "analysis/diagnose/stages/sloped_noise.h"

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

// What the seconds say of kinds of noise that follow the temperature, where an answer has one.
const std::vector<SlopedKind>& told_by_seconds(const SlowAnswer& slow, const SlowModel& answer) {
  static const std::vector<SlopedKind> kNone;
  return is_noise_sloped(answer) ? slow.sloped : kNone;
}

// Temperatures at which the jumps of a hypothesis may have happened: at its moment and a part of a row before and after.
std::vector<JumpPlace> places_of_steps(const SlowData& data, const SlowModel& m) {
  std::vector<JumpPlace> places;
  for (const Theta& step : m.steps) {
    const std::optional<JumpMoment> at = moment_of(data.campaign.runs[static_cast<size_t>(step[0])].input, step[1]);
    if (!at) continue;
    for (double rows : {-0.2, 0.0, 0.2}) {
      places.push_back(at->place);
      places.back().temp_degc += rows * at->row_s * at->place.slope_degc_s;
    }
  }
  return places;
}
// Likelihood of the data with these shapes of an effect, the best of them, in the place of the jumps in time.
double best_in_place_of_steps(const SlowAnswer& slow, const EffectEstimator& estimator,
                              const std::vector<Theta>& shapes) {
  SlowModel without_steps = slow.found.best;
  without_steps.steps.clear();
  std::vector<MeanPart> parts = slow.search->parts_on(*slow.data, without_steps);
  parts.emplace_back();
  const NoiseModel noise = slow.search->noise_of(without_steps);
  double best = -1e300;
  for (const Theta& shape : shapes) {
    parts.back() = mean_part(*slow.data, estimator, shape);
    best = std::max(best, RunGrams(*slow.data, pointers_of(parts), noise).log_marginal_any_scale());
  }
  return best;
}

} // namespace

void add_kinds_within(const AxisQuestion& question, const SlowAnswer& slow, double margin_nats, const SlowModel& answer,
                      SelectedEffect* effect) {
  std::vector<CandidateEvidence> kinds;
  const std::vector<SlopedKind>& by_seconds = told_by_seconds(slow, answer);
  const auto is_told = [&](const Effect* kind) {
    return std::any_of(by_seconds.begin(), by_seconds.end(), [&](const SlopedKind& k) { return k.effect == kind; });
  };
  const bool is_alone = answer.names.empty() && answer.steps.empty();
  for (const SlowCandidateScore& s : is_alone ? slow.found.noises : slow.search->kinds_beside(answer)) {
    if (!s.model.noise_effect || is_in_set(*effect, s.model.noise_effect) || is_told(s.model.noise_effect)) continue;
    const SlowModel m =
        is_needed(question.constants, *slow.search, s.model) ? s.model : slow.search->in_place_of_base(s.model);
    const double gap = answer.free_score() - m.free_score();
    if (gap >= margin_nats || !is_needed(question.constants, *slow.search, m)) continue;
    kinds.push_back(evidence_for(*s.model.noise_effect, effect->gain_nats - gap, question.constants.noise_nats));
  }
  for (const SlopedKind& kind : by_seconds)
    if (kind.gap_nats < margin_nats && !is_in_set(*effect, kind.effect))
      kinds.push_back(evidence_for(*kind.effect, effect->gain_nats - kind.gap_nats, question.constants.noise_nats));
  add_to_set(std::move(kinds), effect);
}
void add_means_that_do_as_well(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* effect) {
  const SlowModel& best = slow.found.best;
  std::vector<CandidateEvidence> means;
  for (size_t j = 0; j < slow.found.singles.size(); ++j) {
    const SlowCandidateScore& s = slow.found.singles[j];
    const double gap = best.free_score() + best.noise_charge - s.score_nats;
    if (!slow.candidate(j).effect || s.model.names.empty() || gap >= question.constants.rivals_nats) continue;
    means.push_back(slow.evidence_of(j, effect->gain_nats - gap, question.constants.mean_nats));
  }
  add_to_set(std::move(means), effect);
}
void add_means_without_steps(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* steps) {
  // What held-out data took away is excluded, whatever the fitted logs say.
  if (!slow.found.without_steps || !slow.found.best.names.empty() || !slow.dropped.empty()) return;
  const double own = slow.search->score(slow.found.best);
  std::vector<CandidateEvidence> means;
  for (size_t j = 0; j < slow.found.without_steps->singles.size(); ++j) {
    const SlowCandidateScore& s = slow.found.without_steps->singles[j];
    if (!slow.candidate(j).effect || s.model.names.empty()) continue;
    const double gap = own - slow.search->score(s.model);
    if (gap < question.constants.rivals_nats)
      means.push_back(evidence_for(*slow.candidate(j).effect, steps->evidence_nats - gap + question.constants.mean_nats,
                                   question.constants.mean_nats));
  }
  add_to_set(std::move(means), steps);
}
void add_kinds_of_noise(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* retuned) {
  const SlowModel& best = slow.found.best;
  if (slow.found.has_noise()) return;
  const bool is_alone = best.names.empty() && best.steps.empty();
  const SlowModel& plain = is_alone ? slow.found.null : best; // with other parameters, and no kind
  if (plain.noise_effect) return;
  std::vector<CandidateEvidence> kinds;
  for (const SlowCandidateScore& s : is_alone ? slow.found.noises : slow.search->kinds_beside(best)) {
    if (!s.model.noise_effect) continue;
    const SlowModel m = slow.search->beside_believed(s.model);
    const double gap = plain.free_score() - m.free_score() - question.constants.noise_kind_nats;
    const double gap_beside_others =
        is_needed(question.constants, *slow.search, s.model) ? best.free_score() - s.model.free_score() : 1e300;
    if (gap >= question.constants.noise_margin_nats && gap_beside_others >= question.constants.rivals_nats) continue;
    // One that is ahead by less than its name costs does as well.
    const double lost = std::max(0.0, std::min(gap, gap_beside_others));
    kinds.push_back(evidence_for(*m.noise_effect, retuned->gain_nats - lost, question.constants.noise_nats));
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

void add_jumps_at_temperature(const AxisQuestion& question, const SlowAnswer& slow, SelectedEffect* steps) {
  if (!question.campaign.has_temperature || question.campaign.order < 1) return;
  const std::vector<JumpPlace> places = places_of_steps(*slow.data, slow.found.best);
  const double in_time = slow.search->grams_of(slow.found.best).log_marginal_any_scale();
  std::vector<CandidateEvidence> list;
  for (size_t j = 0; j < question.library.size(); ++j) {
    const Effect* effect = question.library[j];
    if (!question.active[j] || !effect->estimator() || !effect->estimator()->can_jump()) continue;
    const double gap =
        in_time - best_in_place_of_steps(slow, *effect->estimator(), effect->estimator()->shapes_of_jumps(places));
    if (gap < question.constants.rivals_nats)
      list.push_back(evidence_for(*effect, steps->gain_nats - gap, question.constants.mean_nats));
  }
  if (list.empty()) return;
  add_to_set(std::move(list), steps);
  steps->statement = "these logs pass that temperature once: one that passes it again tells whether the time or the "
                     "temperature decides";
}

void follow_temperature(const AxisQuestion& question, bool are_loops, SelectedEffect* effect) {
  effect->family = are_loops ? Family::kThermalMemory : Family::kFunctionOfTemperature;
  open_shape(effect);
  std::vector<CandidateEvidence> members;
  for (size_t j = 0; j < question.library.size(); ++j) {
    const EffectEstimator* e = question.library[j]->estimator();
    if (!question.active[j] || !e || !(e->can_jump() || e->is_start_bounded())) continue;
    CandidateEvidence as_well = effect->set.front();
    as_well.effect = question.library[j], as_well.family = question.library[j]->family();
    members.push_back(as_well);
  }
  add_to_set(std::move(members), effect);
  std::stable_partition(effect->set.begin(), effect->set.end(),
                        [&](const CandidateEvidence& e) { return e.family == effect->family; });
  effect->statement =
      "these jumps come again at the same temperatures in other logs: they follow the temperature, not the time";
}

void open_jumps(const AxisQuestion& question, SelectedEffect* effect) {
  effect->family = Family::kSlowNoise;
  open_member(effect);
  add_equal(question.jumping_kind(), effect);
  // What is of the family that is told stands first.
  std::stable_partition(effect->set.begin(), effect->set.end(),
                        [&](const CandidateEvidence& e) { return e.family == effect->family; });
  const bool is_one = effect->term.shape.size() == 2; // run, t_s
  effect->statement =
      is_one ? "one jump is placed, but these logs do not bear out that it is a single event: perhaps a noise "
               "that jumps; what makes it is open"
             : "jumps come again and again: a noise that jumps, not single events; what makes it is open";
}

} // namespace imucal
