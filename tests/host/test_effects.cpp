// SPDX-License-Identifier: MIT
// The simulation side of every effect: what it adds to a run, worked out by hand or from its definition.
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <set>

#include "base/error.h"
#include "io/json_file.h"
#include "physics/effects/effect.h"
#include "physics/effects/estimation.h"
// After the others: it defines a macro `fail`.
extern "C" {
#include <cmocka.h>
}

using namespace imucal;

// CMocka 1.1.5 compares floats only.
#define assert_double_equal(a, b, tolerance)                                                                           \
  do {                                                                                                                 \
    const double left_ = (a), right_ = (b);                                                                            \
    if (!(std::fabs(left_ - right_) <= (tolerance))) fail_msg("%s = %.12g, expected %.12g", #a, left_, right_);        \
  } while (0)

// A triangle in temperature: 0 -> 60 -> 0 degC at 1 degC/min, flat 20 dph of white noise, one Markov process.
static SimRun triangle_run(const ErrorModel& model) {
  SimRun run;
  run.model = &model;
  run.bias = *model.bias;
  for (int k = 0; k <= 7200; ++k) {
    run.t_s.push_back(k + 1);
    run.case_temp_degc.push_back(k <= 3600 ? k / 60.0 : (7200 - k) / 60.0);
  }
  run.thermometer_degc = run.gyro_temp_degc = run.case_temp_degc;
  run.rate_dph.assign(run.t_s.size(), 0.0);
  run.white_sigma_dph.assign(run.t_s.size(), 36.0);
  run.markov.push_back({std::vector<double>(run.t_s.size(), 20.0), std::vector<double>(run.t_s.size(), 100.0)});
  return run;
}

static ErrorModel test_model() {
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  model.bias = ThermalPolynomial{30, 30, {80, 300, 150, -100}};
  return model;
}

static void simulate(const char* name, const char* parameters, SimRun* run, Rng* rng) {
  const Effect& effect = find_effect(name);
  for (SimStage stage : {SimStage::kTemperature, SimStage::kBias, SimStage::kNoise, SimStage::kOutput})
    effect.simulate(stage, read_parameters(effect, parse_json(parameters, "test").json()), run, rng);
}

static SimRun simulated(const char* name, const char* parameters, Rng* rng = nullptr) {
  static const ErrorModel model = test_model();
  SimRun run = triangle_run(model);
  simulate(name, parameters, &run, rng);
  return run;
}

static double standard_deviation(const std::vector<double>& x) {
  double sum = 0, squares = 0;
  for (double v : x) sum += v, squares += v * v;
  const double n = static_cast<double>(x.size());
  return std::sqrt(squares / n - sum * sum / n / n);
}

static void test_library_has_the_names_of_the_contract(void**) {
  const std::set<std::string> contract = {"temperature_rate",
                                          "thermal_hysteresis",
                                          "thermal_lag",
                                          "thermal_step",
                                          "thermal_creep",
                                          "thermal_anomaly",
                                          "higher_order_polynomial",
                                          "rate_ramp",
                                          "warm_up",
                                          "sinusoid",
                                          "bias_step",
                                          "run_to_run",
                                          "temperature_sensor_quantization",
                                          "noise_parameters",
                                          "second_markov",
                                          "rate_random_walk",
                                          "flicker_noise",
                                          "white_noise_vs_temperature",
                                          "markov_sigma_vs_temperature",
                                          "markov_tau_vs_temperature",
                                          "outliers",
                                          "telegraph_noise",
                                          "quantization",
                                          "saturation",
                                          "dead_band",
                                          "held_samples",
                                          "common_mode",
                                          "auxiliary_channel"};
  std::set<std::string> names;
  for (const Effect* effect : effect_library()) {
    names.insert(effect->name());
    assert_true(effect->description().size() > 20);
    for (const EffectParameter& p : effect->parameters())
      assert_true(p.kind != EffectParameter::kNumber || p.lo < p.hi);
  }
  assert_true(names == contract);
}

static void test_rate_on_a_ramp_is_its_slope(void**) {
  const SimRun run = simulated("temperature_rate", R"({"k_dph_per_degc_min": 7})");
  assert_double_equal(run.rate_dph[1800], 7.0, 1e-9);
  assert_double_equal(run.rate_dph[3600], 0.0, 1e-9);
  assert_double_equal(run.rate_dph[5400], -7.0, 1e-9);
}

static void test_hysteresis_opens_by_twice_the_amplitude(void**) {
  const SimRun run = simulated("thermal_hysteresis", R"({"amplitude_dph": 12, "width_degc": 5})");
  assert_double_equal(run.rate_dph[0], 12.0, 1e-9);            // starts cold: came down
  assert_double_equal(run.rate_dph[10 * 60], -12.0, 1e-9);     // 2 r further: on the rising branch
  assert_double_equal(run.rate_dph[3600 + 5 * 60], 0.0, 1e-9); // r after the reversal: half way
  assert_double_equal(run.rate_dph[7200], 12.0, 1e-9);         // falling branch
}

static void test_lag_follows_a_ramp_at_the_distance_tau_times_slope(void**) {
  const SimRun late = simulated("thermal_lag", R"({"tau_s": 120})");
  assert_double_equal(late.gyro_temp_degc[3000], 3000 / 60.0 - 120.0 / 60.0, 1e-6);
  assert_double_equal(late.thermometer_degc[3000], 50.0, 1e-12);
  const SimRun ahead = simulated("thermal_lag", R"({"tau_s": -120})");
  assert_double_equal(ahead.gyro_temp_degc[3000], 3000 / 60.0 + 120.0 / 60.0, 1e-6);
  // First-order response to the reversal: exp(-1) of the 4 degC distance change is left after tau.
  const double left = late.gyro_temp_degc[3720] - (late.case_temp_degc[3720] + 2.0);
  assert_double_equal(left, -4.0 * std::exp(-1.0), 1e-3);
}

static void test_functions_of_temperature_and_time(void**) {
  const SimRun bump = simulated("thermal_anomaly", R"({"amplitude_dph": -9, "center_degc": 20, "width_degc": 2})");
  assert_double_equal(bump.rate_dph[20 * 60], -9.0, 1e-9);
  assert_double_equal(bump.rate_dph[22 * 60], -9.0 * std::exp(-0.5), 1e-9);
  const SimRun poly = simulated("higher_order_polynomial", R"({"p4_dph": 3, "p5_dph": 5})");
  assert_double_equal(poly.rate_dph[3600], 8.0, 1e-9);    // P_n(1) = 1
  assert_double_equal(poly.rate_dph[0], 3.0 - 5.0, 1e-9); // P_n(-1) = (-1)^n
  assert_double_equal(poly.rate_dph[1800], 3.0 * 3.0 / 8.0, 1e-9);
  const SimRun ramp = simulated("rate_ramp", R"({"ramp_dph_per_h": 10})");
  assert_double_equal(ramp.rate_dph[3600], 10.0, 1e-9);
  const SimRun warm = simulated("warm_up", R"({"amplitude_dph": 10, "tau_s": 500})");
  assert_double_equal(warm.rate_dph[1000], 10.0 * std::exp(-2.0), 1e-9);
  const SimRun tone = simulated("sinusoid", R"({"amplitude_dph": 4, "frequency_hz": 0.01})");
  assert_double_equal(tone.rate_dph[24], 4.0, 1e-9); // t = 25 s: a quarter period, phase 0 without noise
}

static void test_step_acts_in_its_log_from_its_time_on(void**) {
  const char* parameters =
      R"({"steps": [{"log": 0, "t_s": 100, "amplitude_dph": 5}, {"log": 1, "t_s": 1, "amplitude_dph": 50},
                                         {"log": 0, "t_s": 200, "amplitude_dph": -2}]})";
  const SimRun run = simulated("bias_step", parameters);
  assert_double_equal(run.rate_dph[98], 0.0, 0.0);
  assert_double_equal(run.rate_dph[99], 5.0, 0.0);
  assert_double_equal(run.rate_dph[199], 3.0, 0.0);
}

