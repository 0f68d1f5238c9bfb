// SPDX-License-Identifier: MIT
// The noise room against dense linear algebra and against itself.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/error.h"
#include "base/rng.h"
#include "dense.h"
#include "noise/covariance.h"
#include "noise/gains.h"
#include "noise/likelihood.h"
#include "noise/mixture.h"
#include "noise/steady_filter.h"
#include "noise/whiten.h"
// After the others: it defines a macro `fail`.
extern "C" {
#include <cmocka.h>
}

using namespace imucal;
using Eigen::MatrixXd;
using Eigen::VectorXd;

static void assert_near(double found, double expected, double tolerance) {
  if (!(std::fabs(found - expected) <= tolerance)) fail_msg("%.15g, expected %.15g", found, expected);
}

// Samples with gaps of one, of a few and of many ticks.
struct Case {
  std::vector<int> steps;
  std::vector<double> tn;
  NoiseModel noise;
  double dt_s = 1;

  explicit Case(size_t n, NoiseModel model) : noise(std::move(model)) {
    for (size_t k = 0; k < n; ++k) {
      steps.push_back(k % 97 == 5 ? 2 : k % 211 == 60 ? 7 : k == n / 2 ? 400 : 1);
      tn.push_back(std::sin(0.01 * static_cast<double>(k)));
    }
  }
  SampleTimes times() const { return {steps.size(), steps.data(), dt_s, tn.data()}; }
};

static NoiseModel model_of(double white, std::vector<Markov> markov, double walk = 0) {
  NoiseModel m;
  m.white_sigma_dph = white;
  m.markov = std::move(markov);
  m.walk_dph_per_rt_s = walk;
  return m;
}

static std::vector<NoiseModel> models() {
  NoiseModel slopes = model_of(30, {{20, 100}, {7, 700}});
  slopes.white_slope = 0.4, slopes.markov_slope = -0.6, slopes.tau_slope = 0.3;
  return {model_of(36, {}),
          model_of(36, {{20, 100}}),
          model_of(36, {{20, 100}, {7, 700}}),
          model_of(36, {{20, 100}, {7, 700}, {15, 3}}, 0.3),
          model_of(0, {{20, 30}, {7, 700}}),
          model_of(0.5, {{20, 30}, {19, 31}, {3, 5000}}, 0.01),
          slopes};
}

// The covariance written out; the first Markov term and the white noise follow temperature.  Of a term whose time
// constant follows it: the product of the transitions in between.
static MatrixXd dense(const Case& c) {
  const auto n = static_cast<long>(c.steps.size());
  std::vector<double> t(c.steps.size(), 0.0);
  for (size_t k = 1; k < t.size(); ++k) t[k] = t[k - 1] + c.steps[k] * c.dt_s;
  MatrixXd v = MatrixXd::Zero(n, n);
  for (long i = 0; i < n; ++i) {
    const auto at = static_cast<size_t>(i);
    v(i, i) += c.noise.white_sigma_dph * c.noise.white_sigma_dph / c.dt_s * std::exp(c.noise.white_slope * c.tn[at]);
    for (size_t m = 0; m < c.noise.markov.size(); ++m) {
      double exponent = 0;
      for (long j = i; j < n; ++j) {
        const auto to = static_cast<size_t>(j);
        if (j > i)
          exponent -=
              (t[to] - t[to - 1]) / c.noise.markov[m].tau_s / (m == 0 ? std::exp(c.noise.tau_slope * c.tn[to - 1]) : 1);
        const double scale = m == 0 ? std::exp(0.5 * c.noise.markov_slope * (c.tn[at] + c.tn[to])) : 1;
        const double value = c.noise.markov[m].sigma_dph * c.noise.markov[m].sigma_dph * scale * std::exp(exponent);
        v(i, j) += value;
        if (j > i) v(j, i) += value;
      }
    }
    for (long j = 0; j < n; ++j)
      v(i, j) += c.noise.walk_dph_per_rt_s * c.noise.walk_dph_per_rt_s * std::min(t[at], t[static_cast<size_t>(j)]);
  }
  return v;
}

