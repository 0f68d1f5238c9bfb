// SPDX-License-Identifier: MIT
// Calibration error: the paper's figures 7-10 (reference values: reference figures A, tests/README.md), dense matrices as a second
// derivation, Monte Carlo of the very estimator.
#include <Eigen/Core>
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>

#include "analysis/profile/covariance.h"
#include "base/error.h"
#include "base/rng.h"
#include "base/units.h"
#include "dense.h"
#include "noise/whiten.h"
// Last: its macros (fail) collide with the standard library.
extern "C" {
#include <cmocka.h>
}

using namespace imucal;
using Eigen::MatrixXd;
using Eigen::VectorXd;

static ErrorModel model_of(double arw_deg_rt_h, std::vector<Markov> markov) {
  ErrorModel m;
  m.arw_deg_rt_h = arw_deg_rt_h;
  m.markov = std::move(markov);
  return m;
}

static Profile ramp_and_soak(double soak_s, int cycles = 1) {
  Profile p;
  p.start_degc = 0;
  const ProfileSegment soak{0, soak_s, 0}, up{0.6, 0, 60}, down{-0.6, 0, 0};
  for (int i = 0; i < cycles; ++i)
    for (const ProfileSegment& s : {soak, i % 2 ? down : up, soak}) p.segments.push_back(s);
  return p;
}

static CalibrationSetup paper_setup() {
  CalibrationSetup setup;
  setup.order = 3;
  setup.lo_degc = 0;
  setup.hi_degc = 60;
  setup.truth = setup.filter = model_of(0.6, {{20, 100}});
  setup.points = 13;
  return setup;
}

static void assert_within(double value, double reference, double relative) {
  if (std::abs(value / reference - 1) > relative)
    fail_msg("%.6g differs from %.6g by more than %g of it", value, reference, relative);
}

static void test_error_figure_7_ramp_only(void**) {
  const double reference[] = {13.09, 7.47, 6.20, 6.45, 6.29, 5.75, 5.43, 5.75, 6.29, 6.45, 6.20, 7.47, 13.09};
  const CalibrationError e = calibration_error(runs_of_profile(ramp_and_soak(0)), paper_setup());
  assert_int_equal(e.temp_degc.size(), 13);
  for (size_t i = 0; i < 13; ++i) {
    assert_float_equal(e.temp_degc[i], 5.0 * static_cast<double>(i), 1e-9);
    assert_within(e.sigma_dph[i], reference[i], 0.001);
    assert_float_equal(e.sigma_dph[i], e.believed_sigma_dph[i], 0);
  }
}

static void test_error_figure_8_soaks(void**) {
  const double soak_s[] = {300, 600, 1200, 1800}, reference[] = {10.18, 8.64, 6.93, 6.28};
  for (int i = 0; i < 4; ++i)
    assert_within(calibration_error(runs_of_profile(ramp_and_soak(soak_s[i])), paper_setup()).worst_dph, reference[i],
                  0.0012);
}

static void test_error_figure_9_cycles(void**) {
  const int cycles[] = {1, 2, 4, 8};
  const double reference[] = {6.93, 5.03, 3.56, 2.52};
  for (int i = 0; i < 4; ++i)
    assert_within(calibration_error(runs_of_profile(ramp_and_soak(1200, cycles[i])), paper_setup()).worst_dph,
                  reference[i], 0.002);
}

static void test_error_figure_10_truth_covariance(void**) {
  const Markov assumed[] = {{10, 30}, {10, 250}, {5, 100}, {40, 100}, {40, 250}};
  const double reference[] = {6.98, 7.01, 6.96, 6.94, 7.13};
  CalibrationSetup setup = paper_setup();
  for (int i = 0; i < 5; ++i) {
    setup.filter.markov = {assumed[i]};
    const CalibrationError e = calibration_error(runs_of_profile(ramp_and_soak(1200)), setup);
    assert_within(e.worst_dph, reference[i], 0.001);
    // A filter that is told less noise than there is believes too much, and the other way round.
    const bool told_less = 2 * assumed[i].sigma_dph * assumed[i].sigma_dph * assumed[i].tau_s < 2 * 400.0 * 100;
    assert_true(told_less == (e.believed_worst_dph < e.worst_dph));
  }
}

// --- second derivation: V as a dense matrix ----------------------------------------------------------------

static CalibrationRun uneven_run() {
  CalibrationRun run;
  double last_s = 0;
  for (int k = 0; k < 220; ++k) {
    const double t_s = k + (k > 60 ? 17 : 0) + (k > 150 ? 400 : 0);
    run.temp_degc.push_back(30 - 30 * std::cos(t_s / 140.0));
    run.step_s.push_back(k ? t_s - last_s : 1);
    last_s = t_s;
  }
  return run;
}