static void test_random_effects_have_their_moments(void**) {
  Rng rng(7, 0, 0, Stream::kEffect);
  const SimRun hits = simulated("outliers", R"({"probability": 0.1, "sigma_dph": 100})", &rng);
  assert_double_equal(standard_deviation(hits.rate_dph), std::sqrt(0.1) * 100, 3.0);
  const SimRun telegraph = simulated("telegraph_noise", R"({"amplitude_dph": 30, "tau_s": 5})", &rng);
  double lag5 = 0;
  for (size_t i = 5; i < telegraph.rate_dph.size(); ++i) lag5 += telegraph.rate_dph[i] * telegraph.rate_dph[i - 5];
  assert_double_equal(std::fabs(telegraph.rate_dph[77]), 30.0, 0.0);
  assert_double_equal(lag5 / 7196 / 900, std::exp(-1.0), 0.06);
  double ends = 0;
  for (int r = 0; r < 200; ++r) {
    Rng stream(7, static_cast<uint64_t>(r), 0, Stream::kEffect);
    const double end = simulated("rate_random_walk", R"({"k_dph_per_rt_s": 0.5})", &stream).rate_dph[6400];
    ends += end * end / 200;
  }
  assert_in_range(std::sqrt(ends), 34, 46); // 0.5 sqrt(6400) = 40, 5 % standard error
  const SimRun flicker = simulated("flicker_noise", R"({"b_dph": 10})");
  assert_int_equal(flicker.markov.size(), 1 + 18);
}