static MatrixXd random_columns(size_t n, long p, uint64_t seed) {
  MatrixXd out(static_cast<long>(n), p);
  Rng rng(seed, 0, 0, Stream::kWhite);
  for (long i = 0; i < out.size(); ++i) out.data()[i] = rng.normal();
  return out;
}

static void test_whitening_equals_the_dense_factor_with_gaps(void**) {
  for (const NoiseModel& model : models()) {
    const Case c(700, model);
    const MatrixXd v = dense(c), x = random_columns(700, 11, 3);
    const DenseFactor factor(v);
    const RunGains gains = compute_gains(c.times(), c.noise);
    MatrixXd white = x;
    whiten(gains, &white);
    const MatrixXd expected = factor.half_solve(x);
    assert_near((white - expected).norm(), 0, 1e-9 * expected.norm());
    assert_near(gains.sum_log_s, factor.log_det(), 1e-9 * std::fabs(factor.log_det()));
  }
}

static void test_solve_equals_the_dense_inverse(void**) {
  for (const NoiseModel& model : models()) {
    const Case c(500, model);
    for (const long width : {1L, 3L, 6L, 13L}) {
      const MatrixXd x = random_columns(500, width, 4);
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = x;
      const RunGains gains = compute_gains(c.times(), c.noise);
      solve_rows(gains, static_cast<size_t>(width), rows.data());
      const MatrixXd expected = dense_solve(dense(c), x);
      assert_near((rows - expected).norm(), 0, 1e-8 * expected.norm());
    }
  }
}

static void test_norms_of_steps_equal_those_of_the_dense_inverse(void**) {
  for (const NoiseModel& model : models()) {
    const Case c(300, model);
    const VectorXd norms = step_norms(compute_gains(c.times(), c.noise));
    MatrixXd steps = MatrixXd::Zero(300, 300); // column k: 1 from sample k on
    for (long k = 0; k < 300; ++k) steps.col(k).tail(300 - k).setOnes();
    const VectorXd expected = steps.cwiseProduct(dense_solve(dense(c), steps)).colwise().sum();
    assert_near((norms - expected).norm(), 0, 1e-8 * expected.norm());
  }
}

static void test_covariance_times_equals_the_dense_product(void**) {
  for (const NoiseModel& model : models()) {
    if (!model.is_stationary()) continue;
    const Case c(500, model);
    const VectorXd x = random_columns(500, 1, 5);
    const VectorXd expected = dense(c) * x;
    assert_near((covariance_times(c.times(), c.noise, x) - expected).norm(), 0, 1e-12 * expected.norm());
  }
}

// The white noise that a run has of its own is as much noise as that of the model, where nothing settles and where all does.
static void test_white_noise_of_one_run_is_that_of_a_model(void**) {
  for (const NoiseModel& model : models()) {
    const Case c(700, model);
    SampleTimes own = c.times();
    own.own_white_dph2 = 300;
    NoiseModel of_all = c.noise;
    of_all.extra_white_dph2 += 300;
    const RunGains found = compute_gains(own, c.noise), expected = compute_gains(c.times(), of_all);
    assert_true(found.inv_sqrt_s == expected.inv_sqrt_s && found.gain == expected.gain);
    assert_true(found.sum_log_s == expected.sum_log_s);
    assert_true(found.sum_log_s != compute_gains(c.times(), c.noise).sum_log_s);
    if (!model.is_stationary()) continue;
    const VectorXd x = random_columns(700, 1, 5);
    assert_near((covariance_times(own, c.noise, x) - covariance_times(c.times(), of_all, x)).norm(), 0, 1e-9);
  }
}

