// SPDX-License-Identifier: MIT
// What the converter or the recorder did to the samples: which finding each defect gets, and which it must
// not.
#include <algorithm>
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <string>

#include "io/json_file.h"
#include "physics/effects/estimation.h"
// After the others: it defines a macro `fail`.
extern "C" {
#include <cmocka.h>
}

using namespace imucal;

// Rates that move slowly by `swing` around `mean`, with white noise.
static std::vector<RunInput> rates(double mean, double swing, double sigma, uint64_t seed = 1) {
  std::vector<RunInput> runs(2);
  for (size_t r = 0; r < runs.size(); ++r) {
    Rng rng(seed, r, 0, Stream::kWhite);
    for (int k = 0; k < 6000; ++k) {
      runs[r].t_s.push_back(k);
      runs[r].rate_dph.push_back(mean + swing * std::sin(k / 900.0) + sigma * rng.normal());
    }
  }
  return runs;
}

template <typename Change> static std::vector<RunInput> changed(std::vector<RunInput> runs, Change change) {
  Rng rng(9, 0, 0, Stream::kWhite);
  for (RunInput& run : runs)
    for (double& y : run.rate_dph) y = change(y, rng.uniform());
  return runs;
}

// The findings in the order of detection, each on what those before left: "dead_band 30" and the like.
static std::string findings(std::vector<RunInput> runs) {
  std::string out;
  for (int order = 0; order < 4; ++order)
    for (const Effect* effect : effect_library()) {
      const EffectEstimator& estimator = *effect->estimator();
      if (!estimator.is_structural() || estimator.detection_order() != order) continue;
      for (const Signature& found : estimator.detect(runs)) {
        out += (out.empty() ? "" : ", ") + effect->name();
        for (size_t r = 0; r < found.unusable.size(); ++r)
          for (size_t i = 0; i < runs[r].size(); ++i)
            if (found.unusable[r][i]) runs[r].rate_dph[i] = std::nan("");
      }
    }
  return out;
}

static void assert_findings(const std::vector<RunInput>& runs, const char* expected, const char* what) {
  const std::string found = findings(runs);
  if (found != expected) fail_msg("%s: found \"%s\", expected \"%s\"", what, found.c_str(), expected);
}

static void test_sound_samples_have_no_finding(void**) {
  assert_findings(rates(0, 0, 36), "", "noise around zero");
  assert_findings(rates(1000, 200, 36), "", "a swing on a bias");
  auto few = rates(0, 100, 36);
  for (size_t i = 0; i < 7; ++i) few[0].rate_dph[100 + 700 * i] = 0;
  assert_findings(few, "", "seven zeros");
}

static std::vector<RunInput> rounded(std::vector<RunInput> runs, double step) {
  return changed(std::move(runs), [step](double y, double) { return step * std::round(y / step); });
}

// One log for each step.
static std::vector<RunInput> rounded_each(double mean, double swing, const std::vector<double>& steps, uint64_t seed) {
  std::vector<RunInput> out;
  for (const double step : steps) out.push_back(rounded(rates(mean, swing, 36, seed++), step).front());
  return out;
}

// However small the noise is beside the mean: a fog on a turning table, an accelerometer along gravity.
static void test_a_large_mean_makes_no_finding_and_hides_none(void**) {
  const auto table = rates(1.0001e6, 6, 0.1), gravity = rates(1000.2, 0.006, 0.0001);
  assert_findings(rounded(table, 0.001), "", "three decimals");
  assert_findings(rounded(gravity, 1e-6), "", "six decimals");
  assert_findings(rounded(table, 0.1), "quantization", "coarse steps");
  const auto clip = [](double y, double) { return std::min(y, 1.0001e6 + 5.0); };
  assert_findings(changed(table, clip), "saturation", "the top of a swing");
}

