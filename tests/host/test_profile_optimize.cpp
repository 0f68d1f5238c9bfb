// SPDX-License-Identifier: MIT
// The optimiser: limits kept, figures of the issue reached, deterministic; signatures against curves known by
// hand.
#include <algorithm>
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>

#include "analysis/profile/optimize.h"
#include "analysis/profile/schedule.h"
#include "base/error.h"
#include "io/json_file.h"
extern "C" {
#include <cmocka.h>
}

using namespace imucal;

static OptimizeRequest request_of(double duration_s, double rate) {
  OptimizeRequest r;
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  r.setup.order = 3;
  r.setup.hi_degc = 60;
  r.setup.truth = r.setup.filter = model;
  r.limits = {0, 60, rate, rate, 0, 0};
  r.duration_s = duration_s;
  return r;
}

static void assert_keeps_limits(const OptimizeResult& result, const OptimizeRequest& request) {
  const auto all = legs(result.profile);
  assert_true(std::abs(all.back().end_s - result.error.duration_s) <= 1);
  if (request.duration_s > 0) {
    assert_true(all.back().end_s <= request.duration_s + 0.5);
    assert_true(all.back().end_s >= request.duration_s - 2);
  }
  assert_float_equal(result.profile.min_degc(), request.limits.lo_degc, 1e-6);
  assert_float_equal(result.profile.max_degc(), request.limits.hi_degc, 1e-6);
  for (const ProfileLeg& leg : all) {
    const double rate = 60 * (leg.end_degc - leg.start_degc) / (leg.end_s - leg.start_s);
    assert_true(rate <= request.limits.heating_degc_per_min * (1 + 1e-9));
    assert_true(-rate <= request.limits.cooling_degc_per_min * (1 + 1e-9));
    if (rate == 0) {
      assert_true(leg.end_s - leg.start_s >= request.limits.min_soak_s - 1);
      if (request.limits.max_soak_s > 0) assert_true(leg.end_s - leg.start_s <= request.limits.max_soak_s + 1);
    }
  }
}

// Errors of the issue (6.93 at 0.6 degC/min; 6.29 known at 2 degC/min, beaten), and a share of the proven
// bound.
static void test_optimize_reaches_known_figures_and_the_bound(void**) {
  const struct {
    double duration_s, rate, at_most_dph, of_proven;
  } cases[] = {{8400, 0.6, 6.94, 0.985}, {8400, 2, 6.23, 0.92}, {14400, 0.6, 4.90, 0.985}, {6000, 0.6, 13.10, 0.975}};
  for (const auto& c : cases) {
    const OptimizeRequest request = request_of(c.duration_s, c.rate);
    const OptimizeResult result = optimize_profile(request);
    assert_keeps_limits(result, request);
    const double proven = calibration_bound({request.setup.truth, 3, c.duration_s, 60, c.rate}).proven_dph;
    if (!(result.error.worst_dph < c.at_most_dph && proven < result.error.worst_dph &&
          proven > c.of_proven * result.error.worst_dph))
      fail_msg("%g s at %g degC/min: %.4f dph, bound %.4f", c.duration_s, c.rate, result.error.worst_dph, proven);
    assert_true(result.error.worst_dph <= result.paper_error.worst_dph + 1e-9);
  }
}

static void test_optimize_keeps_different_rates_and_soak_limits(void**) {
  OptimizeRequest request = request_of(10000, 3);
  request.limits.cooling_degc_per_min = 0.9;
  request.limits.min_soak_s = 300;
  request.limits.max_soak_s = 1500;
  const OptimizeResult limited = optimize_profile(request);
  assert_keeps_limits(limited, request);
  OptimizeRequest loose = request;
  loose.limits.max_soak_s = 0;
  loose.limits.min_soak_s = 0;
  assert_true(optimize_profile(loose).error.worst_dph <= limited.error.worst_dph * 1.001);
  // Maximum soaks so short that only slower ramps fill the time.
  request.limits.min_soak_s = 0;
  request.limits.max_soak_s = 100;
  request.duration_s = 6000;
  assert_keeps_limits(optimize_profile(request), request);
}

