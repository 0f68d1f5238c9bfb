// SPDX-License-Identifier: MIT
// What diagnose says in words: every line agrees with the others and with the figures.
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <string>

#include "diagnose/headline.h"
#include "diagnose/report.h"
#include "diagnose/report_text.h"
// After the others: it defines a macro `fail`.
extern "C" {
#include <cmocka.h>
}

using namespace imucal;

// An answer of one axis with one effect, made by hand.
static SelectedEffect effect_of(const char* name, double evidence_nats) {
  SelectedEffect effect;
  effect.term.effect = &find_effect(name), effect.term.estimator = effect.term.effect->estimator();
  effect.term.fixed_parameters = {{"amplitude_dph", 3.0}}; // no campaign, from which they would be computed
  effect.family = effect.term.effect->family();
  effect.evidence_nats = evidence_nats, effect.gain_nats = evidence_nats + 6;
  effect.held_out_nats = kPredictsNothing;
  effect.set = {{effect.term.effect, nullptr, false, effect.family, effect.gain_nats, 6}};
  return effect;
}
static CandidateEvidence free_shape(Family family) {
  for (const Reference& shape : free_shapes())
    if (shape.family == family) return {nullptr, &shape, false, family, 20, 0};
  return {};
}
static std::string said(Verdict verdict, std::vector<SelectedEffect> effects, std::vector<CandidateEvidence> remainders,
                        const GapResult& gap = {}) {
  DiagnoseResult result;
  result.axes.resize(1);
  AxisResult& axis = result.axes[0];
  axis.axis = "gx_dph", axis.where.sentence = "somewhere";
  axis.study.selection.verdict = verdict;
  axis.study.selection.effects = std::move(effects), axis.study.selection.remainders = std::move(remainders);
  axis.study.gap = gap;
  return diagnosis_text(result);
}
// The same as JSON.
static Json told(const Selection& selection, double false_alarm_rate = 0.01) {
  DiagnoseResult result;
  result.axes.resize(1);
  AxisResult& axis = result.axes[0];
  axis.axis = "gx_dph";
  axis.campaign.runs.resize(1), axis.campaign.has_temperature = false;
  Selection& s = axis.study.selection;
  s.verdict = selection.verdict, s.effects = selection.effects, s.before = selection.before, s.after = selection.after;
  s.remainders = selection.remainders, s.dropped = selection.dropped, s.chance = selection.chance;
  axis.nominal_fit.residual.resize(1), axis.plain_fit.residual.resize(1), axis.final_fit.residual.resize(1);
  DiagnoseOptions options;
  options.false_alarm_rate = false_alarm_rate;
  return diagnosis_json(options, result)["axes"][0];
}
// The pictures of one axis whose answer leaves the rates as they are.
static Json plots_of(const Log& log) {
  DiagnoseResult result;
  result.axes.resize(1);
  AxisResult& axis = result.axes[0];
  axis.axis = "gx_dph";
  axis.campaign = make_campaign({log}, "gx_dph", {});
  axis.nominal_fit.residual = axis.plain_fit.residual = axis.final_fit.residual = rates(axis.campaign);
  axis.nominal_fit.e = axis.plain_fit.e = axis.final_fit.e = rates(axis.campaign);
  return diagnosis_json({}, result)["axes"][0]["plots"];
}
// A second of a million dph is no part of a minute's mean, before or after.
static void test_means_that_are_drawn_hold_no_hit(void**) {
  Log log;
  log.axes.resize(1);
  log.axes[0].name = "gx_dph";
  for (int k = 0; k < 600; ++k) {
    log.t_s.push_back(k + 1), log.temp_degc.push_back(20 + 0.05 * k);
    log.axes[0].rate_dph.push_back(100 + (k % 7 - 3) * 10 + (k == 345 ? 1e6 : 0));
  }
  const Json drawn = plots_of(log)["residual"];
  assert_true(drawn["n_hits"] == Json(1));
  assert_int_equal(drawn["rate_dph"].size(), 10);
  for (const char* key : {"rate_dph", "before_dph", "after_dph"})
    for (const Json& mean : drawn[key]) assert_true(std::fabs(static_cast<double>(mean) - 100) < 2);
}

// An hour without seconds: no mean is of both sides of it, and what is at its edge is not lost.
static void test_means_that_are_drawn_do_not_go_over_a_hole(void**) {
  Log log;
  log.axes.resize(1);
  log.axes[0].name = "gx_dph";
  for (int k = 0; k < 5000; ++k) {
    if (k >= 645 && k < 4245) continue;
    log.t_s.push_back(k + 1), log.temp_degc.push_back(20 + 0.01 * k);
    log.axes[0].rate_dph.push_back((k < 645 ? 100 : 300) + (k % 7 - 3) * 10);
  }
  const Json plots = plots_of(log);
  const Json& drawn = plots["residual"];
  assert_int_equal(drawn["rate_dph"].size(),
                   11 + 12); // 645 s: ten minutes and 45 s; 755 s: twelve minutes, 35 s at the end are not kept
  for (size_t k = 0; k < drawn["rate_dph"].size(); ++k) {
    const double t_s = static_cast<double>(drawn["t_s"][k]), mean_dph = static_cast<double>(drawn["rate_dph"][k]);
    assert_true(std::fabs(mean_dph - (t_s < 700 ? 100 : 300)) < 3);
  }
  // Temperatures that were passed in the hole alone have no seconds, and no variance of 0 standard errors.
  const Json& z = plots["gap_map"]["z"][0];
  size_t n_empty = 0;
  for (const Json& cell : z) n_empty += cell.is_null();
  assert_true(n_empty >= 6 && n_empty < z.size());
}