static MatrixXd dense_noise(const ErrorModel& m, const CalibrationRun& run, double turn_on_dph) {
  const auto n = static_cast<Eigen::Index>(run.temp_degc.size());
  VectorXd t(n);
  t(0) = 0;
  for (Eigen::Index k = 1; k < n; ++k) t(k) = t(k - 1) + run.step_s[static_cast<size_t>(k)];
  MatrixXd v = MatrixXd::Constant(n, n, turn_on_dph * turn_on_dph);
  for (Eigen::Index i = 0; i < n; ++i) {
    v(i, i) += std::pow(60 * m.arw_deg_rt_h, 2);
    for (Eigen::Index j = 0; j < n; ++j)
      for (const Markov& term : m.markov)
        v(i, j) += term.sigma_dph * term.sigma_dph * std::exp(-std::abs(t(i) - t(j)) / term.tau_s);
  }
  return v;
}

static void test_error_equals_dense_matrices_with_gaps_turn_on_and_many_terms(void**) {
  CalibrationSetup setup = paper_setup();
  setup.order = 4;
  setup.truth = model_of(0.5, {{14, 20}, {14, 70}, {5, 900}});
  setup.filter = model_of(0.7, {{20, 60}, {3, 2000}});
  setup.turn_on_constants = true;
  setup.truth.turn_on_sigma_dph = 40;
  setup.filter.turn_on_sigma_dph = 25;
  setup.prior_sigma_dph = 300;
  const std::vector<CalibrationRun> runs = {uneven_run(), uneven_run()};
  const Eigen::Index p = 5, n = static_cast<Eigen::Index>(runs[0].temp_degc.size());
  MatrixXd x(n, p);
  for (Eigen::Index k = 0; k < n; ++k)
    for (Eigen::Index i = 0; i < p; ++i)
      x(k, i) = std::pow(setup.normalised(runs[0].temp_degc[static_cast<size_t>(k)]), static_cast<double>(i));
  const MatrixXd u = dense_solve(dense_noise(setup.filter, runs[0], 25), x);
  const MatrixXd prior = MatrixXd::Identity(p, p) / 9e4;
  const MatrixXd believed = dense_inverse(2 * x.transpose() * u + prior);
  const MatrixXd actual =
      dense_sandwich(believed, 2 * dense_sandwich(u.transpose(), dense_noise(setup.truth, runs[0], 40)) + prior);
  const CalibrationError e = calibration_error(runs, setup);
  for (Eigen::Index i = 0; i < p * p; ++i) {
    assert_float_equal(e.believed_covariance[static_cast<size_t>(i)], believed.data()[i], 1e-8 * believed.norm());
    assert_float_equal(e.covariance[static_cast<size_t>(i)], actual.data()[i], 1e-8 * actual.norm());
  }
  // The matched way (forward pass only) agrees with the way that solves for V^-1 X.
  setup.truth = setup.filter;
  const CalibrationError matched = calibration_error(runs, setup);
  for (Eigen::Index i = 0; i < p * p; ++i)
    assert_float_equal(matched.covariance[static_cast<size_t>(i)], believed.data()[i], 1e-8 * believed.norm());
}

// --- Monte Carlo of the estimator --------------------------------------------------------------------------

// Error of B(T) at both ends and the middle for `n_runs` simulated tests against the truth covariance: the
// sampled variance over the predicted one is chi-square / n; its interval at 1e-4 (two-sided, normal
// approximation, 3.9 sigma).
static void check_against_monte_carlo(const ErrorModel& filter, const ErrorModel& truth, int n_runs, uint64_t seed) {
  CalibrationSetup setup = paper_setup();
  setup.filter = filter;
  setup.truth = truth;
  Profile profile = ramp_and_soak(150);
  profile.segments[1].rate_degc_per_min = 3; // 1500 s
  const std::vector<CalibrationRun> runs = runs_of_profile(profile);
  const CalibrationError predicted = calibration_error(runs, setup);
  const size_t n = runs[0].temp_degc.size(), p = 4;
  std::vector<double> u(n * p);
  MatrixXd x(static_cast<Eigen::Index>(n), 4);
  for (size_t k = 0; k < n; ++k)
    for (size_t i = 0; i < p; ++i)
      u[k * p + i] = x(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(i)) =
          std::pow(setup.normalised(runs[0].temp_degc[k]), static_cast<double>(i));
  solve_rows(compute_gains(sample_times(runs[0]), noise_of(filter)), p, u.data());
  const Eigen::Map<const MatrixXd> ut(u.data(), 4, static_cast<Eigen::Index>(n));
  const MatrixXd gain = dense_solve(ut * x, ut);
  double sums[3] = {};
  for (int run = 0; run < n_runs; ++run) {
    Rng white(seed, static_cast<uint64_t>(run), 0, Stream::kWhite),
        drive(seed, static_cast<uint64_t>(run), 0, Stream::kMarkov);
    VectorXd noise(static_cast<Eigen::Index>(n));
    std::vector<double> state;
    for (const Markov& m : truth.markov) state.push_back(m.sigma_dph * drive.normal());
    for (Eigen::Index k = 0; k < noise.size(); ++k) {
      noise(k) = 60 * truth.arw_deg_rt_h * white.normal();
      for (size_t i = 0; i < state.size(); ++i) {
        noise(k) += state[i];
        state[i] = truth.markov[i].phi() * state[i] + std::sqrt(truth.markov[i].q_dph2()) * drive.normal();
      }
    }
    const VectorXd error = gain * noise;
    const double at[3] = {error(0) - error(1) + error(2) - error(3), error(0), error.sum()};
    for (int i = 0; i < 3; ++i) sums[i] += at[i] * at[i];
  }
  const size_t place[3] = {0, 6, 12};
  for (int i = 0; i < 3; ++i) {
    const double ratio = sums[i] / n_runs / std::pow(predicted.sigma_dph[place[i]], 2);
    std::printf("[ INFO     ] Monte Carlo %d runs, T %g: variance ratio %.4f (interval +-%.4f)\n", n_runs,
                predicted.temp_degc[place[i]], ratio, 3.9 * std::sqrt(2.0 / n_runs));
    assert_true(std::abs(ratio - 1) < 3.9 * std::sqrt(2.0 / n_runs));
  }
}

