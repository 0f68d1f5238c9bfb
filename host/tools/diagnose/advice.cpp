// SPDX-License-Identifier: MIT
#include "diagnose/advice.h"

#include <algorithm>
#include <cmath>

#include "base/axis_unit.h"
#include "base/digits.h"
#include "diagnose/effect_words.h"
#include "diagnose/words.h"

namespace imucal {

namespace {

constexpr double kNoSize = 1e6;     // sizes beyond are no sizes: nothing would show
constexpr double kMuchBetter = 1.5; // how many times smaller a size has to be for a profile to help
constexpr int kSizeDigits = 2;
constexpr size_t kFewRuns = 4;

bool is_in_answer(const SelectedEffect& e, const std::string& name) {
  const auto is_it = [&](const Effect* effect) { return effect && effect->name() == name; };
  return is_it(e.term.effect) ||
         std::any_of(e.set.begin(), e.set.end(), [&](const CandidateEvidence& c) { return is_it(c.effect); });
}

const Detectability* found_in(const Identifiability& list, const std::string& name) {
  for (const Detectability& d : list.effects)
    if (d.name == name) return &d;
  return nullptr;
}

// The name of a parameter without its unit: "width_degc" -> "width".
std::string quantity(const std::string& name) {
  if (name == "tau_s") return "time constant";
  size_t end = name.size();
  for (const char* unit : {"_dph", "_degc", "_hz", "_mg"}) end = std::min(end, name.find(unit));
  if (end == name.size() && end > 2 && name.compare(end - 2, 2, "_s") == 0) end -= 2;
  return in_plain_words(name.substr(0, end));
}
std::string value_text(const std::string& name, double value, const AxisResult& axis) {
  const std::string unit = unit_of(name, axis_unit(axis.axis));
  return in_digits(value, kSizeDigits) + (unit.empty() ? "" : " " + unit);
}

// "61 dph (time constant 320 s)": the size first, then the shape it is of.
std::string size_text(const Detectability& d, const AxisResult& axis, double times = 1) {
  std::string size; // the first of its numbers; the others are its shape
  std::vector<std::string> shape;
  for (const ParameterValue& p : d.smallest_detectable) {
    if (p.kind != EffectParameter::kNumber || (!size.empty() && p.number.value == 0)) continue;
    if (size.empty())
      size = value_text(p.name, times * p.number.value, axis);
    else
      shape.push_back(quantity(p.name) + " " + value_text(p.name, p.number.value, axis));
  }
  return size + (shape.empty() ? "" : " (" + joined(shape, ", ") + ")");
}
// Beyond it a size makes no sense: that of the parameter which is the size, as its effect takes it.
double largest_size(const std::string& name) {
  const std::vector<EffectParameter> parameters = find_effect(name).parameters();
  return parameters.empty() || parameters.front().kind != EffectParameter::kNumber
             ? kNoSize
             : std::min(kNoSize, parameters.front().hi);
}
std::string below_text(const std::string& name, const Detectability* d, const AxisResult& axis, double times = 1) {
  const std::string what = with_article(in_plain_words(name));
  if (!d || !(d->smallest * times < largest_size(name))) return what + " of any size";
  return what + " smaller than " + size_text(*d, axis, times);
}

bool is_of_pair(const Alike& pair, const std::string& a, const std::string& b) {
  return (pair.first == a && pair.second == b) || (pair.first == b && pair.second == a);
}
bool is_open(const SelectedEffect& e, const Alike& pair) {
  return e.set.size() > 1 && is_in_answer(e, pair.first) && is_in_answer(e, pair.second);
}

// What the advised profile would do for this answer, in words: from which size on it shows what these profiles hide, and which
// pairs it tells apart.
std::vector<std::string> gains_of_advised(const AxisResult& axis) {
  std::vector<std::string> out, shown, told;
  for (const Detectability* d : hidden_effects(axis)) {
    if (!d->column.empty()) continue;
    const Detectability* then = found_in(axis.with_advised, d->name);
    if (then && (then->is_notable || kMuchBetter * then->smallest < d->smallest) && then->smallest < kNoSize)
      shown.push_back(with_article(in_plain_words(d->name)) + " from " + size_text(*then, axis));
  }
  const std::vector<Alike>& still = axis.with_advised.indistinguishable;
  for (const Alike& pair : open_pairs(axis))
    if (found_in(axis.with_advised, pair.first) && std::none_of(still.begin(), still.end(), [&](const Alike& other) {
          return is_of_pair(other, pair.first, pair.second);
        }))
      told.push_back(in_plain_words(pair.first) + " from " + in_plain_words(pair.second));
  if (!shown.empty()) out.push_back("show " + joined(shown, ", "));
  if (!told.empty()) out.push_back("tell " + joined(told, ", "));
  return out;
}

// Of a column that the rate may follow: no temperature profile makes another quantity move.
std::string advice_on_column(const Detectability& d) {
  return "Column " + d.column +
         format(d.is_column_thermal ? " moves by %.3g within a log, but as the temperature does"
                                    : " hardly moves: by %.3g within a log at most",
                d.column_range) +
         "; whether the rate follows it cannot be seen. Vary it inside a run, apart from the temperature.";
}

std::string pairs_text(const AxisResult& axis) {
  std::vector<std::string> out;
  for (const Alike& pair : open_pairs(axis)) {
    const auto side = [&](const std::string& name) {
      return below_text(name, found_in(axis.identifiability, name), axis, pair.told_from);
    };
    out.push_back(side(pair.first) + " and " + side(pair.second));
  }
  return joined(out, "; ");
}

std::string step_for_temperature(const AxisResult& axis) {
  if (axis.campaign.is_temperature_steady)
    return "Record logs in which the temperature moves: in these it hardly does, so no thermal cause was looked for.";
  if (!axis.campaign.has_temperature)
    return "Record the temperature with the rates (column temp_degc): without it no thermal cause was looked for.";
  return "";
}

// "these logs", which the sentence is of.
const char* these_logs(const AxisResult& axis) {
  return axis.campaign.runs.size() == 1 ? "this log" : "these logs";
}

} // namespace

std::vector<const Detectability*> hidden_effects(const AxisResult& axis) {
  std::vector<const Detectability*> out;
  const auto& named = axis.study.selection.effects;
  for (const Detectability& d : axis.identifiability.effects)
    if (!d.is_notable &&
        std::none_of(named.begin(), named.end(), [&](const SelectedEffect& e) { return is_in_answer(e, d.name); }))
      out.push_back(&d);
  return out;
}
static std::vector<std::string> hidden_texts(const AxisResult& axis) {
  std::vector<std::string> out;
  for (const Detectability* d : hidden_effects(axis))
    if (d->column.empty()) out.push_back(below_text(d->name, d, axis));
  return out;
}
std::string hidden_text(const AxisResult& axis) {
  return joined(hidden_texts(axis), ", ");
}

std::vector<Alike> open_pairs(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  std::vector<Alike> out;
  for (const Alike& pair : axis.identifiability.indistinguishable) {
    const auto has_both = [&](const SelectedEffect& e) { return is_open(e, pair); };
    const bool has_no_name = s.effects.empty() && s.verdict == Verdict::kUnexplained;
    if (has_no_name || std::any_of(s.effects.begin(), s.effects.end(), has_both)) out.push_back(pair);
  }
  return out;
}

bool advised_profile_helps(const AxisResult& axis) {
  return axis.campaign.has_temperature && !gains_of_advised(axis).empty();
}

std::string constant_offsets() {
  return "Constant offsets (earth rate, attitude) are absorbed by the constant of each log and cannot be seen.";
}

std::vector<std::string> hardware_to_look_at(const AxisResult& axis) {
  std::vector<std::string> out;
  for (size_t i : reading_order(axis)) {
    const SelectedEffect& e = axis.study.selection.effects[i];
    if (is_note(axis, e) || e.doubt == Doubt::kSlowNoise || !e.term.effect) continue;
    std::vector<std::string> causes;
    for (const HardwareCause& cause : hardware_causes_of(axis, e)) causes.push_back(cause.what);
    if (!causes.empty())
      add_once("Look at the hardware (" + in_plain_words(e.term.effect->name()) + "): " + joined(causes, "; or ") + ".",
               &out);
  }
  return out;
}

std::vector<std::string> steps(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const auto is_undecided = [](const SelectedEffect& e) { return e.doubt == Doubt::kSlowNoise; };
  std::vector<std::string> out;
  if (const std::string step = step_for_temperature(axis); !step.empty()) out.push_back(step);
  for (const Detectability* d : hidden_effects(axis))
    if (!d->column.empty()) out.push_back(advice_on_column(*d));
  if (std::any_of(s.effects.begin(), s.effects.end(), is_undecided))
    out.push_back("Repeat the runs: with the same temperatures a cause comes back, slow noise does not.");
  if (advised_profile_helps(axis))
    out.push_back(
        "Record four runs of the advised profile, two of them mirrored (from the hottest temperature, down for "
        "up and up for down). They would " +
        joined(gains_of_advised(axis), ", and ") + ".");
  else if (axis.campaign.runs.size() < kFewRuns)
    out.push_back("Record at least four runs.");
  return out;
}

std::vector<std::string> limits(const AxisResult& axis) {
  std::vector<std::string> out;
  const std::vector<std::string> hidden = hidden_texts(axis);
  if (axis.campaign.runs.size() == 1)
    out.push_back("One log cannot show what differs from run to run.");
  else if (axis.campaign.runs.size() < kFewRuns)
    out.push_back("Fewer than four logs can hardly tell what differs from run to run from other causes.");
  const std::string longer = axis.campaign.has_temperature ? "" : " Longer logs would show smaller ones.";
  if (hidden.size() == 1)
    out.push_back(capitalised(hidden[0]) + " cannot be seen in " + these_logs(axis) + "." + longer);
  else if (!hidden.empty())
    out.push_back("Cannot be seen in " + std::string(these_logs(axis)) + ": " + joined(hidden, ", ") + "." + longer);
  if (const std::string alike = pairs_text(axis); !alike.empty())
    out.push_back(capitalised(these_logs(axis)) + " cannot tell apart " + alike + ".");
  return out;
}

std::vector<std::string> advice(const AxisResult& axis) {
  std::vector<std::string> out = steps(axis);
  for (const std::string& limit : limits(axis)) out.push_back(limit);
  out.push_back(constant_offsets());
  return out;
}

} // namespace imucal