// One-sided density of the Markov processes that stand for flicker, against B^2/(pi f) of IEEE 952.
static void test_flicker_has_the_density_of_the_standard(void**) {
  const SimRun run = simulated("flicker_noise", R"({"b_dph": 10})");
  for (double hz : {1e-4, 3e-4, 1e-3, 3e-3, 1e-2}) {
    double density = 0;
    for (size_t i = 1; i < run.markov.size(); ++i) { // the first is the nominal one
      const double sigma = run.markov[i].sigma_dph[0], tau = run.markov[i].tau_s[0];
      density += 4 * sigma * sigma * tau / (1 + std::pow(2 * M_PI * hz * tau, 2));
    }
    assert_double_equal(density / (100 / (M_PI * hz)), 1.0, 0.03);
  }
}

// Allan deviation of means of m rows of a process that is constant within a row.
static double allan_variance(const Markov& process, int m) {
  const double phi = std::exp(-1 / process.tau_s);
  double within = m, beside = 0; // sums of correlations of one mean with itself, and with the next
  for (int h = 1; h < m; ++h) within += 2 * (m - h) * std::pow(phi, h);
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < m; ++j) beside += std::pow(phi, m + j - i);
  return process.sigma_dph * process.sigma_dph * (within - beside) / m / m;
}

// From means of a second on, in the simulation and in the estimation.
static void test_flicker_has_the_flat_allan_deviation_of_the_standard(void**) {
  const SimRun run = simulated("flicker_noise", R"({"b_dph": 10})");
  std::vector<Markov> simulated_ones;
  for (size_t i = 1; i < run.markov.size(); ++i)
    simulated_ones.push_back({run.markov[i].sigma_dph[0], run.markov[i].tau_s[0]});
  const std::vector<Markov> estimated = find_effect("flicker_noise").estimator()->noise({}, {10}).markov;
  for (const std::vector<Markov>& ladder : {simulated_ones, estimated})
    for (const int m : {1, 2, 4, 8, 32, 256}) {
      double variance = 0;
      for (const Markov& process : ladder) variance += allan_variance(process, m);
      assert_double_equal(std::sqrt(variance) / 6.64, 1.0, 0.03);
    }
}