static size_t count(const std::string& text, const std::string& part) {
  size_t n = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++n;
  return n;
}
static void assert_has(const std::string& text, const char* part) {
  if (count(text, part) == 0) fail_msg("\"%s\" is not in:\n%s", part, text.c_str());
}
static void assert_is(const Json& number, double value) {
  assert_true(number.is_number());
  if (std::fabs(double(number) / value - 1) > 1e-12) fail_msg("%.15g is not %.15g", double(number), value);
}
static void assert_lacks(const std::string& text, const char* part) {
  if (count(text, part) > 0) fail_msg("\"%s\" is in:\n%s", part, text.c_str());
}

// What was rejected is a name; what tests still see is none, and is not said to be rejected.
static void test_what_is_left_is_not_called_rejected(void**) {
  const CandidateEvidence lag{&find_effect("thermal_lag"), nullptr, false, Family::kThermalMemory, 20, 6};
  Selection s;
  s.verdict = Verdict::kPartlyExplained;
  s.effects = {effect_of("white_noise_vs_temperature", 40)}, s.remainders = {lag};
  s.before.resize(2), s.after.resize(2);
  s.after[0] = {Rest::kVarianceOverTemperature, 5, 6}, s.after[1] = {Rest::kSuddenChanges, 4, 6};
  assert_string_equal(
      told(s)["gap"]["remainder"].text().c_str(),
      "sudden changes of the bias; more of the kind that was found: noise of a strength that depends on temperature; "
      "a noise has no mean to predict.  Considered and rejected: thermal_lag");
  s.after[0].evidence_nats = s.after[1].evidence_nats = -1, s.effects.clear();
  assert_string_equal(told(s)["gap"]["remainder"].text().c_str(), "considered and rejected: thermal_lag");
}

static void test_a_family_that_is_told_is_in_the_headline(void**) {
  SelectedEffect open = effect_of("higher_order_polynomial", 60);
  open_shape(&open);
  const CandidateEvidence shape = free_shape(Family::kFunctionOfTemperature);
  const std::string text = said(Verdict::kUnexplained, {open}, {shape, shape});
  assert_has(text, "a cause of the family function_of_temperature");
  assert_lacks(text, "no known effect explains");
  // The member may be the very cause: that no member has the shape is more than is known.
  assert_lacks(text, "no effect of the library");
  assert_int_equal(count(text, "would follow the logs more closely"), 1);
}

// "No member is told" would not agree with a member that the set lists alone.
static void test_a_family_is_told_with_what_is_open(void**) {
  const auto said_of = [](SelectedEffect effect) { return said(Verdict::kUnexplained, {std::move(effect)}, {}); };
  SelectedEffect open = effect_of("higher_order_polynomial", 60);
  open_shape(&open);
  assert_has(said_of(open), "; a free shape of it fits better than any member");
  assert_lacks(said_of(open), "no member of it is told");
  SelectedEffect loop = effect_of("thermal_hysteresis", 60);
  open_loop(&loop);
  assert_has(said_of(loop), "; the states in which runs began are seen, a loop is not");
  SelectedEffect alone = effect_of("thermal_hysteresis", 60);
  open_member(&alone);
  assert_has(said_of(alone), "; of its members only thermal_hysteresis comes near");
  SelectedEffect two = alone;
  two.set.push_back({&find_effect("thermal_lag"), nullptr, false, alone.family, 50, 6});
  assert_has(said_of(two), "; no member of it is told by these logs");
}

// What slow noise would gain in its place is no evidence for a memory.
static void test_a_family_is_worth_its_best_member(void**) {
  SelectedEffect family = effect_of("thermal_hysteresis", 2);
  open_member(&family);
  family.set.push_back({&find_effect("thermal_lag"), nullptr, false, Family::kThermalMemory, 11, 6});
  family.set.push_back({&find_effect("rate_random_walk"), nullptr, false, Family::kSlowNoise, 66, 6});
  raise_family(&family);
  assert_true(family.evidence_nats == 5);
  assert_true(family.gain_nats == 11);
}

static void test_a_name_that_is_left_is_nearest_in_the_headline(void**) {
  const std::string text = said(Verdict::kUnexplained, {}, {effect_of("thermal_hysteresis", 60).set.front()});
  assert_has(text, "nearest comes thermal_hysteresis");
  assert_lacks(text, "no known effect explains");
  assert_has(said(Verdict::kUnexplained, {}, {free_shape(Family::kThermalMemory)}),
             "a gap that no known effect explains");
}

static void test_a_name_with_little_evidence_is_marked_as_weak(void**) {
  const std::string weak = said(Verdict::kExplained, {effect_of("warm_up", 1.1)}, {});
  assert_has(weak, "a gap, weakly explained");
  assert_has(weak, "weak evidence, odds of 3.0 to 1: confirm it");
  const std::string strong = said(Verdict::kExplained, {effect_of("warm_up", 3.1)}, {});
  assert_has(strong, "a gap, explained: warm_up\n");
  assert_lacks(strong, "weak evidence");
  const std::string beside = said(Verdict::kExplained, {effect_of("thermal_lag", 90), effect_of("warm_up", 1.1)}, {});
  assert_has(beside, "a gap, explained: thermal_lag, warm_up (weak)\n");
  assert_int_equal(count(beside, "weak evidence"), 1);
}