static void test_dead_band_is_found_by_its_shape(void**) {
  const auto dead = [](double width) { return [width](double y, double) { return std::fabs(y) < width ? 0.0 : y; }; };
  assert_findings(changed(rates(0, 0, 36), dead(3)), "dead_band", "narrow, around zero");
  assert_findings(changed(rates(0, 200, 36), dead(60)), "dead_band", "wide, crossed by a swing");
  assert_findings(changed(rates(50, 0, 36), dead(20)), "dead_band", "on a bias");
}

static void test_dead_band_has_the_width_of_the_band(void**) {
  const auto runs = changed(rates(0, 200, 36), [](double y, double) { return std::fabs(y) < 60 ? 0.0 : y; });
  const auto found = find_effect("dead_band").estimator()->detect(runs);
  assert_int_equal(found.size(), 1);
  const double width = found[0].parameters.number("width_dph");
  assert_true(width >= 60 && width < 61);
}

static void test_zeros_far_from_the_rate_are_drop_outs(void**) {
  const auto drop = [](double y, double u) { return u < 0.003 ? 0.0 : y; };
  assert_findings(changed(rates(1000, 200, 36), drop), "held_samples", "on a bias");
  assert_findings(changed(rates(-400, 0, 36), drop), "held_samples", "on a negative bias");
  assert_findings(changed(rates(0, 100, 36), drop), "held_samples", "across zero");
  const auto many = [](double y, double u) { return u < 0.3 ? 0.0 : y; };
  assert_findings(changed(rates(500, 0, 36), many), "held_samples", "three in ten");
}

static void test_drop_outs_are_told_with_what_they_read(void**) {
  const auto runs = changed(rates(300, 50, 20), [](double y, double u) { return u < 0.01 ? -32768.0 : y; });
  const auto found = find_effect("held_samples").estimator()->detect(runs);
  assert_int_equal(found.size(), 1);
  assert_true(found[0].parameters.number("reads_dph") == -32768.0);
  assert_true(std::fabs(found[0].parameters.number("probability") - 0.01) < 0.004); // four standard errors
  assert_true(find_effect("saturation").estimator()->detect(runs).empty());
}

static void test_a_lattice_around_zero_is_no_dead_band(void**) {
  for (double lsb : {10.0, 36.0, 80.0, 150.0}) {
    const auto on_lattice = [lsb](double y, double) { return lsb * std::round(y / lsb); };
    const auto runs = changed(rates(0, 100, 36), on_lattice);
    assert_true(find_effect("dead_band").estimator()->detect(runs).empty());
    assert_findings(runs, "quantization", "lattice around zero");
  }
}

// Steps of a converter, turned into dph and printed with few decimals: no two places are whole multiples of one number.
static void test_a_printed_lattice_is_no_dead_band(void**) {
  const struct {
    double step_dph, printed_dph, sigma_dph;
  } cases[] = {{0.206265, 1e-3, 30}, {27.4809, 0.1, 100},   {27.4809, 1, 100}, {27.4809, 1, 30}, {27.4809, 0.36, 60},
               {0.549316, 0.1, 16},  {0.549316, 0.001, 16}, {0.2534, 0.1, 16}, {0.33, 0.1, 5},   {0.74, 0.1, 20}};
  for (const auto& c : cases)
    for (uint64_t seed = 1; seed < 8; ++seed) {
      const auto print = [&](double y, double) {
        return c.printed_dph * std::round(std::round(y / c.step_dph) * c.step_dph / c.printed_dph);
      };
      assert_true(find_effect("dead_band").estimator()->detect(changed(rates(0, 0, c.sigma_dph, seed), print)).empty());
    }
  const auto dead = [](double y, double) { return std::fabs(y) < 60 ? 0.0 : std::round(y); };
  for (uint64_t seed = 1; seed < 8; ++seed)
    assert_int_equal(find_effect("dead_band").estimator()->detect(changed(rates(0, 200, 36, seed), dead)).size(), 1);
}

