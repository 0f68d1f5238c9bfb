// SPDX-License-Identifier: MIT
#include "diagnose/report.h"

#include <algorithm>
#include <cmath>

#include "base/axis_unit.h"
#include "base/units.h"
#include "diagnose/advice.h"
#include "diagnose/effect_words.h"
#include "diagnose/gap_words.h"
#include "diagnose/headline.h"
#include "diagnose/json_parts.h"
#include "diagnose/library_json.h"
#include "diagnose/plots_json.h"
#include "diagnose/words.h"

namespace imucal {
namespace {

const char* verdict_name(Verdict verdict) {
  switch (verdict) {
  case Verdict::kNoGap:
    return "no_gap";
  case Verdict::kExplained:
    return "explained";
  case Verdict::kPartlyExplained:
    return "partly_explained";
  case Verdict::kUnexplained:
    return "unexplained";
  }
  return "";
}

Json gap_json(const AxisResult& axis) {
  const std::string unit = axis_unit(axis.axis);
  const GapResult& g = axis.study.gap;
  Json own_jumps = Json::array(), stronger = Json::array();
  for (const Selection::Strength& noise : axis.study.selection.stronger_noise)
    stronger.push_back({{"log", noise.log}, {"times", noise.times}});
  for (const StepValue& jump : axis.study.selection.own_jumps)
    own_jumps.push_back({{"log", jump.log},
                         {"t_s", jump.t_s},
                         {"size_dph", jump.amplitude_dph.value},
                         {"size_error_dph", jump.amplitude_dph.std_error}});
  Json gap = {
      {"before", g.before},
      {"after", g.after},
      {"shrinkage", has_figure(axis) ? Json(g.shrinkage) : Json(nullptr)},
      {"ci95", has_figure(axis) ? Json{g.ci_lo, g.ci_hi} : Json(nullptr)},
      {"unit",
       unit + "^2: mean square of what the models leave in the noise-free mean of the held-out data, estimated"},
      {"method", held_out_text(g.method)},
      {"gain", g.gain()},
      {"gain_unit", "deviance per hour, held out"},
      {"hours", g.foretold.hours},
      {"gain_by_unit", g.gain_by_unit()},
      {"gain_mean_s", g.gain_mean_s},
      {"log_by_unit", g.foretold.log_by_unit},
      {"statement", held_out_statement(axis)},
      {"part_within_fitted_temperatures", g.minutes.part_within},
      {"remainder", remainder(axis)},
      {"jumps_of_held_out_logs", own_jumps},
      {"stronger_noise_of_held_out_logs", stronger},
      {"has_mean", g.has_mean},
      {"residual_mean_s", g.minutes.minute_s},
      {"residual_rms_dph",
       {{"before", number(g.minutes.has_residual() ? g.minutes.rms_before_dph : std::nan(""))},
        {"after", number(g.minutes.has_residual() ? g.minutes.rms_after_dph : std::nan(""))},
        {"noise", g.minutes.noise_rms_dph},
        {"from_run_to_run", g.minutes.run_to_run_rms_dph},
        {"noise_error", g.minutes.noise_error_dph},
        {"errors_of_fit", std::sqrt(g.minutes.fit_ms_dph2)},
        {"believed_noise", g.minutes.believed_rms_dph}}},
      {"dp2_distance_dph", {{"before", axis.dp2.before_dph}, {"after", axis.dp2.after_dph}}}};
  if (has_stand_in(axis)) gap["stand_in_shrinkage"] = g.shrinkage;
  return gap;
}

// How often draws of the noise alone gain so much, in any axis of the call; null where no draws set what was to be gained.
Json p_value(const Selection& s, const SelectedEffect& e, double rate) {
  const auto is_drawn = [](Form form) {
    return form == Form::kColumns || form == Form::kTemperature || form == Form::kRunRandom;
  };
  if (!has_evidence(e) || s.is_told_by_held_out || e.is_structural) return Json(nullptr);
  if (e.term.estimator && !is_drawn(e.term.form())) return Json(nullptr);
  return Json(
      std::min(1.0, rate * std::exp((s.chance.over_nats - std::max(0.0, e.evidence_nats)) / s.chance.scale_nats)));
}

// It has a mean that can be drawn through the rates: noise and what the recorder did have none.
bool has_curve(const SelectedEffect& e) {
  if (e.doubt == Doubt::kSlowNoise) return false;
  if (!e.term.estimator) return !e.term.effect;
  const Form form = e.term.form();
  return form != Form::kNoise && form != Form::kStructural && form != Form::kAxes;
}

Json effect_json(const AxisResult& axis, const SelectedEffect& e, double rate) {
  Json set = Json::array();
  for (const CandidateEvidence& c : e.set) set.push_back(evidence_json(c));
  const Parameters values = values_of(axis, e);
  Json entry = {{"name", name_of(e)},
                {"family", family_name(e.family)},
                {"parameters", parameters_json(values)},
                {"std_errors", std_errors_json(values)},
                {"evidence_nats", e.evidence_nats},
                {"is_weak", is_weak(e)},
                {"is_note", is_note(axis, e)},
                {"has_curve", has_curve(e)},
                {"rms_dph", number(e.rms_dph)},
                {"gain_nats", e.gain_nats},
                {"p_value", p_value(axis.study.selection, e, rate)},
                {"set", set},
                {"is_untested", e.is_untested},
                {"remarks", remarks_on(axis, e)},
                {"held_out_gain", number(2 * e.held_out_nats / std::max(1e-9, axis.study.gap.foretold.hours))}};
  if (const std::string words = in_words(axis, e); !words.empty()) entry["in_words"] = words;
  if (is_shared_noise(e)) entry["measured"] = e.statement;
  if (e.is_family && e.term.effect) entry["member"] = e.term.effect->name();
  if (e.term.effect && e.doubt != Doubt::kSlowNoise) {
    const EffectMeaning meaning = e.term.effect->meaning(values);
    entry["label"] = e.is_family ? family_label(e.family) : meaning.label;
    entry["hardware_causes"] = causes_json(hardware_causes_of(axis, e));
  }
  if (const std::string statement = statement_of(e); !statement.empty()) entry["statement"] = statement;
  return entry;
}

// Of an axis that was not judged.  Who reads the verdict alone must take it neither for clean nor for explained.
Json refused_json(const AxisResult& axis) {
  return {{"axis", axis.axis},
          {"unit", axis_unit(axis.axis)},
          {"verdict", verdict_name(Verdict::kUnexplained)},
          {"statement", statement(axis)},
          {"title", title(axis)},
          {"refused", why_refused(axis)},
          {"where", nullptr},
          {"effects", Json::array()},
          {"not_detectable_here", Json::array()},
          {"indistinguishable", Json::array()},
          {"open_pairs", Json::array()},
          {"advice", Json::array()},
          {"advised_profile", nullptr},
          {"notes", Json::array()},
          {"plots", {{"record", record_json(axis)}}},
          {"gap",
           {{"before", nullptr},
            {"after", nullptr},
            {"shrinkage", nullptr},
            {"ci95", nullptr},
            {"unit", std::string(axis_unit(axis.axis)) + "^2"},
            {"remainder", "not judged"},
            {"residual_rms_dph", {{"before", nullptr}, {"after", nullptr}}},
            {"dp2_distance_dph", {{"before", nullptr}, {"after", nullptr}}}}}};
}

Json answer_json(const AxisResult& axis, double rate) {
  if (!axis.refused.empty()) return refused_json(axis);
  const Selection& s = axis.study.selection;
  Json effects = Json::array(), hidden = Json::array(), alike = Json::array(), detectable = Json::array();
  for (const SelectedEffect& e : s.effects) effects.push_back(effect_json(axis, e, rate));
  if (s.cannot_judge) {
    Json out = refused_json(axis);
    out["effects"] = effects;
    return out;
  }
  const auto entry_of = [](const Detectability& d) {
    return Json{{"name", d.name}, {"smallest_detectable", parameters_json(d.smallest_detectable)}};
  };
  for (const Detectability& d : axis.identifiability.effects) detectable.push_back(entry_of(d));
  for (const Detectability* d : hidden_effects(axis)) hidden.push_back(entry_of(*d));
  for (const Alike& pair : axis.identifiability.indistinguishable) alike.push_back({pair.first, pair.second});
  Json pairs = Json::array();
  for (const Alike& pair : open_pairs(axis))
    pairs.push_back({{"names", {pair.first, pair.second}}, {"told_from_times", number(pair.told_from)}});
  const NoiseModel& noise = s.fitted_noise;
  const double white_noise_arw_deg_rt_h = arw_from_white_sigma(noise.white_sigma_dph);
  Json markov = Json::array();
  for (const Markov& m : noise.markov) markov.push_back({{"sigma_dph", m.sigma_dph}, {"tau_s", m.tau_s}});
  const bool is_advised = advised_profile_helps(axis);
  const double coldest_degc = axis.where.coldest_degc, hottest_degc = axis.where.hottest_degc;
  const Profile profile = separating_profile(coldest_degc, hottest_degc);
  return {
      {"axis", axis.axis},
      {"unit", axis_unit(axis.axis)},
      {"verdict", verdict_name(s.verdict)},
      {"statement", statement(axis)},
      {"title", title(axis)},
      {"is_weak", !s.effects.empty() && has_weak_causes_only(axis)},
      {"is_of_noise_alone", is_of_noise_alone(axis)},
      {"is_noise_estimated", !axis.is_believed},
      {"where", s.verdict == Verdict::kNoGap ? Json(nullptr) : where_json(axis)},
      {"effects", effects},
      {"reading_order", reading_order(axis)},
      {"not_detectable_here", hidden},
      {"smallest_detectable", detectable},
      {"indistinguishable", alike},
      {"open_pairs", pairs},
      {"advice", advice(axis)},
      {"notes", notes(axis)},
      {"noise", {{"arw_deg_rt_h", white_noise_arw_deg_rt_h}, {"markov", markov}, {"is_retuned", s.is_noise_retuned}}},
      {"threshold_nats", s.chance.threshold_nats},
      {"gap", gap_json(axis)},
      {"plots", plots_json(axis)},
      {"seconds", axis.seconds},
      {"advised_profile", is_advised ? to_json(profile) : Json(nullptr)},
      {"advised_profile_mirrored",
       is_advised ? to_json(mirrored(profile, coldest_degc, hottest_degc)) : Json(nullptr)}};
}

Json axis_json(const AxisResult& axis, double rate) {
  Json out = answer_json(axis, rate), left_out = Json::array();
  for (const UnusedLog& log : axis.left_out) left_out.push_back({{"log", log.path}, {"why", log.why}});
  if (!axis.left_out.empty()) out["left_out_logs"] = left_out;
  return out;
}

} // namespace

Json diagnosis_json(const DiagnoseOptions& options, const DiagnoseResult& result) {
  Json axes = Json::array();
  bool from_cache = true;
  for (const AxisResult& axis : result.axes) {
    axes.push_back(axis_json(axis, options.false_alarm_rate));
    from_cache = from_cache && (axis.is_calibration_cached || !axis.refused.empty());
  }
  return {{"imucal_diagnosis", 1},
          {"version", IMUCAL_VERSION},
          {"model", result.has_model ? Json(options.model_path) : Json(nullptr)},
          {"logs", options.logs},
          {"held_out_logs", options.held_out},
          {"false_alarm_rate", options.false_alarm_rate},
          {"seed", options.seed},
          {"calibration", {{"nulls", options.nulls}, {"from_cache", from_cache}, {"seconds", result.calibration_s}}},
          {"warnings", result.warnings},
          {"library", library_json()},
          {"axes", axes}};
}

std::vector<std::string> unanswered(const DiagnoseResult& result) {
  std::vector<std::string> out;
  for (const AxisResult& axis : result.axes)
    if (!is_judged(axis)) out.push_back(axis.axis + ": " + headline(axis));
  return out;
}

} // namespace imucal