// s1 x + s2 (x^2 - 1/3)/2: variance s^2 (1 + 1/9) at the ends, s^2/36 in the middle; one curve in each run.
static void test_run_to_run_has_its_variance_over_temperature(void**) {
  double end = 0, middle = 0;
  for (uint64_t r = 0; r < 1000; ++r) {
    Rng rng(3, r, 0, Stream::kEffect);
    const SimRun run = simulated("run_to_run", R"({"sigma_dph": 30})", &rng);
    end += run.rate_dph[3600] * run.rate_dph[3600] / 1000;
    middle += run.rate_dph[1800] * run.rate_dph[1800] / 1000;
  }
  const double errors = 4 * std::sqrt(2.0 / 1000); // four standard errors of a variance
  assert_double_equal(end / (900 * 10.0 / 9), 1.0, errors);
  assert_double_equal(middle / (900 / 36.0), 1.0, errors);
}

static void test_noise_levels_follow_temperature(void**) {
  const SimRun white = simulated("white_noise_vs_temperature", R"({"slope": 1.5})");
  assert_double_equal(white.white_sigma_dph[3600], 36.0 * std::exp(0.75), 1e-9);
  const SimRun sigma = simulated("markov_sigma_vs_temperature", R"({"slope": -1})");
  assert_double_equal(sigma.markov[0].sigma_dph[0], 20.0 * std::exp(0.5), 1e-9);
  const SimRun tau = simulated("markov_tau_vs_temperature", R"({"slope": 1})");
  assert_double_equal(tau.markov[0].tau_s[3600], 100.0 * std::exp(1.0), 1e-9);
  const SimRun retune = simulated("noise_parameters", R"({"arw_deg_rt_h": 1, "sigma_dph": 5, "tau_s": 30})");
  assert_double_equal(retune.white_sigma_dph[5], 60.0, 1e-9);
  assert_double_equal(retune.markov[0].tau_s[5], 30.0, 0.0);
  const SimRun second = simulated("second_markov", R"({"sigma_dph": 5, "tau_s": 30})");
  assert_int_equal(second.markov.size(), 2);
}

static void test_outputs_are_quantised_clipped_dead_or_held(void**) {
  static const ErrorModel model = test_model();
  SimRun run = triangle_run(model);
  for (size_t i = 0; i < run.rate_dph.size(); ++i) run.rate_dph[i] = std::sin(0.1 * static_cast<double>(i)) * 100;
  SimRun rounded = run, clipped = run, dead = run, held = run;
  simulate("quantization", R"({"lsb_dph": 8})", &rounded, nullptr);
  simulate("saturation", R"({"limit_dph": 70})", &clipped, nullptr);
  simulate("dead_band", R"({"width_dph": 30})", &dead, nullptr);
  Rng rng(3, 0, 0, Stream::kEffect);
  simulate("held_samples", R"({"probability": 0.2})", &held, &rng);
  int repeats = 0;
  for (size_t i = 0; i < run.rate_dph.size(); ++i) {
    assert_double_equal(std::remainder(rounded.rate_dph[i], 8.0), 0.0, 1e-12);
    assert_true(std::fabs(rounded.rate_dph[i] - run.rate_dph[i]) <= 4.0);
    assert_true(std::fabs(clipped.rate_dph[i]) <= 70.0);
    assert_true(dead.rate_dph[i] == 0.0 || std::fabs(dead.rate_dph[i]) >= 30.0);
    if (i && held.rate_dph[i] == held.rate_dph[i - 1]) ++repeats;
  }
  assert_in_range(repeats, 1300, 1580); // 1440 expected, four standard deviations
  const SimRun coarse = simulated("temperature_sensor_quantization", R"({"lsb_degc": 0.5})");
  assert_double_equal(coarse.thermometer_degc[67], 1.0, 1e-12);
  assert_double_equal(coarse.gyro_temp_degc[67], 67 / 60.0, 1e-12);
}

static void test_common_mode_is_shared_between_axes(void**) {
  static const ErrorModel model = test_model();
  std::vector<SimRun> axes(2, triangle_run(model));
  for (size_t a = 0; a < 2; ++a) {
    axes[a].axis = a, axes[a].n_axes = 2, axes[a].seed = 11;
    Rng rng(11, 0, static_cast<uint32_t>(a), Stream::kEffect);
    simulate("common_mode", R"({"correlation": 0.5, "sigma_dph": 10})", &axes[a], &rng);
  }
  double product = 0;
  for (size_t i = 0; i < axes[0].rate_dph.size(); ++i) product += axes[0].rate_dph[i] * axes[1].rate_dph[i];
  assert_double_equal(product / 7201 / 100, 0.5, 0.06);
  assert_double_equal(standard_deviation(axes[1].rate_dph), 10.0, 0.4);
}