// Slow noise and a repeatable cause that does as well: no gain of one over the other, so nothing that is weak.
// The partner of common noise, what a structural detector saw, why a family stays open: as in the JSON.
static void test_a_statement_is_printed_in_the_place_of_the_doubt(void**) {
  SelectedEffect shared = effect_of("common_mode", 30);
  shared.statement = "noise shared with gy_dph: correlation 0.50 from second to second";
  shared.term.fixed_parameters = {{"correlation", 1.0}, {"sigma_dph", 46.68}};
  const std::string both = said(Verdict::kExplained, {shared}, {});
  // What was measured, once and first; what a simulation needs is said to be that.
  assert_has(both, "effect  common_mode: noise shared with gy_dph: correlation 0.50");
  assert_int_equal(count(both, "noise shared with"), 1);
  assert_has(both, "a simulation gets that from white noise added to each axis: correlation 1, sigma_dph 46.7");
  SelectedEffect teeth = effect_of("telegraph_noise", 30);
  open_member(&teeth);
  const char* const doubt = "the logs tell the family of the cause, but not which member it is";
  assert_has(said(Verdict::kExplained, {teeth}, {}), doubt);
  teeth.statement = "only the family is known: it jumps one way more than the other, as teeth do";
  const std::string text = said(Verdict::kExplained, {teeth}, {});
  assert_has(text, "as teeth do");
  assert_lacks(text, doubt);
}

static void test_an_undecided_answer_has_no_evidence(void**) {
  SelectedEffect open;
  open.family = Family::kSlowNoise, open.is_family = true, open.doubt = Doubt::kSlowNoise;
  open.set = {{nullptr, nullptr, true, Family::kSlowNoise, 0, 0}, effect_of("warm_up", 1).set.front()};
  const std::string text = said(Verdict::kPartlyExplained, {open}, {});
  assert_has(text, "effect  slow_noise\n");
  assert_lacks(text, "evidence");
  assert_int_equal(count(text, "explain these logs equally well"), 1);
  assert_has(text, "cannot be told from: warm_up");
}

static void test_other_noise_parameters_beside_a_weak_name_do_not_make_it_strong(void**) {
  const std::string text =
      said(Verdict::kExplained, {effect_of("warm_up", 0.1), effect_of("noise_parameters", 9000)}, {});
  assert_has(text, "a gap, weakly explained");
  assert_has(said(Verdict::kExplained, {effect_of("noise_parameters", 9000)}, {}),
             "a gap, explained: noise_parameters\n");
}

// Text, JSON and page say one thing: what the JSON holds is what is printed.
static void test_the_json_holds_what_is_printed(void**) {
  Selection s;
  s.verdict = Verdict::kExplained, s.effects = {effect_of("warm_up", 1.1)};
  s.effects[0].is_untested = true;
  s.effects[0].set.push_back(effect_of("thermal_lag", 1).set.front());
  const std::string text = said(s.verdict, s.effects, {});
  const Json axis = told(s);
  assert_has(text, axis["statement"].text().c_str());
  assert_string_equal(axis["title"].text().c_str(), "gap, weakly explained");
  assert_true(axis["is_weak"] == Json(true));
  const Json& remarks = axis["effects"][0]["remarks"];
  assert_int_equal(remarks.size(), 3);
  for (size_t i = 0; i < remarks.size(); ++i) assert_has(text, remarks[i].text().c_str());
  assert_true(axis["effects"][0]["has_curve"] == Json(true));
  for (const char* name : {"flicker_noise", "quantization", "common_mode"}) {
    Selection noise;
    noise.verdict = Verdict::kExplained, noise.effects = {effect_of(name, 10)};
    assert_true(told(noise)["effects"][0]["has_curve"] == Json(false));
  }
  s.effects[0].doubt = Doubt::kSlowNoise, s.verdict = Verdict::kPartlyExplained;
  assert_string_equal(told(s)["title"].text().c_str(), "gap, noise or cause open");
  // Noise that was estimated from the very logs, and nothing beyond it: no model says that there is a gap.
  s.effects[0].gain_nats = s.effects[0].evidence_nats = 0;
  assert_string_equal(told(s)["title"].text().c_str(), "noise or cause open");
  assert_lacks(said(s.verdict, s.effects, {}), "a gap");
}

static void test_the_sign_of_a_lag_is_told(void**) {
  Selection s;
  s.verdict = Verdict::kExplained, s.effects = {effect_of("thermal_lag", 20)};
  Parameters& tau = s.effects[0].term.fixed_parameters;
  tau = {{"tau_s", 120.0}};
  const std::string remark = "the thermometer lags the gyro: its time constant is told as a negative one";
  assert_lacks(said(s.verdict, s.effects, {}), remark.c_str());
  Json effect = told(s)["effects"][0];
  assert_string_equal(effect["label"].text().c_str(), find_effect("thermal_lag").label().c_str());
  assert_has(effect["hardware_causes"][1]["what"].text(), "thermal mass or poor contact");
  tau = {{"tau_s", -120.0}};
  assert_has(said(s.verdict, s.effects, {}), ("          " + remark + "\n").c_str());
  effect = told(s)["effects"][0];
  assert_string_equal(effect["label"].text().c_str(), "the thermometer lags the gyro's temperature");
  assert_has(effect["hardware_causes"][0]["what"].text(), "the thermometer is slow");
}