// Logs of one device that were exported with different numbers of digits: zero is a step of the lattice of its log.
static void test_zeros_of_rounded_logs_among_finer_ones_are_no_dead_band(void**) {
  for (const double mean : {0.0, 60.0, 75.0, 90.0})
    for (uint64_t seed = 1; seed < 40; seed += 4)
      assert_findings(rounded_each(mean, 0, {1e-4, 0.01, 0.1, 0.5}, seed), "", "small beside the noise");
  std::vector<RunInput> dead = rates(0, 200, 36, 5);
  dead.push_back(rounded(rates(0, 200, 36, 7), 0.5).front());
  dead = changed(dead, [](double y, double) { return std::fabs(y) < 60 ? 0.0 : y; });
  dead.push_back(rounded(rates(0, 200, 36, 8), 60).front()); // that shows nothing of a band
  const auto found = find_effect("dead_band").estimator()->detect(dead);
  assert_int_equal(found.size(), 1);
  const double width = found[0].parameters.number("width_dph");
  assert_true(width >= 60 && width < 61);
  for (size_t r = 0; r < dead.size(); ++r)
    assert_int_equal(std::count(found[0].unusable[r].begin(), found[0].unusable[r].end(), 1) > 0, r < 3);
}

static std::vector<Signature> lattices_found(const std::vector<RunInput>& runs) {
  return find_effect("quantization").estimator()->detect(runs);
}

// Each step is told with its logs, and adds its variance there alone.
static void test_logs_rounded_to_other_steps_are_told_one_by_one(void**) {
  const std::vector<Signature> found = lattices_found(rounded_each(0, 100, {1, 18, 60, 1e-4, 18, 60}, 1));
  assert_int_equal(found.size(), 2);
  const double steps[] = {18, 60};
  for (size_t i = 0; i < 2; ++i) {
    assert_true(std::fabs(found[i].parameters.number("lsb_dph") - steps[i]) < 1e-9);
    for (size_t r = 0; r < 6; ++r)
      assert_true(std::fabs(found[i].white_dph2[r] - (r % 3 == 1 + i ? steps[i] * steps[i] / 12 : 0)) < 1e-6);
    assert_string_equal(found[i].statement.c_str(), "rates are multiples of one step");
  }
  assert_findings(rounded_each(0, 100, {1e-4, 1e-4, 60, 1e-4}, 1), "quantization", "one log of four");
  assert_findings(rounded_each(0, 100, {1, 1, 0.5, 0.1}, 1), "", "steps that add nothing to the noise");
}

static void test_one_step_of_all_logs_is_one_lattice(void**) {
  std::vector<RunInput> runs = rounded_each(0, 100, {36, 36, 36, 36}, 1);
  for (size_t r = 0; r < 3; ++r) runs[r].rate_dph.resize(100), runs[r].t_s.resize(100); // too short to tell alone
  for (const size_t n : {4u, 3u}) {
    runs.erase(runs.begin() + static_cast<long>(n), runs.end());
    const std::vector<Signature> found = lattices_found(runs);
    assert_int_equal(found.size(), 1);
    assert_true(std::fabs(found[0].parameters.number("lsb_dph") - 36) < 1e-9);
    for (const double white_dph2 : found[0].white_dph2) assert_true(std::fabs(white_dph2 - 108) < 1e-6);
    assert_string_equal(found[0].statement.c_str(), "all rates are multiples of one step");
  }
}

// Steps that the digits of a file do not hold exactly, and what has few values without any step.
static void test_a_lattice_is_known_by_its_whole_steps(void**) {
  std::vector<RunInput> runs = rounded(rounded(rates(50, 5, 0.3), 1.0 / 7), 1e-3);
  runs[0].rate_dph[100] = 1e6; // a hit
  const std::vector<Signature> found = lattices_found(runs);
  assert_int_equal(found.size(), 1);
  assert_true(std::fabs(found[0].parameters.number("lsb_dph") - 1.0 / 7) < 1e-4);
  std::vector<RunInput> held = rates(50, 5, 0.3);
  for (RunInput& run : held)
    for (size_t i = 0; i < run.size(); ++i) run.rate_dph[i] = run.rate_dph[i - i % 60];
  assert_int_equal(lattices_found(held).size(), 0);
}