static void test_paths_of_whitening_agree_and_colour_inverts_them(void**) {
  for (const NoiseModel& model : models()) {
    const Case c(3000, model);
    const RunGains gains = compute_gains(c.times(), c.noise);
    for (const long p : {2L, 4L, 5L, 11L, 13L, 23L}) {
      const MatrixXd x = random_columns(3000, p, 6);
      MatrixXd white = x;
      whiten(gains, &white);
      VectorXd alone = x.col(p - 1);
      whiten(gains, alone.data(), 3000);
      assert_near((white.col(p - 1) - alone).norm(), 0, 1e-12 * alone.norm());
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = x;
      whiten_rows(gains, static_cast<size_t>(p), rows.data());
      assert_near((white - rows).norm(), 0, 1e-12 * white.norm());
      assert_true(LaneColumns(x).whitened(gains) == white);
      const MatrixXd gram = dense_gram(white);
      assert_near((WideColumns(x).whitened_gram(gains) - gram).norm(), 0, 1e-11 * gram.norm());
      colour(gains, alone.data(), 3000);
      assert_near((alone - x.col(p - 1)).norm(), 0, 1e-9 * alone.norm());
    }
  }
}

// The one settling rule: no gain is further from the one that never settles than gains.h says.
static void check_settling(const NoiseModel& model, size_t n) {
  const VectorXd none = VectorXd::Zero(static_cast<long>(n));
  const SampleTimes even{n};
  const RunGains kept = compute_gains(even, model), exact = compute_gains(even, model, &none);
  assert_int_equal(exact.inv_sqrt_s.size(), n);
  assert_true(kept.inv_sqrt_s.size() < n / 2); // it did settle
  const double rate = std::pow(slowest_pole(model, 1, 1), 2), error = 1e-12 + 16 * 2.22e-16 / (1 - rate);
  const size_t last = kept.inv_sqrt_s.size() - 1;
  for (size_t k = last; k < n; k += 997) {
    assert_near(kept.inv_sqrt_s[last] / exact.inv_sqrt_s[k], 1, error);
    for (size_t i = 0; i < kept.n_states; ++i)
      assert_near(kept.gain[last * kept.n_states + i] / exact.gain[k * kept.n_states + i], 1, error);
  }
  assert_near(kept.sum_log_s, exact.sum_log_s, 1e-11 * std::fabs(exact.sum_log_s));
}

static void test_settled_gains_are_within_the_stated_error(void**) {
  check_settling(model_of(36, {{20, 100}}), 10000);
  check_settling(model_of(36, {{20, 100}, {7, 700}, {15, 3}}), 30000);
  check_settling(model_of(36, {{1, 10}, {5, 3000}}), 30000);
  check_settling(model_of(36, {{30, 2}, {1, 20000}}), 200000);
  check_settling(model_of(36, {{5, 50}}, 0.01), 200000);
  check_settling(model_of(3, {{20, 100}, {20, 101}}), 10000);
  check_settling(model_of(0, {{20, 30}, {7, 700}}), 30000);
  check_settling(model_of(100, {{1, 300}}), 30000);
  check_settling(model_of(36, {}), 100);
}

// The recursion of the gains and the closed form: two derivations of the same filter.
static void test_gains_end_at_the_closed_form(void**) {
  for (const NoiseModel& model : {model_of(36, {{20, 100}}), model_of(36, {{7, 700}, {20, 100}, {15, 3}}),
                                  model_of(36, {{5, 50}}, 0.3), model_of(3, {{20, 30}, {9, 400}}, 1)}) {
    const RunGains gains = compute_gains(SampleTimes{30000}, model);
    const SteadyFilter steady = steady_filter(model, 1, 1);
    const size_t last = gains.inv_sqrt_s.size() - 1, m = gains.n_states;
    assert_near(std::pow(gains.inv_sqrt_s[last], -2) / steady.innovation_variance_dph2, 1, 1e-10);
    std::vector<double> found, expected;
    for (size_t i = 0; i < m; ++i) found.push_back(gains.gain[last * m + i]), expected.push_back(steady.gain[i]);
    std::sort(found.begin(), found.end()), std::sort(expected.begin(), expected.end());
    for (size_t i = 0; i < m; ++i) assert_near(found[i] / expected[i], 1, 1e-9);
    assert_near((1 - slowest_pole(model, 1, 1)) / (1 - *std::max_element(steady.pole.begin(), steady.pole.end())), 1,
                1e-3);
  }
}

