// SPDX-License-Identifier: MIT
#include "diagnose/advice.h"

#include <algorithm>
#include <cmath>

#include "base/axis_unit.h"
#include "diagnose/words.h"

namespace imucal {

namespace {

constexpr double kNoSize = 1e6;     // sizes beyond are no sizes: nothing would show
constexpr double kMuchBetter = 1.5; // how many times smaller a size has to be for a profile to help
constexpr double kThreeDigits = 1000;
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

// "amplitude_dph 61 (tau_s 320)": the size first, then the shape it is of.
std::string size_text(const Detectability& d, const AxisResult& axis, double times = 1) {
  std::string size; // the first of its numbers; the others are its shape
  std::vector<std::string> shape;
  for (const ParameterValue& p : d.smallest_detectable) {
    if (p.kind != EffectParameter::kNumber || (!size.empty() && p.number.value == 0)) continue;
    const double value = size.empty() ? times * p.number.value : p.number.value;
    const std::string text =
        name_in_unit(p.name, axis_unit(axis.axis)) + format(std::fabs(value) < kThreeDigits ? " %.3g" : " %.0f", value);
    if (size.empty())
      size = text;
    else
      shape.push_back(text);
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
  if (!d || !(d->smallest * times < largest_size(name))) return name + " of any size";
  return name + " below " + size_text(*d, axis, times);
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
      shown.push_back(d->name + " from " + size_text(*then, axis));
  }
  const std::vector<Alike>& still = axis.with_advised.indistinguishable;
  for (const Alike& pair : open_pairs(axis))
    if (found_in(axis.with_advised, pair.first) && std::none_of(still.begin(), still.end(), [&](const Alike& other) {
          return is_of_pair(other, pair.first, pair.second);
        }))
      told.push_back(pair.first + " from " + pair.second);
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

void add_of_temperature(const AxisResult& axis, std::vector<std::string>* out) {
  if (axis.campaign.is_temperature_steady)
    out->push_back(
        "The temperature hardly moves: only effects that need none were looked for. To ask for thermal causes, "
        "record logs in which it moves.");
  else if (!axis.campaign.has_temperature)
    out->push_back(
        "No temperatures in the log: only effects that need none were looked for. Record the temperature with the "
        "rates (column temp_degc).");
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
std::string hidden_text(const AxisResult& axis) {
  std::vector<std::string> out;
  for (const Detectability* d : hidden_effects(axis))
    if (d->column.empty()) out.push_back(below_text(d->name, d, axis));
  return joined(out, ", ");
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

std::vector<std::string> advice(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const auto is_undecided = [](const SelectedEffect& e) { return e.doubt == Doubt::kSlowNoise; };
  std::vector<std::string> out;
  add_of_temperature(axis, &out);
  if (const std::string hidden = hidden_text(axis); !hidden.empty())
    out.push_back("These logs would not show " + hidden +
                  ": an answer without them is not an answer that they are absent." +
                  (axis.campaign.has_temperature ? "" : " Longer logs would show smaller ones."));
  for (const Detectability* d : hidden_effects(axis))
    if (!d->column.empty()) out.push_back(advice_on_column(*d));
  if (const std::string alike = pairs_text(axis); !alike.empty())
    out.push_back("These logs do not tell apart " + alike + ".");
  if (advised_profile_helps(axis))
    out.push_back(
        "Four runs of the advised profile, two of them mirrored (from the hottest temperature, down for up and up for "
        "down), would " +
        joined(gains_of_advised(axis), ", and ") + ".");
  if (std::any_of(s.effects.begin(), s.effects.end(), is_undecided))
    out.push_back("Repeat the runs: with the same temperatures a cause comes back, slow noise does not.");
  if (axis.campaign.runs.size() == 1)
    out.push_back("One log only: what differs from run to run cannot be seen; record at least four runs.");
  else if (axis.campaign.runs.size() < kFewRuns)
    out.push_back("Fewer than four runs: run_to_run changes can hardly be told from the other effects.");
  out.push_back(constant_offsets());
  return out;
}

} // namespace imucal