static void test_saturation_is_a_pile_within_reach_of_the_noise(void**) {
  const auto clip = [](double y, double) { return std::min(y, 1180.0); };
  assert_findings(changed(rates(1000, 200, 36), clip), "saturation", "the top of a swing");
  assert_findings(changed(rates(0, 0, 36), [](double y, double) { return std::max(-70.0, std::min(70.0, y)); }),
                  "saturation", "both tails");
  std::vector<RunInput> runs = rates(0, 200, 36); // two logs that stand at the limit but for single samples
  for (RunInput& run : rates(0, 200, 36, 7)) {
    for (size_t i = 0; i < run.size(); ++i)
      if (i % 700 > 0) run.rate_dph[i] = 900;
    runs.push_back(run);
  }
  assert_findings(runs, "saturation", "full scale");
}

// The extreme of the coarsest log is beyond those of the others, and all its samples there are one value.
static void test_the_extreme_of_a_coarse_log_among_finer_ones_is_no_limit(void**) {
  for (const double lower : {0.0, 15.0, 30.0, 45.0})
    for (uint64_t seed = 1; seed < 40; seed += 4) {
      std::vector<RunInput> runs = rounded_each(0, 60, {1, 18, 7}, seed);
      runs.push_back(rounded(rates(-lower, 90, 36, seed + 3), 60).front());
      assert_true(find_effect("saturation").estimator()->detect(runs).empty());
    }
  const auto clip = [](double y, double) { return std::max(-110.0, std::min(110.0, y)); };
  std::vector<RunInput> runs = changed(rounded_each(0, 60, {1, 1e-4, 7}, 1), clip);
  runs.push_back(rounded(rates(0, 0, 36, 4), 60).front()); // reaches further by itself
  const auto found = find_effect("saturation").estimator()->detect(runs);
  assert_int_equal(found.size(), 1);
  for (size_t r = 0; r < runs.size(); ++r)
    assert_int_equal(std::count(found[0].unusable[r].begin(), found[0].unusable[r].end(), 1) > 0, r < 3);
}

// Rates in steps of 1.8 dph, compensated with a temperature whose noise covers many of its steps: equal neighbours come by
// chance, and no two values are equal where the temperature is another.  Eight equal neighbours, and no equal values two apart,
// as short logs may have by chance.
static void test_repeats_of_compensated_steps_are_chance(void**) {
  std::vector<RunInput> runs = rates(300, 0, 100);
  Rng rng(1, 5, 0, Stream::kThermometer);
  for (RunInput& run : runs)
    for (size_t i = 0; i < run.size(); ++i) {
      double& y = run.rate_dph[i];
      const double temp_degc = 20 + 0.04 * std::round(2 * rng.normal());
      y = 1.8 * std::round(y / 1.8) + 3.7 * temp_degc + 0.013 * temp_degc * temp_degc;
      while (i > 1 && (y == run.rate_dph[i - 2] || y == run.rate_dph[i - 1])) y += 1.8;
      if (i % 1500 == 700) y = run.rate_dph[i - 1];
    }
  assert_findings(runs, "", "compensated steps");
}

static void test_repeats_are_held_samples(void**) {
  auto runs = rates(200, 50, 36);
  for (size_t i = 50; i < 5900; i += 97) runs[0].rate_dph[i] = runs[0].rate_dph[i - 1];
  assert_findings(runs, "held_samples", "repeats");
}