static void test_steps_in_seconds_are_steps_in_ticks(void**) {
  Case c(900, model_of(36, {{20, 100}, {7, 700}}));
  c.dt_s = 0.5;
  std::vector<double> step_s;
  for (const int step : c.steps) step_s.push_back(0.5 * step);
  SampleTimes in_seconds{step_s.size(), nullptr, 0.5};
  in_seconds.step_s = step_s.data();
  MatrixXd a = random_columns(900, 3, 7), b = a;
  whiten(compute_gains(c.times(), c.noise), &a);
  whiten(compute_gains(in_seconds, c.noise), &b);
  assert_true(a == b);
  const MatrixXd expected = DenseFactor(dense(c)).half_solve(random_columns(900, 3, 7));
  assert_near((a - expected).norm(), 0, 1e-10 * expected.norm());
}

static void test_mixtures_reduce_to_the_gaussian_they_contain(void**) {
  Case c(1200, model_of(36, {{20, 100}, {7, 700}}));
  const VectorXd y = 40 * random_columns(1200, 1, 8);
  const RunGains gains = compute_gains(c.times(), c.noise);
  VectorXd e = y, scores;
  whiten(gains, e.data(), 1200);
  const double gaussian = -0.5 * (gains.sum_log_s + e.squaredNorm());
  NoiseModel rare = c.noise, still = c.noise;
  rare.hit_probability = 1e-12, rare.hit_sigma_dph = 100;
  still.telegraph_dph = 1e-9, still.telegraph_tau_s = 50;
  assert_near(mixture_log_likelihood(c.times(), rare, y, &scores), gaussian, 1e-6);
  assert_near((scores - e).norm(), 0, 1e-6 * e.norm());
  assert_near(mixture_log_likelihood(c.times(), still, y), gaussian, 1e-6);
}

// White noise alone: samples are independent and the density of the mixture is known in closed form.
static void test_mixtures_of_white_noise_are_exact(void**) {
  Case c(300, model_of(36, {}));
  const VectorXd y = 60 * random_columns(300, 1, 9);
  const auto density = [](double x, double variance) {
    return std::exp(-0.5 * x * x / variance) / std::sqrt(variance);
  };
  NoiseModel hits = c.noise;
  hits.hit_probability = 0.1, hits.hit_sigma_dph = 150;
  double expected = 0;
  VectorXd hit;
  const double found = mixture_log_likelihood(c.times(), hits, y, nullptr, &hit);
  for (long k = 0; k < y.size(); ++k) {
    const double quiet = 0.9 * density(y[k], 36 * 36), loud = 0.1 * density(y[k], 36 * 36 + 150 * 150);
    expected += std::log(quiet + loud);
    assert_near(hit[k], loud / (quiet + loud), 1e-12);
  }
  assert_near(found, expected, 1e-9 * std::fabs(expected));
  const VectorXd further = expected_hit_dph2(c.times(), hits, y);
  for (long k = 0; k < y.size(); ++k) // precision of the white noise, as expected
    assert_near(1 / (36 * 36 + further[k]), (1 - hit[k]) / (36 * 36) + hit[k] / (36 * 36 + 150 * 150), 1e-12);
  // A telegraph that switches at every step without memory: half and half, independent.
  NoiseModel telegraph = c.noise;
  telegraph.telegraph_dph = 50, telegraph.telegraph_tau_s = 1e-6;
  expected = 0;
  for (long k = 0; k < y.size(); ++k)
    expected += std::log(0.5 * density(y[k] - 50, 36 * 36) + 0.5 * density(y[k] + 50, 36 * 36));
  assert_near(mixture_log_likelihood(c.times(), telegraph, y), expected, 1e-9 * std::fabs(expected));
}