static void test_auxiliary_channel_uses_the_column(void**) {
  static const ErrorModel model = test_model();
  SimRun run = triangle_run(model);
  run.auxiliary["supply_v"].assign(run.t_s.size(), 5.0);
  run.auxiliary["supply_v"][10] = 6.0;
  simulate("auxiliary_channel", R"({"channel": "supply_v", "gain": 3})", &run, nullptr);
  assert_double_equal(run.rate_dph[10] - run.rate_dph[9], 3.0, 1e-12);
}

// Without a stream of random numbers every effect must leave a run that is the same each time.
static void test_every_effect_is_deterministic_without_random_numbers(void**) {
  for (const Effect* effect : effect_library()) {
    Json parameters = Json::object();
    for (const EffectParameter& p : effect->parameters()) {
      if (p.is_optional) continue;
      if (p.kind == EffectParameter::kText)
        parameters[p.name] = "supply_v";
      else if (p.kind == EffectParameter::kSteps)
        parameters[p.name] = Json::array({{{"log", 0}, {"t_s", 10}, {"amplitude_dph", 3}}});
      else
        parameters[p.name] = std::min(p.hi, std::max(p.lo, 0.9));
    }
    const SimRun first = simulated(effect->name().c_str(), parameters.dump().c_str());
    const SimRun second = simulated(effect->name().c_str(), parameters.dump().c_str());
    for (size_t i = 0; i < first.rate_dph.size(); ++i) {
      assert_true(std::isfinite(first.rate_dph[i]));
      assert_true(first.rate_dph[i] == second.rate_dph[i]);
    }
  }
}

static void expect_refused(const char* name, const char* parameters, const char* words) {
  std::string message;
  try {
    simulated(name, parameters);
  } catch (const Error& error) {
    message = error.what();
  }
  if (message.find(words) == std::string::npos) fail_msg("\"%s\" does not say \"%s\"", message.c_str(), words);
}

static void test_wrong_parameters_are_refused_by_name(void**) {
  expect_refused("thermal_lag", "{}", "thermal_lag: field \"tau_s\" is missing");
  expect_refused("thermal_hysteresis", R"({"amplitude_dph": 3, "width_degc": 0})", "width_degc");
  expect_refused("bias_step", R"({"steps": [{"log": 0, "t_s": 1}]})", "amplitude_dph");
  expect_refused("thermal_leg", "{}", "known: temperature_rate");
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_library_has_the_names_of_the_contract),
      cmocka_unit_test(test_rate_on_a_ramp_is_its_slope),
      cmocka_unit_test(test_hysteresis_opens_by_twice_the_amplitude),
      cmocka_unit_test(test_lag_follows_a_ramp_at_the_distance_tau_times_slope),
      cmocka_unit_test(test_functions_of_temperature_and_time),
      cmocka_unit_test(test_step_acts_in_its_log_from_its_time_on),
      cmocka_unit_test(test_random_effects_have_their_moments),
      cmocka_unit_test(test_flicker_has_the_density_of_the_standard),
      cmocka_unit_test(test_flicker_has_the_flat_allan_deviation_of_the_standard),
      cmocka_unit_test(test_run_to_run_has_its_variance_over_temperature),
      cmocka_unit_test(test_noise_levels_follow_temperature),
      cmocka_unit_test(test_outputs_are_quantised_clipped_dead_or_held),
      cmocka_unit_test(test_common_mode_is_shared_between_axes),
      cmocka_unit_test(test_auxiliary_channel_uses_the_column),
      cmocka_unit_test(test_every_effect_is_deterministic_without_random_numbers),
      cmocka_unit_test(test_wrong_parameters_are_refused_by_name),
  };
  return cmocka_run_group_tests_name("effects", tests, nullptr, nullptr);
}