// A quiet log in coarse steps reads zero most of the time, or stays at a step for minutes; that it is one of several changes
// nothing.
static void test_coarse_steps_are_neither_drop_outs_nor_repeats(void**) {
  const std::vector<RunInput> zero = rounded(rates(10, 0, 10, 4), 60), slow = rounded(rates(0, 100, 2, 5), 10);
  std::vector<RunInput> mixed = rates(0, 100, 36, 6);
  assert_findings(slow, "quantization", "a slow swing in all logs");
  mixed.push_back(rates(0, 100, 36, 7).front()), mixed.push_back(zero.front());
  const Effect& held = find_effect("held_samples");
  assert_true(held.estimator()->detect(mixed).empty());
  mixed.back() = slow.front();
  assert_true(held.estimator()->detect(mixed).empty());
}

static void test_drop_outs_and_repeats_are_found_beside_a_log_in_coarse_steps(void**) {
  std::vector<RunInput> dropped = changed(rates(300, 50, 20), [](double y, double u) { return u < 0.01 ? 0.0 : y; });
  std::vector<RunInput> held = rates(200, 50, 36);
  for (size_t i = 50; i < 5900; i += 97) held[0].rate_dph[i] = held[0].rate_dph[i - 1];
  dropped.push_back(rounded(rates(0, 50, 36, 3), 60).front()), held.push_back(dropped.back());
  assert_findings(dropped, "quantization, held_samples", "zeros far from the rate");
  const auto found = find_effect("held_samples").estimator()->detect(dropped);
  assert_int_equal(found.size(), 1);
  assert_int_equal(std::count(found[0].unusable[2].begin(), found[0].unusable[2].end(), 1), 0);
  for (double& y : held.back().rate_dph) y = 30 * std::round(y / 30 + 100); // fewer equal ones
  assert_findings(held, "quantization, held_samples", "repeats");
}

// A drop-out that was diagnosed can be simulated.
static void test_drop_outs_are_simulated_by_the_value_they_read(void**) {
  const Effect& effect = find_effect("held_samples");
  SimRun run;
  run.rate_dph.assign(10000, 250.0);
  run.t_s.assign(10000, 1.0);
  Rng rng(3, 0, 0, Stream::kEffect);
  const Json json = {{"probability", 0.02}, {"reads_dph", 0}};
  effect.simulate(SimStage::kOutput, read_parameters(effect, json), &run, &rng);
  size_t n = 0;
  for (double y : run.rate_dph) n += y == 0;
  assert_in_range(n, 144, 256); // four standard errors
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_sound_samples_have_no_finding),
      cmocka_unit_test(test_a_large_mean_makes_no_finding_and_hides_none),
      cmocka_unit_test(test_dead_band_is_found_by_its_shape),
      cmocka_unit_test(test_dead_band_has_the_width_of_the_band),
      cmocka_unit_test(test_zeros_far_from_the_rate_are_drop_outs),
      cmocka_unit_test(test_drop_outs_are_told_with_what_they_read),
      cmocka_unit_test(test_a_lattice_around_zero_is_no_dead_band),
      cmocka_unit_test(test_a_printed_lattice_is_no_dead_band),
      cmocka_unit_test(test_zeros_of_rounded_logs_among_finer_ones_are_no_dead_band),
      cmocka_unit_test(test_logs_rounded_to_other_steps_are_told_one_by_one),
      cmocka_unit_test(test_one_step_of_all_logs_is_one_lattice),
      cmocka_unit_test(test_a_lattice_is_known_by_its_whole_steps),
      cmocka_unit_test(test_saturation_is_a_pile_within_reach_of_the_noise),
      cmocka_unit_test(test_the_extreme_of_a_coarse_log_among_finer_ones_is_no_limit),
      cmocka_unit_test(test_repeats_of_compensated_steps_are_chance),
      cmocka_unit_test(test_repeats_are_held_samples),
      cmocka_unit_test(test_coarse_steps_are_neither_drop_outs_nor_repeats),
      cmocka_unit_test(test_drop_outs_and_repeats_are_found_beside_a_log_in_coarse_steps),
      cmocka_unit_test(test_drop_outs_are_simulated_by_the_value_they_read),
  };
  return cmocka_run_group_tests_name("sample findings", tests, nullptr, nullptr);
}