// Beside rare hits of 30,000 times the noise a sample that is none keeps its weight, and one that is has none.
static void test_rare_large_hits_leave_other_samples_their_weight(void**) {
  Case c(300, model_of(36, {{20, 100}}));
  VectorXd y = 36 * random_columns(300, 1, 10);
  y[150] = -9e5;
  NoiseModel hits = c.noise;
  hits.hit_probability = 4e-4, hits.hit_sigma_dph = 1e6;
  const VectorXd further = expected_hit_dph2(c.times(), hits, y);
  assert_near(further[150], 1e12, 1e6);
  for (long k = 0; k < y.size(); ++k)
    if (k != 150) assert_true(further[k] >= 0 && further[k] < 0.01 * 36 * 36);
}

// Beside white noise alone the levels are a hidden chain: every one of its 2^12 paths, with seconds missing.
static void test_levels_of_telegraph_noise_are_those_of_all_paths(void**) {
  constexpr long kN = 12;
  const std::vector<int> steps = {1, 1, 1, 4, 1, 1, 2, 1, 1, 1, 1, 1};
  NoiseModel noise = model_of(36, {});
  noise.telegraph_dph = 30, noise.telegraph_tau_s = 6;
  SampleTimes times{kN, steps.data()};
  const VectorXd y = 45 * random_columns(kN, 1, 10);
  VectorXd expected = VectorXd::Zero(kN);
  double all = 0;
  for (int path = 0; path < 1 << kN; ++path) {
    const auto level = [&](long k) { return path >> k & 1 ? 30.0 : -30.0; };
    double p = 1;
    for (long k = 0; k < kN; ++k) {
      p *= std::exp(-0.5 * std::pow((y[k] - level(k)) / 36, 2));
      const double stays = 0.5 * (1 + std::exp(-times.seconds(static_cast<size_t>(k)) / 6));
      if (k > 0) p *= level(k) == level(k - 1) ? stays : 1 - stays;
    }
    all += p;
    for (long k = 0; k < kN; ++k) expected[k] += p * level(k);
  }
  const TelegraphLevel level = telegraph_level(times, noise, y);
  for (long k = 0; k < kN; ++k) {
    assert_near(level.mean_dph[k], expected[k] / all, 1e-9);
    assert_near(level.variance_dph2[k], 900 - std::pow(expected[k] / all, 2), 1e-6);
  }
}

static void test_too_many_states_are_refused(void**) {
  NoiseModel m = model_of(1, {});
  for (size_t k = 0; k <= kMostStates; ++k) m.markov.push_back({1, 1.0 + static_cast<double>(k)});
  bool is_refused = false;
  try {
    compute_gains(SampleTimes{10}, m);
  } catch (const Error&) {
    is_refused = true;
  }
  assert_true(is_refused);
  m.markov.pop_back();
  compute_gains(SampleTimes{10}, m);
}