// What adds most heads the answer; rounding far below the noise is a note.
static void test_findings_stand_in_the_order_of_what_they_add(void**) {
  SelectedEffect lattice = effect_of("quantization", 9000), small = effect_of("warm_up", 50),
                 large = effect_of("thermal_lag", 9);
  lattice.is_structural = true, lattice.rms_dph = 0.5, small.rms_dph = 20, large.rms_dph = 80;
  DiagnoseResult result;
  result.axes.resize(1);
  AxisResult& axis = result.axes[0];
  axis.axis = "gx_dph";
  Selection& s = axis.study.selection;
  s.verdict = Verdict::kExplained, s.white_dph = 140;
  s.effects = {lattice, small, large};
  std::string text = diagnosis_text(result);
  assert_has(text, "gx_dph: a gap, explained: thermal_lag, warm_up\n");
  assert_has(text, "  note    quantization");
  assert_has(text, "a small part of the noise: 0.5 of 140.0 dph from second to second");
  assert_lacks(text, "the steps are wide beside the noise");
  assert_true(text.find("effect  thermal_lag") < text.find("effect  warm_up"));
  assert_true(text.find("effect  warm_up") < text.find("note    quantization"));
  s.effects = {lattice, effect_of("warm_up", 1.1)};
  assert_has(diagnosis_text(result), "a gap, weakly explained: warm_up\n");
  s.effects[0].rms_dph = 60; // more than a twentieth of the variance
  assert_has(diagnosis_text(result), "gx_dph: a gap, explained: ");
  assert_has(diagnosis_text(result), "effect  quantization");
  // Notes alone are no gap, and no part of the headline.
  s.effects.resize(1), s.effects[0].rms_dph = 0.5, s.verdict = Verdict::kNoGap;
  axis.is_believed = true;
  assert_has(diagnosis_text(result), "gx_dph: no gap that these logs can show\n");
  assert_has(diagnosis_text(result), "  note    quantization");
  s.verdict = Verdict::kUnexplained;
  assert_has(diagnosis_text(result), "gx_dph: a gap that no known effect explains\n");
}

// What was not asked stands in the headline; what the profiles hide is said last, in words, and not there.
static void test_a_healthy_axis_says_what_was_not_asked_and_last_what_is_hidden(void**) {
  DiagnoseResult result;
  result.axes.resize(1);
  AxisResult& axis = result.axes[0];
  axis.axis = "gx_dph", axis.is_believed = true;
  axis.campaign.runs.resize(1);
  axis.study.selection.verdict = Verdict::kNoGap;
  Detectability warm;
  warm.name = "warm_up", warm.is_notable = false, warm.smallest = 87.4;
  warm.smallest_detectable = {{"amplitude_dph", 87.4}, {"tau_s", 320.0}};
  axis.identifiability.effects = {warm};
  const char* const seen_last = "A warm up smaller than 87 dph (time constant 320 s) cannot be seen in this log.\n";
  std::string text = diagnosis_text(result);
  assert_has(text, "gx_dph: no gap that these logs can show\nadvice    Record at least four runs");
  assert_has(text, seen_last);
  assert_true(text.find(seen_last) + std::string(seen_last).size() == text.size());
  axis.nominal_fit.residual.resize(1), axis.plain_fit.residual.resize(1), axis.final_fit.residual.resize(1);
  assert_has(statement(axis),
             "no gap that these logs can show; not detectable on these profiles: a warm up smaller than 87 dph");
  assert_true(!is_of_noise_alone(axis));
  axis.is_believed = false;
  assert_has(diagnosis_text(result),
             "can show; the noise was estimated from these logs, so slow waves in them count as noise");
  axis.campaign.has_temperature = false;
  text = diagnosis_text(result);
  assert_has(text, "gx_dph: only noise was judged, and it shows no gap: these logs have no temperatures");
  assert_has(text, "\nadvice    Record the temperature with the rates (column temp_degc)");
  const Json told_axis = diagnosis_json({}, result)["axes"][0];
  assert_string_equal(told_axis["title"].text().c_str(), "only noise judged");
  assert_true(told_axis["is_of_noise_alone"] == Json(true) && told_axis["is_noise_estimated"] == Json(true));
  axis.axis = "ax_mg", axis.campaign.is_temperature_steady = true;
  assert_has(diagnosis_text(result), "A warm up smaller than 87 mg");
  assert_has(diagnosis_text(result), "the temperature hardly moves");
}

// Hardware first; the loop by its branches, the error in two digits.
static void test_a_named_cause_is_followed_by_the_hardware_to_look_at(void**) {
  SelectedEffect loop = effect_of("thermal_hysteresis", 37.14);
  loop.term.fixed_parameters = {{"amplitude_dph", Measured{-75.594, 2.31}}, {"width_degc", Measured{4.906, 0.19}}};
  const std::string text = said(Verdict::kExplained, {loop}, {});
  assert_has(text, "amplitude_dph -75.6 +- 2.3, width_degc 4.91 +- 0.19 (evidence 37 nats)\n");
  assert_has(text, "          the branch of rising temperature is higher, by up to 151.2 +- 4.6 dph\n");
  assert_has(text, "advice    Look at the hardware (thermal hysteresis): stress of die attach");
  assert_true(text.find("Look at the hardware") < text.find("Record at least four runs"));
  loop.term.fixed_parameters = {{"amplitude_dph", Measured{30, 2}}};
  assert_has(said(Verdict::kExplained, {loop}, {}),
             "the branch of falling temperature is higher, by up to 60.0 +- 4.0 dph");
  loop.term.fixed_parameters = {{"amplitude_dph", Measured{30}}, {"width_degc", Measured{1.5}}};
  loop.only_ratio = OnlyRatio{{20.04, 0.61}, 1.234};
  const std::string only = said(Verdict::kExplained, {loop}, {});
  assert_has(only, "amplitude_dph 30.00, width_degc 1.500 (");
  assert_has(only, "the branch of falling temperature is higher\n");
  assert_has(
      only,
      "amplitude/width = 20.04 +- 0.61 dph/degC: the width, at least 1.2 degC, is not seen in logs that go one way");
  SelectedEffect jumps = effect_of("bias_step", 50);
  jumps.term.fixed_parameters = {{"steps", std::vector<StepValue>{{0, 7001.5, Measured{-187.3, 7.2}}}}};
  assert_has(said(Verdict::kExplained, {jumps}, {}), "bias_step: -187.3 +- 7.2 dph at 7001.5 s (");
}

