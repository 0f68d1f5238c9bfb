// SPDX-License-Identifier: MIT
// Fits: the likelihood against dense matrices, the bounding program against vertices and random points, models back
// from noise-free curves and from simulated tests.
#include <Eigen/Core>
#include <cmath>
#include <limits>

#include "analysis/dp/tau_grid.h"
#include "analysis/errormodel/curve_fit.h"
#include "analysis/errormodel/likelihood.h"
#include "analysis/errormodel/lp.h"
#include "analysis/errormodel/simulate.h"
#include "analysis/errormodel/study.h"
#include "base/error.h"
#include "base/quantile.h"
#include "base/rng.h"
#include "base/units.h"
#include "dense.h"

#include "near.h"
#include "physics/effects/closed_forms.h"

using namespace imucal;

namespace {

const ErrorModel kNominal = {0.6, {{20, 100}}, 0, {}, {}};
const ErrorModel kTwoTerms = {0.5, {{18, 12}, {17, 160}}, 0, {}, {}};

Series test_record(const ErrorModel& m, long n, uint64_t run) {
  Series s = empty_record(n, 1);
  s.log = "test", s.axis = "gx_dph";
  s.rate_dph = simulate_noise(noise_components(m), n, 31, run);
  return s;
}

void test_trend_removes_what_the_columns_do(void**) {
  for (const long n : {5000L, 4096L, 37L})
    for (const char* text : {"none", "mean", "poly:0", "poly:1", "poly:2", "poly:3", "time:4", "poly:5", "poly:6",
                             "poly:7", "poly:8", "time:9"})
      for (const bool has_gap : {false, true}) {
        Series shape = test_record(kNominal, n, 5);
        for (long i = 0; i < n; ++i)
          shape.temp_degc.push_back(20 + 15 * std::sin(0.004 * static_cast<double>(i)) +
                                    0.01 * static_cast<double>(i % 7));
        for (size_t i = 10; has_gap && i < 20; ++i) shape.rate_dph[i] = std::nan(""), ++shape.n_missing;
        const Detrend detrend = Detrend::parse(text);
        Series by_columns = shape, by_trend = shape;
        remove_columns(detrend_basis(shape, detrend), &by_columns);
        Trend(shape, detrend).remove_from(&by_trend);
        for (size_t i = 0; i < shape.rate_dph.size(); ++i) {
          if (std::isnan(shape.rate_dph[i])) assert_true(std::isnan(by_trend.rate_dph[i]));
          if (!std::isnan(shape.rate_dph[i])) assert_near(by_trend.rate_dph[i], by_columns.rate_dph[i], 1e-9);
        }
      }
}

// Records of unequal lengths, more of them than lanes; every kind of component, one to nine of them.
void test_records_simulated_together_have_the_bits_of_each_alone(void**) {
  using Kind = NoiseComponent::Kind;
  const std::vector<NoiseComponent> kinds = {
      white_component(900),           markov_component(400, 30), {Kind::kAngleQuantization, 25, 0, 0},
      {Kind::kRandomWalk, 0.1, 0, 0}, {Kind::kRamp, 1e-4, 0, 0}, {Kind::kSinusoid, 9, 0, 0.2}};
  const std::vector<NoiseRecord> records = {{1000, 3, 0}, {1000, 4, 0}, {1000, 5, 0}, {1000, 6, 1}, {1000, 7, 1},
                                            {513, 3, 2},  {513, 4, 2},  {1, 4, 3},    {1, 5, 3}};
  for (const std::vector<size_t>& chosen : std::vector<std::vector<size_t>>{
           {0}, {1}, {0, 1}, {0, 1, 2}, {3, 2, 1, 0}, {0, 4}, {5, 1}, {0, 1, 1, 1, 2}, {}}) {
    std::vector<NoiseComponent> components;
    for (const size_t k : chosen) components.push_back(kinds[k]);
    const auto together = simulate_noises(components, 17, records);
    assert_int_equal(together.size(), records.size());
    for (size_t r = 0; r < records.size(); ++r) {
      const auto alone = simulate_noise(components, records[r].n, 17, records[r].run, records[r].axis);
      assert_int_equal(together[r].size(), alone.size());
      assert_memory_equal(together[r].data(), alone.data(), alone.size() * sizeof(double));
    }
  }
}

double dense_deviance(const Series& s, const Detrend& detrend, const ErrorModel& m) {
  std::vector<long> present;
  for (long i = 0; i < s.size(); ++i)
    if (!std::isnan(s.rate_dph[static_cast<size_t>(i)])) present.push_back(i);
  const auto n = static_cast<long>(present.size());
  Eigen::MatrixXd v(n, n);
  Eigen::VectorXd y(n);
  const auto basis = detrend_basis(s, detrend);
  Eigen::MatrixXd x(n, static_cast<long>(basis.size()));
  for (long a = 0; a < n; ++a) {
    y[a] = s.rate_dph[static_cast<size_t>(present[a])];
    for (size_t c = 0; c < basis.size(); ++c) x(a, static_cast<long>(c)) = basis[c][static_cast<size_t>(present[a])];
    for (long b = 0; b < n; ++b) {
      v(a, b) = a == b ? std::pow(60 * m.arw_deg_rt_h, 2) : 0;
      for (const Markov& t : m.markov)
        v(a, b) +=
            t.sigma_dph * t.sigma_dph * std::exp(-std::fabs(static_cast<double>(present[a] - present[b])) / t.tau_s);
    }
  }
  const DenseFactor factor(v);
  const Eigen::VectorXd e = factor.half_solve(y);
  double deviance = factor.log_det() + e.squaredNorm();
  if (x.cols() > 0) { // Eigen's triangular solve refers to the first column of its right side
    const Eigen::MatrixXd whitened = factor.half_solve(x);
    const DenseFactor gram(dense_gram(whitened));
    deviance += gram.log_det() - gram.half_solve(whitened.transpose() * e).squaredNorm();
  }
  return deviance + static_cast<double>(n - x.cols()) * std::log(2 * kPi);
}

void test_likelihood_equals_dense_matrices(void**) {
  for (bool with_gaps : {false, true})
    for (const char* text : {"none", "mean", "poly:2", "time:4"})
      for (const ErrorModel& m : {kNominal, kTwoTerms, ErrorModel{0.7, {}, 0, {}, {}}}) {
        Series s = test_record(kTwoTerms, 400, 1);
        for (long i = 0; i < s.size(); ++i) s.temp_degc.push_back(10 + 0.05 * static_cast<double>(i));
        for (long i : {0L, 7L, 120L, 121L, 122L, 300L, 399L}) {
          if (!with_gaps) continue;
          s.rate_dph[static_cast<size_t>(i)] = std::numeric_limits<double>::quiet_NaN();
          ++s.n_missing;
        }
        const Detrend detrend = Detrend::parse(text);
        const double expected = dense_deviance(s, detrend, m);
        assert_near(Likelihood({s}, detrend).deviance(m), expected, 1e-8 * std::fabs(expected));
        // Two records are independent.
        assert_near(Likelihood({s, s}, detrend).deviance(m), 2 * expected, 1e-8 * std::fabs(expected));
      }
}

void test_likelihood_profile_is_the_best_scale(void**) {
  const Series s = test_record(kNominal, 2000, 2);
  const Likelihood likelihood({s}, Detrend{});
  const auto best = likelihood.profile({400.0 / 1296}, {100});
  for (double scale : {0.98, 1.0, 1.02}) {
    const double white = best.white_variance * scale;
    const ErrorModel m = {std::sqrt(white) / 60, {{std::sqrt(white * 400 / 1296), 100}}, 0, {}, {}};
    const double deviance = likelihood.deviance(m);
    if (scale == 1.0)
      assert_near(deviance, best.deviance, 1e-7 * std::fabs(deviance));
    else
      assert_true(deviance > best.deviance);
  }
}

// Random programs: Clp and the small simplex agree, every row holds, and no random feasible point is better.
void test_bounding_programs_agree_and_are_optimal(void**) {
  Rng rng(5, 0, 0, Stream::kTool);
  for (int trial = 0; trial < 40; ++trial) {
    const size_t n_columns = 2 + static_cast<size_t>(trial % 4), n_rows = 60;
    BoundingProgram program;
    for (size_t j = 0; j < n_columns; ++j) {
      std::vector<double> column;
      for (size_t i = 0; i < n_rows; ++i)
        column.push_back(std::pow(10, static_cast<double>(j)) * (0.05 + rng.uniform()));
      program.columns.push_back(column);
    }
    std::vector<const double*> columns;
    for (const auto& c : program.columns) columns.push_back(c.data());
    const auto a = solve_bounding(program), b = solve_bounding_small(columns, n_rows);
    assert_near(a.objective, b.objective, 1e-6 * (1 + a.objective));
    for (int draw = 0; draw < 200; ++draw) {
      std::vector<double> x;
      for (double v : b.x) x.push_back(v * std::exp(0.3 * rng.normal()) + (v == 0 ? 1e-3 * rng.uniform() : 0));
      double least = std::numeric_limits<double>::infinity(), sum = 0;
      for (size_t i = 0; i < n_rows; ++i) {
        double value = 0, at_b = 0;
        for (size_t j = 0; j < n_columns; ++j) value += columns[j][i] * x[j], at_b += columns[j][i] * b.x[j];
        assert_true(at_b >= 1 - 1e-9);
        least = std::min(least, value), sum += value;
      }
      assert_true(sum / least - static_cast<double>(n_rows) >= b.objective - 1e-7 * (1 + b.objective));
    }
  }
}

CurveData exact_curve(const ErrorModel& m, const Series& shape, const DpOperator& op) {
  std::vector<Series> all = {test_record(m, shape.size(), 1)};
  CurveData data = make_curve_data(all, op, Detrend{}, parse_tau("2:300", 1, 0), Across::kRms);
  data.shapes = {&shape};
  data.mean_square_dph2 = CurveBasis(data).model(m);
  return data;
}

void test_fits_of_an_exact_curve_return_the_model(void**) {
  const Series shape = empty_record(6000, 1);
  const ErrorModel truth = {1.1, {{14, 20}, {14, 90}}, 0, {}, {}};
  for (DpType type : {DpType::kAv, DpType::kDp2}) {
    const CurveData data = exact_curve(truth, shape, make_dp_operator(type, 1, kNominal));
    for (const CurveFit& fit : {fit_bound(data, 2), fit_least_squares(data, 2)}) {
      assert_int_equal(fit.model.markov.size(), 2);
      assert_near(fit.model.arw_deg_rt_h, 1.1, 0.01);
      for (size_t k = 0; k < 2; ++k) {
        assert_near(fit.model.markov[k].sigma_dph, 14, 1.0);
        assert_near(std::log(fit.model.markov[k].tau_s / truth.markov[k].tau_s), 0, 0.12);
      }
      assert_true(fit.excess.worst < 2e-3);
    }
  }
}

// A simulated test: the bound holds at every tau, its objective reaches that of the whole grid, more terms never do
// worse, and least squares lies below it.
void test_bound_of_simulated_tests_holds_and_is_tight(void**) {
  const ErrorModel truth = {1.1, {{14, 20}, {14, 70}}, 0, {}, {}};
  const DpOperator op = make_dp_operator(DpType::kDp2, 1, kNominal);
  for (uint64_t run = 0; run < 4; ++run) {
    std::vector<Series> all = {test_record(truth, 6000, run)};
    remove_trend(Detrend{}, &all[0]);
    const CurveData data = make_curve_data(all, op, Detrend{}, parse_tau("2:600:4", 1, 0), Across::kRms);
    double last = std::numeric_limits<double>::infinity();
    for (int n = 1; n <= 3; ++n) {
      const CurveFit fit = fit_bound(data, n);
      assert_true(fit.bounded);
      assert_true(fit.excess.worst_ratio >= 1 - 1e-9);
      assert_false(fit.excess.active_tau_s.empty());
      assert_true(fit.objective <= last * (1 + 1e-6));
      last = fit.objective;
      if (n >= 2) assert_true(fit.objective < 1.25 * fit.grid_objective + 0.2);
    }
    const CurveFit chosen = fit_bound(data, -1);
    assert_true(chosen.bounded);
    assert_true(fit_least_squares(data, 2).excess.worst_ratio < 1);
  }
}

// A polynomial fitted to the same data takes low-frequency noise away; the expectation the fits use says how much: the
// mean over 150 simulated tests agrees with it within 3 standard errors and is far from the curve without it.
void test_detrended_fit_allows_for_what_the_polynomial_took(void**) {
  const ErrorModel truth = {0.6, {{20, 300}}, 0, {}, {}};
  const DpOperator op = make_dp_operator(DpType::kAv, 1, {});
  const Detrend detrend = Detrend::parse("time:5");
  std::vector<double> squares;
  double with = 0, without = 0;
  for (uint64_t run = 0; run < 150; ++run) {
    std::vector<Series> all = {test_record(truth, 6000, run)};
    remove_trend(detrend, &all[0]);
    const CurveData data = make_curve_data(all, op, detrend, {500}, Across::kRms);
    squares.push_back(data.mean_square_dph2[0]);
    if (run > 0) continue;
    with = CurveBasis(data).model(truth)[0];
    without = std::pow(expected_dp_dph(truth, op, {500})[0], 2) * 2;
  }
  const Spread spread = spread_of(squares);
  const double error = spread.sd / std::sqrt(150.0);
  assert_near(spread.mean, with, 3 * error);
  assert_true(without > with + 5 * error);
}

// Many n after a polynomial are interpolated from 40: equal to each by itself.
void test_interpolated_record_expectation_equals_each_by_itself(void**) {
  const DpOperator op = make_dp_operator(DpType::kDp2, 1, kNominal);
  std::vector<Series> all = {test_record(kNominal, 6000, 1)};
  const Detrend detrend = Detrend::parse("time:4");
  const auto few = parse_tau("3,17,90,205,333,580", 1, 0);
  const CurveData many = make_curve_data(all, op, detrend, parse_tau("2:600", 1, 0), Across::kRms);
  const auto got = CurveBasis(many).model(kTwoTerms);
  const auto expected = expected_record_dp_dph(kTwoTerms, op, all[0], detrend, few);
  for (size_t i = 0; i < few.size(); ++i)
    assert_near(std::sqrt(0.5 * got[static_cast<size_t>(few[i]) - 2]) / expected[i], 1, 2e-4);
}

// Spaced windows stand for all between them: refits weigh the taus as the fit does.  (A window less at the record's end is
// up to an eighth of a window: 1.3 % at a tenth of the record.)
void test_curve_of_some_windows_has_the_weights_of_all(void**) {
  const DpOperator op = make_dp_operator(DpType::kAv, 1, {});
  std::vector<Series> all = {test_record(kNominal, 6000, 1)};
  all[0].rate_dph[3000] = std::nan(""), all[0].n_missing = 1;
  const auto tau_s = parse_tau("2,7,16,50,200,600", 1, 0);
  const CurveData every = make_curve_data(all, op, Detrend{}, tau_s, Across::kRms, Windows::kAll);
  const CurveData some = make_curve_data(all, op, Detrend{}, tau_s, Across::kRms, Windows::kSome);
  for (size_t i = 0; i < tau_s.size(); ++i) assert_near(some.dof[i] / every.dof[i], 1, 0.04);
}

// What a polynomial takes from a long record is found on a coarse one: equal to the whole record's, below one coarse sample
// (0.6 s) too, with a gap and for time constants up to a third of the record.
void test_long_record_made_coarse_expects_what_the_whole_does(void**) {
  Series s = empty_record(100000, 0.1);
  s.temp_degc.resize(100000);
  for (size_t i = 0; i < s.temp_degc.size(); ++i)
    s.temp_degc[i] = 20 + 15 * std::sin(2 * kPi * static_cast<double>(i) / 1e5);
  for (size_t i = 40000; i < 43000; ++i) s.rate_dph[i] = s.temp_degc[i] = std::nan(""), ++s.n_missing;
  const std::vector<double> tau_s = {0.1, 0.3, 0.6, 1.2, 10, 60, 300, 1500, 2500};
  CurveData data;
  data.op = make_dp_operator(DpType::kAv, 0.1, {});
  data.detrend = Detrend::parse("poly:3");
  for (const double tau : tau_s) data.n.push_back(std::lround(tau / 0.1));
  data.shapes = {&s};
  data.record_s = 10000;
  const CurveBasis basis(data);
  const std::vector<double>& grid_s = basis.grid_tau_s();
  const std::vector<size_t> places = {0, grid_s.size() / 3, grid_s.size() / 2, grid_s.size() - 1};
  std::vector<NoiseComponent> components = {white_component(1)};
  for (const size_t i : places) components.push_back(markov_component(1, grid_s[i], 0.1));
  const auto expected = expected_record_squares(components, data.op, s, data.detrend, data.n);
  for (size_t k = 0; k < tau_s.size(); ++k) {
    assert_near(basis.white()[k] / expected[0][k], 1, 2e-4);
    for (size_t j = 0; j < places.size(); ++j)
      assert_near(basis.grid_column(places[j])[k] / expected[j + 1][k], 1, 2e-4);
  }
}

// One draw: a record of white noise, its fit by least squares, the interval by 20 refits that have their own random numbers.
ParameterError interval_by_refits(uint64_t run) {
  const ErrorModel white = {0.6, {}, 0, {}, {}};
  std::vector<Series> series = {test_record(white, 300, run)};
  remove_trend(Detrend{}, &series[0]);
  const DpOperator op = make_dp_operator(DpType::kAv, 1, {});
  FitSettings settings;
  settings.criterion = "ls", settings.n_markov = 0, settings.tau_s = {1, 2, 4, 8, 16, 32};
  return bootstrap_errors(series, op, settings, fit_model(series, op, settings), 20, 5000 + run, 1)[0];
}

// The interval of the next one of m normal draws holds as often as it says, however small m: quantiles of 20 refits, the
// same ones for every record, held 80 % at times.
void test_interval_by_few_refits_holds_as_often_as_it_says(void**) {
  constexpr int kDraws = 400;
  int covered = 0;
  for (uint64_t run = 0; run < kDraws; ++run) {
    const ParameterError e = interval_by_refits(run);
    covered += e.ci95_lo < 0.6 && 0.6 < e.ci95_hi;
    // t(19) at 97.5 %: 2.0930
    assert_near(std::log(e.ci95_hi / e.ci95_lo) / (2 * e.log_std_error), 2.0930 * std::sqrt(1 + 1.0 / 20), 1e-3);
  }
  // 0.95 lies in the 95 % interval of Clopper and Pearson
  assert_true(beta_quantile(0.025, covered, kDraws - covered + 1) < 0.95);
  assert_true(beta_quantile(0.975, covered + 1, kDraws - covered) > 0.95);
}

void test_maximum_likelihood_recovers_models(void**) {
  double square = 0;
  int covered = 0;
  for (uint64_t run = 0; run < 20; ++run) {
    const MlFit fit = fit_maximum_likelihood(Likelihood({test_record(kNominal, 6000, run)}, Detrend{}), 1);
    square += std::pow(std::log(fit.model.markov[0].tau_s / 100), 2) / 20;
    covered += fit.parameters[2].ci95_lo < 100 && 100 < fit.parameters[2].ci95_hi;
  }
  assert_true(std::sqrt(square) < 0.35); // 0.245 over 300 runs; chi-squared with 20 degrees of freedom: 99.9 %
  assert_true(covered >= 15);
  const MlFit chosen = fit_maximum_likelihood(Likelihood({test_record(kTwoTerms, 40000, 3)}, Detrend{}), -1);
  assert_int_equal(chosen.model.markov.size(), 2);
  for (size_t k = 0; k < 2; ++k)
    assert_true(std::fabs(std::log(chosen.model.markov[k].tau_s / kTwoTerms.markov[k].tau_s)) < 0.6);
}

// A thermal polynomial of thousands of dph and gaps leave the estimate where it was: marginalised.
void test_maximum_likelihood_marginalises_the_polynomial(void**) {
  Series s = test_record(kNominal, 6000, 8);
  for (long i = 0; i < s.size(); ++i) s.temp_degc.push_back(0.01 * static_cast<double>(i));
  const MlFit plain = fit_maximum_likelihood(Likelihood({s}, Detrend::parse("poly:3")), 1);
  for (long i = 0; i < s.size(); ++i) {
    const double t = s.temp_degc[static_cast<size_t>(i)] / 60;
    s.rate_dph[static_cast<size_t>(i)] += 5000 + 3000 * t - 2000 * t * t + 900 * t * t * t;
  }
  const MlFit bent = fit_maximum_likelihood(Likelihood({s}, Detrend::parse("poly:3")), 1);
  assert_near(bent.model.markov[0].tau_s / plain.model.markov[0].tau_s, 1, 1e-3);
  assert_near(bent.log_likelihood, plain.log_likelihood, 1e-3);
}

void test_tau_grids(void**) {
  assert_int_equal(parse_tau("2:600", 1, 0).size(), 599);
  assert_int_equal(parse_tau("2:600:2", 1, 0).size(), 300);
  const auto octave = parse_tau("octave", 0.5, 100);
  assert_near(octave.front(), 0.5, 0);
  assert_near(octave.back(), 64, 0);
  const auto list = parse_tau("5,2,2.2", 1, 0);
  assert_int_equal(list.size(), 2);
  for (const char* bad : {"0:5", "5:2", "a", "1:2:3:4", "log:5", "octavee", "", "-3", "nan"}) {
    if (!*bad) continue;
    bool refused = false;
    try {
      parse_tau(bad, 1, 100);
    } catch (const Error& e) {
      refused = e.exit() == Exit::kUsage;
    }
    assert_true(refused);
  }
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_trend_removes_what_the_columns_do),
      cmocka_unit_test(test_records_simulated_together_have_the_bits_of_each_alone),
      cmocka_unit_test(test_likelihood_equals_dense_matrices),
      cmocka_unit_test(test_likelihood_profile_is_the_best_scale),
      cmocka_unit_test(test_bounding_programs_agree_and_are_optimal),
      cmocka_unit_test(test_fits_of_an_exact_curve_return_the_model),
      cmocka_unit_test(test_bound_of_simulated_tests_holds_and_is_tight),
      cmocka_unit_test(test_detrended_fit_allows_for_what_the_polynomial_took),
      cmocka_unit_test(test_interpolated_record_expectation_equals_each_by_itself),
      cmocka_unit_test(test_curve_of_some_windows_has_the_weights_of_all),
      cmocka_unit_test(test_long_record_made_coarse_expects_what_the_whole_does),
      cmocka_unit_test(test_interval_by_few_refits_holds_as_often_as_it_says),
      cmocka_unit_test(test_maximum_likelihood_recovers_models),
      cmocka_unit_test(test_maximum_likelihood_marginalises_the_polynomial),
      cmocka_unit_test(test_tau_grids),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