// Five runs of different lengths with gaps: four side by side and one alone, by gains that are kept and by gains that are not.
static void test_runs_side_by_side_have_the_likelihood_of_each_alone(void**) {
  NoiseModel follows = model_of(30, {{20, 100}}), all = follows;
  follows.white_slope = 0.8;
  all.white_slope = -0.5, all.markov_slope = 0.7, all.tau_slope = 0.4;
  for (const NoiseModel& model : {follows, all, model_of(30, {{20, 100}}), model_of(30, {})}) {
    std::vector<Case> cases;
    for (const size_t n : {700u, 300u, 701u, 4u, 900u}) cases.emplace_back(n, model);
    std::vector<SampleTimes> times;
    std::vector<MatrixXd> residuals;
    std::vector<const double*> columns;
    double expected = 0;
    for (const Case& c : cases) {
      residuals.push_back(50 * random_columns(c.steps.size(), 1, 7 + c.steps.size()));
      MatrixXd e = residuals.back();
      const RunGains gains = compute_gains(c.times(), model);
      whiten(gains, &e);
      expected -= 0.5 * (gains.sum_log_s + e.squaredNorm());
      times.push_back(c.times());
    }
    for (const MatrixXd& x : residuals) columns.push_back(x.data());
    assert_true(can_follow(model));
    assert_near(follow_log_likelihood(times, model, columns), expected, 1e-11 * std::fabs(expected));
  }
  assert_false(can_follow(model_of(30, {{20, 100}, {7, 700}})));
  assert_false(can_follow(model_of(30, {{20, 100}}, 0.3)));
}

static void test_column_products_are_those_of_the_matrices(void**) {
  Rng rng(8, 0, 0, Stream::kWhite);
  for (long n : {1L, 7L, 8L, 513L, 1100L})
    for (long p : {1L, 4L, 6L})
      for (long q : {1L, 2L, 5L}) {
        MatrixXd a(n + 3, p), b(n, q); // a: a part of larger columns
        for (long i = 0; i < a.size(); ++i) a.data()[i] = rng.normal();
        for (long i = 0; i < b.size(); ++i) b.data()[i] = rng.normal();
        const MatrixXd expected = a.topRows(n).transpose() * b;
        const MatrixXd found = column_products(a.topRows(n), b);
        assert_int_equal(found.rows(), p);
        assert_int_equal(found.cols(), q);
        assert_near((found - expected).norm(), 0, 1e-12 * std::sqrt(static_cast<double>(n * p * q)));
      }
}

static void test_a_column_gram_is_the_product_of_columns_with_themselves(void**) {
  Rng rng(9, 0, 0, Stream::kWhite);
  for (long n : {1L, 8L, 600L})
    for (long p : {1L, 2L, 3L, 4L, 7L, 9L, 24L}) {
      MatrixXd a(n, p);
      for (long i = 0; i < a.size(); ++i) a.data()[i] = rng.normal();
      assert_true(column_gram(a) == column_products(a, a)); // the same bits, so symmetric
    }
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_whitening_equals_the_dense_factor_with_gaps),
      cmocka_unit_test(test_solve_equals_the_dense_inverse),
      cmocka_unit_test(test_norms_of_steps_equal_those_of_the_dense_inverse),
      cmocka_unit_test(test_covariance_times_equals_the_dense_product),
      cmocka_unit_test(test_white_noise_of_one_run_is_that_of_a_model),
      cmocka_unit_test(test_paths_of_whitening_agree_and_colour_inverts_them),
      cmocka_unit_test(test_settled_gains_are_within_the_stated_error),
      cmocka_unit_test(test_gains_end_at_the_closed_form),
      cmocka_unit_test(test_steps_in_seconds_are_steps_in_ticks),
      cmocka_unit_test(test_mixtures_reduce_to_the_gaussian_they_contain),
      cmocka_unit_test(test_mixtures_of_white_noise_are_exact),
      cmocka_unit_test(test_rare_large_hits_leave_other_samples_their_weight),
      cmocka_unit_test(test_levels_of_telegraph_noise_are_those_of_all_paths),
      cmocka_unit_test(test_too_many_states_are_refused),
      cmocka_unit_test(test_runs_side_by_side_have_the_likelihood_of_each_alone),
      cmocka_unit_test(test_column_products_are_those_of_the_matrices),
      cmocka_unit_test(test_a_column_gram_is_the_product_of_columns_with_themselves),
  };
  return cmocka_run_group_tests_name("noise", tests, nullptr, nullptr);
}