// Soaks that become one must not be longer than the chamber's longest; what they lose goes to a ramp, not off the end.
static void test_rounded_keeps_the_duration_where_soaks_may_not_grow(void**) {
  Profile p;
  p.segments = {{0, 100, 0},  {0.9, 0, 30}, {0, 70, 30},      {0.9, 0, 30.001}, {0, 60, 30.001},
                {0.9, 0, 50}, {0, 60, 50},  {0.9, 0, 50.002}, {0, 46.3, 50.002}};
  const double duration_s = legs(p).back().end_s;
  const ChamberLimits limits{0, 50.002, 0.9, 0.9, 0, 100};
  const Profile kept = rounded(p, duration_s, limits);
  const auto all = legs(kept);
  assert_float_equal(all.back().end_s, duration_s, 0.5);
  assert_int_equal(all.size(), 5);
  for (const ProfileLeg& leg : all) {
    if (leg.end_degc == leg.start_degc)
      assert_true(leg.end_s - leg.start_s <= 100 + 1e-9);
    else
      assert_true(60 * (leg.end_degc - leg.start_degc) / (leg.end_s - leg.start_s) <= 0.9 + 1e-9);
  }
}

static void test_optimize_rms_objective_is_better_in_rms(void**) {
  OptimizeRequest request = request_of(8400, 2);
  const OptimizeResult worst = optimize_profile(request);
  request.objective = Objective::kRms;
  const OptimizeResult rms = optimize_profile(request);
  assert_true(rms.error.rms_dph < worst.error.rms_dph);
  assert_true(rms.error.worst_dph > worst.error.worst_dph);
  assert_float_equal(rms.objective_dph, rms.error.rms_dph, 0);
}

static void test_optimize_is_deterministic_for_a_seed(void**) {
  OptimizeRequest request = request_of(7000, 1.5);
  request.seed = 77;
  const std::string a = to_json(optimize_profile(request).profile).dump();
  assert_string_equal(a.c_str(), to_json(optimize_profile(request).profile).dump().c_str());
}

static void test_optimize_shortest_duration_for_an_error(void**) {
  OptimizeRequest request = request_of(0, 2);
  request.required_dph = 6.5;
  const OptimizeResult result = optimize_profile(request);
  assert_true(result.meets_error);
  assert_true(result.error.worst_dph <= 6.5);
  const OptimizeResult shorter = optimize_profile(request_of(0.985 * result.error.duration_s, 2));
  assert_true(shorter.error.worst_dph > 6.5);
}

// accuracy_only_dph is of the duration chosen, not of one tried on the way, which is shorter and leaves a larger error.
static void test_optimize_shortest_duration_compares_with_accuracy_alone_at_that_duration(void**) {
  OptimizeRequest request = request_of(0, 2);
  request.tell_apart = standard_effects(3);
  request.required_dph = 6.1;
  const OptimizeResult result = optimize_profile(request);
  assert_true(result.meets_error);
  if (result.accuracy_only_dph > result.objective_dph)
    fail_msg("%.6f dph told apart, %.6f dph without", result.objective_dph, result.accuracy_only_dph);
}

// The aim: worst correlation <= 0.75 among the six effects at <= 5 % of the worst error, 240 min.
static void test_optimize_tells_effects_apart(void**) {
  OptimizeRequest request = request_of(14400, 0.6);
  request.tell_apart = standard_effects(3);
  const OptimizeResult result = optimize_profile(request);
  assert_keeps_limits(result, request);
  assert_int_equal(result.signatures.effects.size(), 6);
  assert_true(result.signatures.invisible.empty());
  assert_true(result.meets_correlation);
  assert_true(result.signatures.worst <= 0.75);
  assert_true(result.error.worst_dph <= 1.05 * result.accuracy_only_dph);
  assert_true(result.accuracy_only_dph < 4.92);
}

static void test_optimize_spends_accuracy_on_strong_signatures(void**) {
  OptimizeRequest request = request_of(9000, 2);
  request.tell_apart = standard_effects(3);
  const OptimizeResult least = optimize_profile(request);
  request.spend_frac = 0.05;
  const OptimizeResult spent = optimize_profile(request);
  assert_keeps_limits(spent, request);
  assert_true(spent.error.worst_dph <= 1.05 * spent.accuracy_only_dph);
  assert_true(spent.signatures.worst <= 0.75);
  assert_true(spent.signatures.mean_separable > 1.3 * least.signatures.mean_separable);
}

static SignatureTable table_of(const Profile& profile, const char* effects, int order = 3) {
  const OptimizeRequest r = request_of(1, 1);
  CalibrationSetup setup = r.setup;
  setup.order = order;
  return signature_table(runs_of_profile(profile), setup, effects_by_name(effects, order));
}

static double correlation_of(const Profile& profile, const char* pair) {
  return std::abs(table_of(profile, pair).correlation[1]);
}

