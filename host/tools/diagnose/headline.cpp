// SPDX-License-Identifier: MIT
#include "diagnose/headline.h"

#include <algorithm>

#include "base/axis_unit.h"
#include "diagnose/advice.h"
#include "diagnose/effect_words.h"
#include "diagnose/gap_words.h"
#include "diagnose/words.h"

namespace imucal {
// Other parameters of the believed noise, and notes, are beside the cause, if there is one.
bool has_weak_causes_only(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const auto is_cause = [&](const SelectedEffect& e) {
    return !is_note(axis, e) && !(e.term.estimator && e.term.estimator->is_nominal_noise());
  };
  const bool has_cause = std::any_of(s.effects.begin(), s.effects.end(), is_cause);
  return std::all_of(s.effects.begin(), s.effects.end(),
                     [&](const SelectedEffect& e) { return is_weak(e) || (has_cause && !is_cause(e)); });
}

namespace {

// Why the family of a cause is told and no member of it.
std::string what_is_open(const std::vector<SelectedEffect>& effects) {
  const std::string no_member = "no member of it is told by these logs";
  if (effects.size() != 1) return no_member;
  const SelectedEffect& e = effects.front();
  if (e.doubt == Doubt::kShapeOpen) return "a free shape of it fits better than any member";
  if (e.doubt == Doubt::kLoopOpen) return "the states in which runs began are seen, a loop is not";
  std::vector<std::string> members;
  for (const CandidateEvidence& c : e.set)
    if (c.effect && c.family == e.family) add_once(c.effect->name(), &members);
  return members.size() == 1
             ? "of its members only " + members.front() + " comes near, and these logs do not bear it out"
             : no_member;
}

// A gap that has no name: what comes nearest, where anything does.
std::string unexplained(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  std::vector<SelectedEffect> told;
  std::vector<std::string> families, nearest, shared; // what axes share is measured, whatever else there is
  for (const SelectedEffect& e : s.effects)
    if (is_shared_noise(e) && !is_note(axis, e))
      add_once(name_of(e), &shared);
    else if (!is_note(axis, e))
      told.push_back(e);
  const std::string beside = shared.empty() ? "" : "; beside it " + joined(shared, " and ");
  for (const SelectedEffect& e : told) add_once(name_of(e), &families);
  for (const CandidateEvidence& c : s.remainders)
    if (!c.reference) add_once(name_of(c), &nearest);
  if (!families.empty())
    return "a gap, with a cause of the family " + joined(families, " and ") + "; " + what_is_open(told) + beside;
  if (!nearest.empty())
    return "a gap without a sure name; nearest comes " + joined(nearest, " and ") +
           ", which these logs do not bear out" + beside;
  return "a gap that no known effect explains" + beside;
}

} // namespace

std::string why_refused(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  if (!axis.refused.empty()) return axis.refused;
  if (s.effects.empty() && s.n_left_out == 0) return "too few usable seconds to judge";
  return "what the recorder did to the samples leaves too few usable seconds to judge";
}

namespace {

bool is_undecided(const Selection& s) {
  return std::any_of(s.effects.begin(), s.effects.end(),
                     [](const SelectedEffect& e) { return e.doubt == Doubt::kSlowNoise; });
}
// Left open where noise that was estimated from these logs explains them: no model says that there is a gap.
bool is_open_without_gap(const AxisResult& axis) {
  const std::vector<SelectedEffect>& effects = axis.study.selection.effects;
  return !axis.is_believed && is_undecided(axis.study.selection) && effects.size() == 1 && !(effects[0].gain_nats > 0);
}

} // namespace

bool is_of_noise_alone(const AxisResult& axis) {
  return !axis.campaign.has_temperature;
}

// The verdict in a few words, never more than the headline says.
std::string title(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  if (!is_judged(axis)) return "no answer";
  switch (s.verdict) {
  case Verdict::kNoGap:
    return is_of_noise_alone(axis) ? "only noise judged" : "no gap found";
  case Verdict::kExplained:
    return has_weak_causes_only(axis) ? "gap, weakly explained" : "gap explained";
  case Verdict::kPartlyExplained:
    if (is_open_without_gap(axis)) return "noise or cause open";
    return is_undecided(s) ? "gap, noise or cause open" : "gap partly explained";
  case Verdict::kUnexplained:
    return "gap, cause open";
  }
  return "";
}

namespace {

// What was found, for the headline, which is without notes.  Slow noise that may be a cause is told there in words.
std::string names_told(const AxisResult& axis) {
  const std::vector<SelectedEffect>& effects = axis.study.selection.effects;
  std::vector<std::string> names;
  for (size_t i : reading_order(axis)) {
    const SelectedEffect& e = effects[i];
    if (e.doubt == Doubt::kSlowNoise || is_note(axis, e)) continue;
    add_once(name_of(e) + (is_weak(e) && !has_weak_causes_only(axis) ? " (weak)" : ""), &names);
  }
  return joined(names, ", ");
}

// Without a model slow waves are taken for noise; without temperatures nothing else was asked.
std::string no_gap(const AxisResult& axis) {
  std::string out = "no gap that these logs can show";
  if (is_of_noise_alone(axis))
    out = std::string("only noise was judged, and it shows no gap: ") +
          (axis.campaign.is_temperature_steady ? "the temperature hardly moves" : "these logs have no temperatures");
  if (!axis.is_believed)
    out += "; the noise was estimated from these logs, so slow waves in them count as noise (--model judges them)";
  return out;
}

} // namespace

// The answer in a sentence.
std::string headline(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  if (!is_judged(axis)) return "no answer: " + why_refused(axis);
  const std::string names = names_told(axis);
  const auto with = [&](const char* between) { return names.empty() ? "" : between + names; };
  switch (s.verdict) {
  case Verdict::kNoGap:
    return no_gap(axis);
  case Verdict::kExplained:
    return (has_weak_causes_only(axis) ? "a gap, weakly explained" : "a gap, explained") + with(": ");
  case Verdict::kPartlyExplained:
    if (is_open_without_gap(axis))
      return "slow noise or a repeatable cause, these logs cannot tell; no model says how strong the noise is";
    if (is_undecided(s))
      return "a gap: slow noise or a repeatable cause, these logs cannot tell" + with("; beside it ");
    return "a gap, partly explained" + with(": ");
  case Verdict::kUnexplained:
    return unexplained(axis);
  }
  return "";
}

// Silence of a profile is no answer on what it cannot show.
std::string statement(const AxisResult& axis) {
  const bool is_healthy = is_judged(axis) && axis.study.selection.verdict == Verdict::kNoGap;
  const std::string hidden = is_healthy ? hidden_text(axis) : "";
  return headline(axis) + (hidden.empty() ? "" : "; not detectable on these profiles: " + hidden);
}

std::vector<std::string> notes(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  std::vector<std::string> out;
  for (const SelectedEffect& e : s.dropped)
    out.push_back(name_of(e) + format(" would explain the fitted logs (%.0f nats), but the held-out data do not "
                                      "support it (%.1f nats): not named",
                                      e.gain_nats, e.held_out_nats));
  for (const SelectedEffect& e : s.effects)
    if (e.is_any_shape && !e.is_family)
      out.push_back(
          e.term.effect->name() +
          ": found in a shape that its parameters do not tell; they are those of the nearest one, which leaves more");
  if (s.is_told_by_held_out && !s.effects.empty() && s.effects.front().family != Family::kSlowNoise)
    out.push_back("slow noise would explain the fitted logs as well; what is named is told by all logs together");
  if (!s.own_jumps.empty())
    out.push_back("held-out logs have jumps of their own, which no fitted log predicts: " +
                  steps_text(s.own_jumps, true, axis_unit(axis.axis)) + " held out; the level after each is left free");
  if (s.n_dropouts > 0)
    out.push_back(format("%zu exact zeros that are no rates are drop-outs and were left out", s.n_dropouts));
  if (s.n_left_out > s.n_dropouts)
    out.push_back(format("%zu seconds in all were left out because of what the recorder or converter did to them, or "
                         "to samples next to them",
                         s.n_left_out));
  if (s.is_noise_retuned)
    out.push_back(
        "the believed noise parameters do not fit these logs: they were estimated again under every candidate");
  return out;
}

} // namespace imucal