// An answer with a figure of the held-out data.
static GapResult gap_of(double shrinkage, double lo, double hi) {
  GapResult gap;
  gap.has_mean = true, gap.shrinkage = shrinkage, gap.ci_lo = lo, gap.ci_hi = hi;
  gap.minutes.rms_before_dph = 260, gap.minutes.rms_after_dph = 70, gap.minutes.noise_rms_dph = 12;
  return gap;
}
// Steps of 100 dph on noise of 30 dph: (100 / pi) exp(-2 pi^2 0.09) = 5.4 dph.
static void test_wide_steps_are_told_to_make_curves(void**) {
  DiagnoseResult result;
  result.axes.resize(1);
  AxisResult& axis = result.axes[0];
  axis.axis = "gx_dph";
  Selection& s = axis.study.selection;
  SelectedEffect lattice = effect_of("quantization", 100);
  lattice.is_structural = true, lattice.rms_dph = 100 / std::sqrt(12.0);
  s.verdict = Verdict::kExplained, s.effects = {lattice};
  s.white_dph = std::hypot(30, lattice.rms_dph);
  assert_has(diagnosis_text(result), "by themselves they make a curve of up to 5.4 dph over the rate");
  s.white_dph = std::hypot(45, lattice.rms_dph);
  assert_lacks(diagnosis_text(result), "by themselves they make a curve");
}

static void test_figures_of_the_held_out_data_agree_with_the_words(void**) {
  const std::vector<SelectedEffect> ramp = {effect_of("rate_ramp", 20)};
  const std::string part = said(Verdict::kExplained, ramp, {}, gap_of(0.92, 0.91, 0.93));
  assert_has(part, "the gap shrinks by 92 % (95 %: 91 to 93;");
  assert_has(part, "left: 8 % of the gap on data that were not fitted");
  assert_has(said(Verdict::kExplained, ramp, {}, gap_of(0.99, 0.95, 1)), "left: nothing detectable");
  assert_has(said(Verdict::kPartlyExplained, ramp, {}, gap_of(-0.3, -0.4, -0.2)),
             "the gap grows by 30 % (95 %: 20 to 40;");
  assert_has(said(Verdict::kPartlyExplained, ramp, {}, gap_of(-1, -1, -1)), "the gap grows by more than 100 %");
  const std::string hidden = said(Verdict::kExplained, ramp, {}, gap_of(0.8, 0.2, 1));
  assert_has(hidden, "how far the gap shrinks is hidden by noise (95 %: 20 to 100 %;");
  assert_lacks(hidden, "shrinks by");
}

// Where nothing that is named foretells a mean, it is said why there is no figure, and what the seconds gain.
static void test_it_is_said_why_there_is_no_figure(void**) {
  GapResult gap;
  gap.gain_of_seconds_by_unit = {180, 240}, gap.foretold.hours = 4.8;
  const auto text_of = [&](const char* name) { return said(Verdict::kExplained, {effect_of(name, 20)}, {}, gap); };
  assert_has(text_of("sinusoid"), "held out  how far the gap shrinks is not known: a tone has a phase of its own in "
                                  "every log; the held-out seconds are likelier "
                                  "by 210 nats in 4.8 h\n");
  assert_has(text_of("outliers"), "how far the gap shrinks is not known: noise predicts how far rates scatter, not "
                                  "where they are; the held-out seconds are");
  gap.gain_of_seconds_by_unit = {-2, -4};
  assert_has(text_of("outliers"), "the held-out seconds are less likely by 3 nats in 4.8 h");
  gap.gain_of_seconds_by_unit.clear();
  assert_has(text_of("bias_step"),
             "held out  how far the gap shrinks is not known: jumps in time are of their logs alone\n");
  SelectedEffect steps = effect_of("quantization", 20);
  steps.is_structural = true;
  assert_has(said(Verdict::kExplained, {steps}, {}, {}),
             "how far the gap shrinks is not known: what was done to the samples is no part of the mean\n");
  assert_has(said(Verdict::kUnexplained, {}, {}, {}),
             "how far the gap shrinks is not known: nothing is named that predicts the mean of other data\n");
  assert_lacks(said(Verdict::kNoGap, {}, {}, {}), "held out");
}

// Errors that one fit may have are not told beside a smaller residual as if they were in it; and where the residuals show another
// figure than the one that is told, it stands beside them.
static void test_the_residuals_agree_with_what_is_told_of_them(void**) {
  GapResult gap = gap_of(0.89, 0.82, 0.98);
  gap.method = HeldOut::kQuarters;
  gap.minutes.rms_before_dph = 466.1, gap.minutes.rms_after_dph = 208, gap.minutes.noise_rms_dph = 63.8;
  gap.minutes.fit_ms_dph2 = 690.1 * 690.1;
  const auto text = [&] { return said(Verdict::kPartlyExplained, {effect_of("rate_ramp", 20)}, {}, gap); };
  assert_has(text(), "466.1 -> 208.0 dph (82 % less above the noise), noise alone 63.8, the rest no more than errors "
                     "of the fit (690.1 "
                     "expected)\n");
  gap.minutes.fit_ms_dph2 = 150 * 150;
  assert_has(text(), "noise alone 63.8, errors of the fit 150.0\n");
  gap.minutes.rms_after_dph = 160; // 90 %
  assert_has(text(), "466.1 -> 160.0 dph, noise alone 63.8, errors of the fit 150.0\n");
}

