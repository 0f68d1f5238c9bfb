// SPDX-License-Identifier: MIT
#include "diagnose/report_text.h"

#include <cmath>
#include <map>

#include "base/axis_unit.h"
#include "diagnose/advice.h"
#include "diagnose/effect_words.h"
#include "diagnose/gap_words.h"
#include "diagnose/headline.h"
#include "diagnose/words.h"

namespace imucal {
namespace {

std::string parameter_text(const ParameterValue& p, const AxisResult& axis) {
  char line[120];
  const char* unit = axis_unit(axis.axis);
  const size_t n_logs = axis.campaign.runs.size() + axis.campaign.left_out.size();
  if (p.kind == EffectParameter::kSteps) return steps_text(p.steps, n_logs > 1, unit);
  if (p.kind == EffectParameter::kText) return p.name + " " + p.text;
  const bool is_white_mg = p.name == "arw_deg_rt_h" && std::string(unit) == "mg";
  const double factor = is_white_mg ? 60 : 1;
  std::snprintf(line, sizeof line, "%s %.4g", is_white_mg ? "white_mg_rt_hz" : name_in_unit(p.name, unit).c_str(),
                factor * p.number.value);
  std::string out = line;
  if (std::isfinite(p.number.std_error)) {
    std::snprintf(line, sizeof line, " +- %.2g", factor * p.number.std_error);
    out += line;
  }
  return out;
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
  out += has_evidence(e) ? format(" (evidence %.1f nats)\n", e.evidence_nats) : "\n";
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

} // namespace

std::string diagnosis_text(const DiagnoseResult& result) {
  std::string text;
  for (const AxisResult& axis : result.axes) text += axis_text(axis);
  // What the profiles cannot tell, on a line each: once for all axes, with their names where it is not of all.
  std::vector<std::string> said;
  std::map<std::string, std::vector<std::string>> of_axes;
  size_t n_judged = 0;
  for (const AxisResult& axis : result.axes) {
    if (!is_judged(axis)) continue;
    ++n_judged;
    for (const std::string& line : advice(axis)) add_once(line, &said), add_once(axis.axis, &of_axes[line]);
  }
  for (const std::string& line : said)
    if (line != constant_offsets()) { // said in the JSON
      const std::vector<std::string>& names = of_axes[line];
      text += "advice    " + (names.size() < n_judged ? joined(names, ", ") + ": " : "") + line + "\n";
    }
  for (const std::string& warning : result.warnings) text += "warning: " + warning + "\n";
  return text;
}

} // namespace imucal