static void test_signatures_follow_physics(void**) {
  Profile heating; // heating only: a turn-on transient and dT/dt that sets in are nearly the same curve
  heating.segments = {{0.6, 0, 60}};
  Profile triangle = heating;
  triangle.segments.push_back({-0.6, 0, 0});
  // On one ramp from the start dT/dt is constant: all in the turn-on constant, nothing is left of it.
  assert_true(table_of(heating, "temperature_rate,rate_ramp").invisible.size() == 2);
  // Up and down at one rate: dT/dt is a square wave, and so is hysteresis the narrower its loop is.
  // (White noise: Markov noise would let the few seconds in which the loop is crossed count for more.)
  CalibrationSetup white = request_of(1, 1).setup;
  white.truth.markov.clear();
  white.filter.markov.clear();
  double last = 0;
  for (double width_degc : {10.0, 5.0, 1.0, 0.05}) {
    std::vector<EffectSpec> effects = effects_by_name("temperature_rate,thermal_hysteresis", 3);
    effects[1].parameters = Json{{"amplitude_dph", 10}, {"width_degc", width_degc}};
    const double r = std::abs(signature_table(runs_of_profile(triangle), white, effects).correlation[1]);
    assert_true(r > last);
    last = r;
  }
  assert_true(last > 0.995);
  Profile stairs;
  stairs.segments = {{0, 400, 0}, {2, 0, 20},  {0, 500, 0}, {2, 0, 40},  {0, 500, 0}, {2, 0, 60}, {0, 500, 0},
                     {-1, 0, 40}, {0, 500, 0}, {-1, 0, 20}, {0, 500, 0}, {-1, 0, 0},  {0, 300, 0}};
  assert_true(correlation_of(stairs, "temperature_rate,thermal_hysteresis") <
              correlation_of(triangle, "temperature_rate,thermal_hysteresis") - 0.05);
  // An effect of the temperature alone that the polynomial holds has no signature: P4 for order 4.
  CalibrationSetup setup = request_of(1, 1).setup;
  setup.order = 4;
  const SignatureTable t = signature_table(runs_of_profile(triangle), setup, standard_effects(3));
  assert_int_equal(t.invisible.size(), 1);
  assert_string_equal(t.invisible[0].c_str(), "higher_order_polynomial");
}

static void assert_refused(const OptimizeRequest& request, const char* remedy) {
  std::string message;
  try {
    optimize_profile(request);
  } catch (const Error& e) {
    message = e.what();
  }
  if (message.find(remedy) == std::string::npos) fail_msg("'%s' does not say '%s'", message.c_str(), remedy);
}

static void test_optimize_impossible_requests_name_the_smallest_change(void**) {
  assert_refused(request_of(3600, 0.6), "--duration-s 6000");
  assert_refused(request_of(3600, 0.6), "--max-rate 1,");
  assert_refused(request_of(3600, 0.6), "at most 36 degC");
  OptimizeRequest r = request_of(6500, 0.6);
  r.limits.min_soak_s = 400;
  assert_refused(r, "--duration-s 6800");
  r = request_of(8400, 1);
  r.limits.min_soak_s = 400;
  r.limits.max_soak_s = 100;
  assert_refused(r, "raise it to 400");
  r = request_of(8400, 1);
  r.setup.hi_degc = -1;
  assert_refused(r, "write -1:0");
  r = request_of(8400, 1);
  r.setup.truth.arw_deg_rt_h = 0;
  r.setup.truth.markov.clear();
  assert_refused(r, "no noise");
  r = request_of(0, 1);
  r.required_dph = 0.01;
  assert_refused(r, "within 30 days");
  // What the message proposes is accepted.
  assert_true(optimize_profile(request_of(6000, 0.6)).error.worst_dph > 0);
}

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_optimize_reaches_known_figures_and_the_bound),
      cmocka_unit_test(test_optimize_keeps_different_rates_and_soak_limits),
      cmocka_unit_test(test_rounded_keeps_the_duration_where_soaks_may_not_grow),
      cmocka_unit_test(test_optimize_rms_objective_is_better_in_rms),
      cmocka_unit_test(test_optimize_is_deterministic_for_a_seed),
      cmocka_unit_test(test_optimize_shortest_duration_for_an_error),
      cmocka_unit_test(test_optimize_shortest_duration_compares_with_accuracy_alone_at_that_duration),
      cmocka_unit_test(test_optimize_tells_effects_apart),
      cmocka_unit_test(test_optimize_spends_accuracy_on_strong_signatures),
      cmocka_unit_test(test_signatures_follow_physics),
      cmocka_unit_test(test_optimize_impossible_requests_name_the_smallest_change),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