// A noise that leaves more than its mean figure says whether so many logs do so by chance.
static void test_what_a_noise_leaves_is_told_with_its_scatter(void**) {
  GapResult gap;
  gap.minutes.rms_before_dph = gap.minutes.rms_after_dph = 110.6, gap.minutes.noise_rms_dph = 80;
  gap.minutes.believed_rms_dph = 80, gap.minutes.noise_error_dph = 0.5 * 80 * std::sqrt(2.0 / 20);
  const auto text = [&] { return said(Verdict::kExplained, {effect_of("flicker_noise", 20)}, {}, gap); };
  assert_has(text(),
             "these logs show 110.6; with the noise that was found 80.0 is expected, 55.4 to 104.6 in 95 of 100 such "
             "logs\n"); // chi2 of 20: 9.591, 34.170
  gap.minutes.fit_ms_dph2 = 60 * 60;
  assert_has(text(), "with the noise that was found and errors of the fit 100.0 is expected, ");
  gap.minutes.noise_error_dph = std::nan("");
  assert_has(text(), "and errors of the fit 100.0 is expected\n");
}
// Where the polynomial beside slow noise is what is off, that is said of it, and not of what is named.
static void test_a_name_is_not_blamed_for_the_polynomial_beside_it(void**) {
  GapResult gap = gap_of(0.1, -0.9, 0.9);
  gap.minutes.rms_before_dph = 17, gap.minutes.rms_after_dph = 21;
  const auto text = [&] { return said(Verdict::kPartlyExplained, {effect_of("thermal_lag", 20)}, {}, gap); };
  gap.foretold.growth = {{0.93, 0}};
  assert_has(text(), "the predicted mean is further from the held-out rates than before, as far as their noise tells");
  gap.minutes.is_before_least_squares = true;
  assert_has(text(), "what is named brings that one nearer");
  assert_lacks(text(), "further from");
  gap.foretold.growth = {{1.05, 1}};
  assert_has(text(), "the predicted mean is further from the held-out rates than before, as far as their noise tells");
}

// Logs at other temperatures than all others, each held out in turn: an extrapolated polynomial is off by anything.
static void test_an_extrapolated_residual_is_not_told(void**) {
  GapResult far = gap_of(0.5, 0.4, 0.6);
  far.minutes.rms_before_dph = far.minutes.rms_after_dph = 4e8, far.minutes.part_within = 0,
  far.minutes.noise_error_dph = 1;
  assert_true(far.minutes.errors_above_noise() == 0);
  for (const char* name : {"rate_ramp", "flicker_noise"}) {
    const std::string text = said(Verdict::kPartlyExplained, {effect_of(name, 20)}, {}, far);
    assert_has(text, "how far the gap shrinks is not known: no rates at temperatures that were fitted");
    assert_lacks(text, "400000000");
    assert_lacks(text, "times what the noise alone");
  }
}

// The rate of the tests of what is left is not that of the names.
static void test_p_values_have_the_rate_of_their_thresholds(void**) {
  Selection s;
  s.verdict = Verdict::kPartlyExplained;
  s.before = {{Rest::kSpectrum, 2, -std::log(1e-3)}, {Rest::kLine, 1, 20, 4096}};
  s.after = s.before;
  SelectedEffect ramp = effect_of("rate_ramp", 2), noise = effect_of("flicker_noise", 2);
  SelectedEffect jump = effect_of("bias_step", 2), shared = effect_of("common_mode", 2);
  s.effects = {ramp, noise, jump, shared};
  for (const double rate : {0.01, 0.2}) {
    const Json axis = told(s, rate);
    const Json& findings = axis["where"]["findings"];
    assert_is(findings[0]["p_value"], 1e-3 * std::exp(-2));
    assert_is(findings[1]["p_value"], 4096 * std::exp(-21));
    assert_is(axis["effects"][0]["p_value"], rate * std::exp(-2));
    for (size_t i = 1; i < 4; ++i) assert_true(axis["effects"][i]["p_value"].is_null());
    // Draws whose gains fall off by e in 2 nats, and exceed the highest threshold by 1 at this rate.
    Selection wide = s;
    wide.chance = {14, 2, 1};
    assert_is(told(wide, rate)["effects"][0]["p_value"], rate * std::exp(-0.5));
    const Json& tests = axis["plots"]["tests"];
    assert_is(tests[0]["threshold_nats"], std::log(1000));
    assert_is(tests[1]["threshold_nats"], 20);
  }
}

// A name that held-out data do not support, and that did not come by chance, is left: the verdict says so, and so do the words.
static void test_a_name_that_went_is_told_as_left(void**) {
  Selection s;
  s.verdict = Verdict::kUnexplained;
  s.dropped = {effect_of("warm_up", 20)};
  assert_has(told(s)["gap"]["remainder"].text(),
             "what warm_up took in the fitted logs and held-out data do not support");
  s.verdict = Verdict::kNoGap, s.dropped[0].came_by_chance = true;
  assert_lacks(told(s)["gap"]["remainder"].text(), "warm_up");
}

// What held-out data speak against has no name: the engine judges it, by the part that they can show.
static void test_a_name_is_not_spoken_against_but_may_be_untested(void**) {
  SelectedEffect effect = effect_of("warm_up", 20);
  effect.held_out_nats = -5;
  assert_lacks(said(Verdict::kExplained, {effect}, {}), "speak against");
  assert_lacks(said(Verdict::kExplained, {effect}, {}), "cannot test it");
  effect.is_untested = true;
  assert_has(said(Verdict::kExplained, {effect}, {}), "the held-out logs cannot test it");
}

