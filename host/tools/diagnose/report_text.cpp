// SPDX-License-Identifier: MIT
#include "diagnose/report_text.h"

#include <cmath>
#include <map>

#include "base/axis_unit.h"
#include "base/digits.h"
#include "diagnose/advice.h"
#include "diagnose/effect_words.h"
#include "diagnose/gap_words.h"
#include "diagnose/headline.h"
#include "diagnose/words.h"

namespace imucal {
namespace {

std::string parameter_text(const ParameterValue& p, const AxisResult& axis) {
  const char* unit = axis_unit(axis.axis);
  const size_t n_logs = axis.campaign.runs.size() + axis.campaign.left_out.size();
  if (p.kind == EffectParameter::kSteps) return steps_text(p.steps, n_logs > 1, unit);
  if (p.kind == EffectParameter::kText) return p.name + " " + p.text;
  const bool is_white_mg = p.name == "arw_deg_rt_h" && std::string(unit) == "mg";
  const double factor = is_white_mg ? 60 : 1;
  return (is_white_mg ? "white_mg_rt_hz" : name_in_unit(p.name, unit)) + " " +
         with_error(factor * p.number.value, factor * p.number.std_error);
}

std::string effect_text(const AxisResult& axis, const SelectedEffect& e) {
  std::string list;
  const bool is_shared = is_shared_noise(e); // what was measured first: the parameters are those of a simulation
  if (is_shared) list = e.statement;
  for (const ParameterValue& p : is_shared ? Parameters() : values_of(axis, e))
    list += (list.empty() ? "" : ", ") + parameter_text(p, axis);
  std::string out = (is_note(axis, e) ? "  note    " : "  effect  ") + name_of(e);
  if (e.is_family && e.term.effect && !list.empty()) out += " (as " + e.term.effect->name() + ")";
  out += list.empty() ? "" : ": " + list;
  out += has_evidence(e) ? " (evidence " + nats_text(e.evidence_nats) + " nats)\n" : "\n";
  if (const std::string words = in_words(axis, e); !words.empty()) out += "          " + words + "\n";
  for (const std::string& remark : remarks_on(axis, e))
    if (!is_shared || remark != e.statement) out += "          " + remark + "\n";
  return out;
}

std::string axis_text(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  std::string out = axis.axis + ": " + headline(axis) + "\n";
  if (!is_judged(axis)) {
    for (size_t i : reading_order(axis)) out += effect_text(axis, s.effects[i]); // what the recorder did
    return out;
  }
  if (s.verdict != Verdict::kNoGap) out += "  where   " + axis.where.sentence + "\n";
  for (size_t i : reading_order(axis)) out += effect_text(axis, s.effects[i]);
  if (const std::string held_out = held_out_statement(axis); !held_out.empty()) out += "  held out  " + held_out + "\n";
  if (!s.effects.empty() || s.verdict == Verdict::kUnexplained) out += "            left: " + remainder(axis) + "\n";
  for (const std::string& note : notes(axis)) out += "  note    " + note + "\n";
  return out;
}

// What is said of each axis, a line each: once for all of them, with their names where it is not of all.
std::string of_axes(const DiagnoseResult& result, std::vector<std::string> (*said_of)(const AxisResult&)) {
  std::vector<std::string> said;
  std::map<std::string, std::vector<std::string>> axes_of;
  size_t n_judged = 0;
  for (const AxisResult& axis : result.axes) {
    if (!is_judged(axis)) continue;
    ++n_judged;
    for (const std::string& line : said_of(axis)) add_once(line, &said), add_once(axis.axis, &axes_of[line]);
  }
  std::string text;
  for (const std::string& line : said) {
    if (line == constant_offsets()) continue; // said in the JSON
    const std::vector<std::string>& names = axes_of[line];
    text += "advice    " + (names.size() < n_judged ? joined(names, ", ") + ": " : "") + line + "\n";
  }
  return text;
}

} // namespace

std::string diagnosis_text(const DiagnoseResult& result) {
  std::string text;
  for (const AxisResult& axis : result.axes) text += axis_text(axis);
  text += of_axes(result, hardware_to_look_at) + of_axes(result, steps) + of_axes(result, limits);
  for (const std::string& warning : result.warnings) text += "warning: " + warning + "\n";
  return text;
}

} // namespace imucal