static void test_truth_covariance_matches_monte_carlo(void**) {
  const ErrorModel nominal = model_of(0.6, {{20, 100}});
  check_against_monte_carlo(nominal, nominal, 3000, 11);
  check_against_monte_carlo(model_of(0.6, {{5, 30}}), nominal, 3000, 12);
  check_against_monte_carlo(nominal, model_of(1.1, {{14, 20}, {14, 70}}), 3000, 13);
}

// --- runs, restarts, shape ---------------------------------------------------------------------------------

static void test_turn_on_constants_hide_only_the_constant(void**) {
  CalibrationSetup setup = paper_setup();
  setup.truth.turn_on_sigma_dph = setup.filter.turn_on_sigma_dph = 200;
  Profile twice = ramp_and_soak(1200, 2);
  const CalibrationError without = calibration_error(runs_of_profile(twice), setup);
  setup.turn_on_constants = true;
  const CalibrationError with = calibration_error(runs_of_profile(twice), setup);
  assert_true(with.worst_dph > 190);
  setup.shape_only = true;
  const CalibrationError shape_with = calibration_error(runs_of_profile(twice), setup);
  setup.turn_on_constants = false;
  const CalibrationError shape_without = calibration_error(runs_of_profile(twice), setup);
  // In one run a constant is all in b0: the shape does not feel it.
  assert_within(shape_with.worst_dph, shape_without.worst_dph, 1e-3);
  // Mean square over the span = that of the shape + that of the mean value (their cross term integrates to
  // zero).
  assert_true(shape_without.rms_dph < without.rms_dph);
}

static void test_restart_each_cycle_continues_the_temperatures(void**) {
  Profile p = ramp_and_soak(1200);
  p.segments.push_back({-0.6, 0, 0});
  p.repeat = 3;
  const auto one = runs_of_profile(p), three = runs_of_profile(p, 1.0, true);
  assert_int_equal(one.size(), 1);
  assert_int_equal(three.size(), 3);
  assert_int_equal(one[0].temp_degc.size(), 3 * three[0].temp_degc.size());
  for (size_t k = 0; k < one[0].temp_degc.size(); k += 997)
    assert_float_equal(one[0].temp_degc[k],
                       three[k / three[0].temp_degc.size()].temp_degc[k % three[0].temp_degc.size()], 1e-9);
}

// --- impossible requests -----------------------------------------------------------------------------------

static void assert_refused(const std::vector<CalibrationRun>& runs, const CalibrationSetup& setup, const char* remedy) {
  try {
    calibration_error(runs, setup);
  } catch (const Error& e) {
    if (!strstr(e.what(), remedy)) fail_msg("'%s' does not say '%s'", e.what(), remedy);
    return;
  }
  fail_msg("accepted; expected a refusal that says '%s'", remedy);
}

static void test_error_impossible_requests_name_the_smallest_change(void**) {
  CalibrationSetup setup = paper_setup();
  const auto runs = runs_of_profile(ramp_and_soak(1200));
  setup.lo_degc = 60;
  setup.hi_degc = 0;
  assert_refused(runs, setup, "write 0:60");
  setup = paper_setup();
  setup.filter = model_of(0, {{0, 100}});
  assert_refused(runs, setup, "arw_deg_rt_h > 0");
  setup = paper_setup();
  CalibrationRun two_soaks;
  two_soaks.temp_degc.assign(500, 0.0);
  two_soaks.temp_degc.resize(1000, 60.0);
  assert_refused({two_soaks}, setup, "use --order 1");
  setup.order = 1;
  assert_true(calibration_error({two_soaks}, setup).worst_dph > 0);
  setup.order = 6;
  assert_refused(runs, setup, "0 to 5");
}

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_error_figure_7_ramp_only),
      cmocka_unit_test(test_error_figure_8_soaks),
      cmocka_unit_test(test_error_figure_9_cycles),
      cmocka_unit_test(test_error_figure_10_truth_covariance),
      cmocka_unit_test(test_error_equals_dense_matrices_with_gaps_turn_on_and_many_terms),
      cmocka_unit_test(test_truth_covariance_matches_monte_carlo),
      cmocka_unit_test(test_turn_on_constants_hide_only_the_constant),
      cmocka_unit_test(test_restart_each_cycle_continues_the_temperatures),
      cmocka_unit_test(test_error_impossible_requests_name_the_smallest_change),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