// A free shape follows the logs more closely than the answer; a name that was taken back does not.
static void test_names_that_were_rejected_are_told_apart_from_free_shapes(void**) {
  const CandidateEvidence name = effect_of("thermal_hysteresis", 60).set.front();
  const CandidateEvidence other = effect_of("warm_up", 60).set.front();
  const CandidateEvidence shape = free_shape(Family::kThermalMemory);
  const std::string text = said(Verdict::kUnexplained, {}, {name, shape, other, name});
  assert_has(text, "nearest comes thermal_hysteresis");
  assert_has(text, ".  Considered and rejected: thermal_hysteresis, warm_up\n");
  assert_int_equal(count(text, "would follow the logs more closely"), 1);
  assert_has(text, (std::string(shape.reference->what) + " would follow the logs more closely").c_str());
}

// What axes share is measured: it is no family of which a member comes near.
static void test_shared_noise_beside_a_gap_is_no_open_family(void**) {
  SelectedEffect shared = effect_of("common_mode", 30);
  shared.statement = "noise shared with gy_dph: correlation 0.50";
  const std::string text = said(Verdict::kUnexplained, {shared}, {});
  assert_has(text, "a gap that no known effect explains; beside it common_mode");
  assert_lacks(text, "of the family");
}

// A gap within a minute, as of the steps of a thermometer: the figure and the means beside it do not contradict each other.
static void test_a_gap_within_a_minute_is_said_to_be(void**) {
  GapResult gap = gap_of(0.96, 0.93, 0.98);
  gap.minutes.rms_before_dph = 12.5, gap.minutes.rms_after_dph = 12.2, gap.minutes.noise_rms_dph = 12.8;
  const std::string within = "the gap lies within these means";
  assert_true(said(Verdict::kExplained, {effect_of("thermal_hysteresis", 40)}, {}, gap).find(within) !=
              std::string::npos);
  gap.minutes.rms_after_dph = 6;
  assert_true(said(Verdict::kExplained, {effect_of("thermal_hysteresis", 40)}, {}, gap).find(within) ==
              std::string::npos);
}
static void test_a_loop_that_is_open_is_left(void**) {
  SelectedEffect effect = effect_of("thermal_hysteresis", 40);
  open_loop(&effect);
  const std::string text = said(Verdict::kUnexplained, {effect}, {}, gap_of(0.9, 0.8, 0.95));
  assert_true(text.find("left: what the states in which the runs began belong to is open") != std::string::npos);
  assert_true(text.find("nothing detectable") == std::string::npos);
}

static void test_a_stand_in_does_not_remove_less_than_nothing(void**) {
  const auto said_of = [](double part) {
    return said(Verdict::kUnexplained, {}, {free_shape(Family::kThermalMemory)},
                gap_of(part, part - 0.05, part + 0.05));
  };
  assert_has(said_of(0.7),
             "a flexible stand-in removes 70 % of the gap: not an explanation; residual of one-minute means ");
  GapResult grows = gap_of(0.7, 0.65, 0.75);
  grows.minutes.rms_after_dph = 300;
  const std::string contrary = said(Verdict::kUnexplained, {}, {free_shape(Family::kThermalMemory)}, grows);
  assert_has(contrary, "a flexible stand-in leaves more than before: not an explanation; residual");
  assert_lacks(contrary, "70 %");
  assert_has(said_of(-0.5), "a flexible stand-in makes the gap 50 % worse: not");
  assert_has(said_of(-1), "a flexible stand-in makes the gap more than 100 % worse: not");
}

// The verdict of such an axis is one of the four that the contract knows: the words say that it is none.
static void test_an_axis_that_cannot_be_judged_has_no_answer(void**) {
  SelectedEffect held = effect_of("held_samples", 9000);
  held.is_structural = true, held.statement = "samples repeat the one before exactly";
  DiagnoseResult result;
  result.axes.resize(1);
  AxisResult& axis = result.axes[0];
  axis.axis = "gx_dph";
  Selection& s = axis.study.selection;
  s.verdict = Verdict::kPartlyExplained, s.cannot_judge = true, s.effects = {held};
  const std::string why = "what the recorder did to the samples leaves too few usable seconds to judge";
  const std::string text = diagnosis_text(result);
  assert_has(text, ("gx_dph: no answer: " + why + "\n").c_str());
  assert_has(text, "effect  held_samples");
  assert_has(text, "samples repeat the one before exactly");
  const Json told_axis = diagnosis_json({}, result)["axes"][0];
  assert_string_equal(told_axis["statement"].text().c_str(), ("no answer: " + why).c_str());
  assert_string_equal(told_axis["refused"].text().c_str(), why.c_str());
  assert_string_equal(told_axis["verdict"].text().c_str(), "unexplained");
  assert_int_equal(unanswered(result).size(), 1);
  s.effects.clear();
  assert_has(diagnosis_text(result), "gx_dph: no answer: too few usable seconds to judge\n");
}

static void test_no_name_is_twice_in_a_set(void**) {
  SelectedEffect effect = effect_of("thermal_anomaly", 10);
  const auto of = [](const char* name, double gain) {
    return CandidateEvidence{&find_effect(name), nullptr, false, find_effect(name).family(), gain, 6};
  };
  add_to_set({of("thermal_step", 9), of("thermal_hysteresis", 8)}, &effect);
  add_to_set({of("thermal_step", 5), of("thermal_anomaly", 4), of("higher_order_polynomial", 3)}, &effect);
  add_equal(&find_effect("thermal_step"), &effect);
  CandidateEvidence family;
  family.is_family = true, family.family = Family::kThermalMemory;
  add_to_set({family, family}, &effect);
  assert_int_equal(effect.set.size(), 5);
  assert_true(effect.set[1].gain_nats == 9);
}

// The log shows the steps; with odds of one to one they are no gap.  With evidence they are a name as others are.
static void test_steps_of_the_thermometer_that_are_not_felt_are_a_note(void**) {
  Selection selection;
  selection.effects = {effect_of("temperature_sensor_quantization", 0.03)};
  selection.effects[0].term.fixed_parameters = {{"lsb_degc", 0.5}};
  selection.verdict = Verdict::kNoGap;
  const std::string text = said(selection.verdict, selection.effects, {});
  assert_has(text, "gx_dph: no gap that these logs can show");
  assert_has(text, "  note    temperature_sensor_quantization: lsb_degc 0.5000");
  assert_has(text, "hardly shows in the rates more than by chance: no gap");
  assert_int_equal(count(text, "odds"), 0);
  assert_int_equal(count(text, "Look at the hardware"), 0);
  assert_true(told(selection)["effects"][0]["is_note"] == Json(true));
  selection.effects[0].evidence_nats = 4, selection.verdict = Verdict::kExplained;
  assert_has(said(selection.verdict, selection.effects, {}), "a gap, explained: temperature_sensor_quantization");
  assert_true(told(selection)["effects"][0]["is_note"] == Json(false));
}

// 2 % from cold to warm is no reason to look for what follows the temperature, nor is what may be nothing.
static void test_hardware_of_noise_that_hardly_follows_the_temperature_is_not_told(void**) {
  const auto advice_on = [](double slope, double error) {
    DiagnoseResult result;
    result.axes.resize(1);
    AxisResult& axis = result.axes[0];
    axis.axis = "gx_dph", axis.where.sentence = "somewhere";
    axis.campaign.has_temperature = true, axis.campaign.lo_degc = 0, axis.campaign.hi_degc = 60;
    axis.campaign.t0_degc = 30, axis.campaign.range_degc = 30;
    axis.study.selection.verdict = Verdict::kExplained;
    axis.study.selection.effects = {effect_of("markov_sigma_vs_temperature", 8)};
    Term& term = axis.study.selection.effects[0].term;
    term.fixed_parameters = {{"slope", Measured{slope, error}}};
    term.shape = {slope}, term.shape_errors = {error};
    return count(diagnosis_text(result), "Look at the hardware (markov sigma vs temperature)");
  };
  assert_int_equal(advice_on(0.02, 0.001), 0);
  assert_int_equal(advice_on(0.5, 0.6), 0);
  assert_int_equal(advice_on(0.5, 0.1), 1); // 1.65 times
  assert_int_equal(advice_on(-0.5, 0.1), 1);
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_steps_of_the_thermometer_that_are_not_felt_are_a_note),
      cmocka_unit_test(test_hardware_of_noise_that_hardly_follows_the_temperature_is_not_told),
      cmocka_unit_test(test_means_that_are_drawn_hold_no_hit),
      cmocka_unit_test(test_means_that_are_drawn_do_not_go_over_a_hole),
      cmocka_unit_test(test_what_is_left_is_not_called_rejected),
      cmocka_unit_test(test_a_family_that_is_told_is_in_the_headline),
      cmocka_unit_test(test_a_family_is_told_with_what_is_open),
      cmocka_unit_test(test_a_name_that_is_left_is_nearest_in_the_headline),
      cmocka_unit_test(test_a_healthy_axis_says_what_was_not_asked_and_last_what_is_hidden),
      cmocka_unit_test(test_a_named_cause_is_followed_by_the_hardware_to_look_at),
      cmocka_unit_test(test_a_name_with_little_evidence_is_marked_as_weak),
      cmocka_unit_test(test_a_statement_is_printed_in_the_place_of_the_doubt),
      cmocka_unit_test(test_an_undecided_answer_has_no_evidence),
      cmocka_unit_test(test_other_noise_parameters_beside_a_weak_name_do_not_make_it_strong),
      cmocka_unit_test(test_the_json_holds_what_is_printed),
      cmocka_unit_test(test_the_sign_of_a_lag_is_told),
      cmocka_unit_test(test_findings_stand_in_the_order_of_what_they_add),
      cmocka_unit_test(test_wide_steps_are_told_to_make_curves),
      cmocka_unit_test(test_figures_of_the_held_out_data_agree_with_the_words),
      cmocka_unit_test(test_p_values_have_the_rate_of_their_thresholds),
      cmocka_unit_test(test_a_name_that_went_is_told_as_left),
      cmocka_unit_test(test_a_name_is_not_spoken_against_but_may_be_untested),
      cmocka_unit_test(test_names_that_were_rejected_are_told_apart_from_free_shapes),
      cmocka_unit_test(test_an_extrapolated_residual_is_not_told),
      cmocka_unit_test(test_what_a_noise_leaves_is_told_with_its_scatter),
      cmocka_unit_test(test_a_name_is_not_blamed_for_the_polynomial_beside_it),
      cmocka_unit_test(test_shared_noise_beside_a_gap_is_no_open_family),
      cmocka_unit_test(test_a_gap_within_a_minute_is_said_to_be),
      cmocka_unit_test(test_it_is_said_why_there_is_no_figure),
      cmocka_unit_test(test_the_residuals_agree_with_what_is_told_of_them),
      cmocka_unit_test(test_a_loop_that_is_open_is_left),
      cmocka_unit_test(test_a_stand_in_does_not_remove_less_than_nothing),
      cmocka_unit_test(test_an_axis_that_cannot_be_judged_has_no_answer),
      cmocka_unit_test(test_no_name_is_twice_in_a_set),
      cmocka_unit_test(test_a_family_is_worth_its_best_member),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
