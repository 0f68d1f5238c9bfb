// SPDX-License-Identifier: MIT
// Operators of the Direct Predictor against their definitions, written out naively.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>
#include <string>

#include "analysis/dp/dp.h"
#include "analysis/dp/stream.h"
#include "base/error.h"
#include "base/quantile.h"
#include "base/rng.h"
#include "near.h"

using namespace imucal;

namespace {

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();
const ErrorModel kNominal = {0.6, {{20, 100}}, 0, {}, {}};
const ErrorModel kTwoTerms = {0.9, {{18, 25}, {17, 160}}, 0, {}, {}};

Series random_series(long n, uint64_t seed) {
  Rng rng(seed, 0, 0, Stream::kWhite);
  Series s;
  s.log = "test.csv";
  s.axis = "gx_dph";
  double walk = 0;
  for (long i = 0; i < n; ++i) {
    walk += rng.normal();
    s.rate_dph.push_back(36 * rng.normal() + walk);
  }
  return s;
}

void drop(Series* s, long i) {
  s->n_missing += !std::isnan(s->rate_dph[static_cast<size_t>(i)]);
  s->rate_dph[static_cast<size_t>(i)] = kMissing;
}

// Riccati iteration to the steady state: what make_nominal_filter solves in closed form.
std::vector<double> riccati_gain(const ErrorModel& m, double* innovation_variance) {
  const size_t n = m.markov.size();
  std::vector<std::vector<double>> p(n, std::vector<double>(n, 0.0));
  for (size_t i = 0; i < n; ++i) p[i][i] = m.markov[i].sigma_dph * m.markov[i].sigma_dph;
  std::vector<double> gain(n);
  for (int k = 0; k < 20000; ++k) {
    for (size_t i = 0; i < n; ++i)
      for (size_t j = 0; j < n; ++j)
        p[i][j] = m.markov[i].phi() * p[i][j] * m.markov[j].phi() + (i == j ? m.markov[i].q_dph2() : 0);
    double s = 3600 * m.arw_deg_rt_h * m.arw_deg_rt_h;
    std::vector<double> ph(n, 0.0);
    for (size_t i = 0; i < n; ++i)
      for (size_t j = 0; j < n; ++j) ph[i] += p[i][j], s += p[i][j];
    for (size_t i = 0; i < n; ++i) gain[i] = ph[i] / s;
    *innovation_variance = s;
    for (size_t i = 0; i < n; ++i)
      for (size_t j = 0; j < n; ++j) p[i][j] -= gain[i] * ph[j];
  }
  return gain;
}

void test_nominal_filter_secular_roots_equal_riccati(void**) {
  const ErrorModel models[] = {
      kNominal, kTwoTerms, {0.01, {{40, 2}, {5, 30}, {9, 4000}}, 0, {}, {}}, {3.0, {{0.5, 10}, {0.7, 11}}, 0, {}, {}}};
  for (const ErrorModel& m : models) {
    double s = 0;
    const auto expected = riccati_gain(m, &s);
    const NominalFilter f = make_nominal_filter(m);
    assert_int_equal(f.size(), m.markov.size());
    for (size_t i = 0; i < f.size(); ++i) // the filter sorts by time constant, longest first
      for (size_t j = 0; j < f.size(); ++j)
        if (std::fabs(m.markov[j].phi() - f.phi[i]) < 1e-14) assert_near(f.gain[i], expected[j], 1e-9);
    assert_near(f.innovation_variance_dph2 / s, 1, 1e-9);
  }
}

void test_nominal_filter_response_sums_poles(void**) {
  const NominalFilter f = make_nominal_filter(kTwoTerms);
  std::vector<double> x(f.size(), 0.0);
  for (long j = 0; j < 400; ++j) {
    double predicted = 0;
    for (size_t k = 0; k < x.size(); ++k) predicted += x[k] *= f.phi[k];
    for (size_t k = 0; k < x.size(); ++k) x[k] += f.gain[k] * ((j == 0) - predicted);
    for (size_t k = 0; k < x.size(); ++k) {
      double sum = 0;
      for (size_t m = 0; m < f.size(); ++m) sum += f.response[k][m] * std::pow(f.pole[m], static_cast<double>(j));
      assert_near(sum, x[k], 1e-12);
    }
  }
}

double naive_prediction(const Series& s, const DpOperator& op, long n, long t0) {
  if (op.type == DpType::kAv || op.type == DpType::kDp1) {
    const long m = op.history_n(n);
    double sum = 0;
    for (long i = t0 - m; i < t0; ++i) sum += s.rate_dph[static_cast<size_t>(i)];
    return sum / static_cast<double>(m);
  }
  std::vector<double> x(op.filter.size(), 0.0);
  for (long i = 0; i < t0; ++i) {
    double predicted = 0;
    for (size_t k = 0; k < x.size(); ++k) predicted += x[k] *= op.filter.phi[k];
    const double y = s.rate_dph[static_cast<size_t>(i)];
    for (size_t k = 0; k < x.size(); ++k) x[k] += std::isnan(y) ? 0 : op.filter.gain[k] * (y - predicted);
  }
  double sum = 0;
  for (size_t k = 0; k < x.size(); ++k) {
    double factor = 0;
    for (long i = 1; i <= n; ++i) factor += std::pow(op.filter.phi[k], static_cast<double>(i)) / static_cast<double>(n);
    sum += x[k] * (op.type == DpType::kDp3 ? factor : 1);
  }
  return sum;
}

std::vector<double> naive_samples(const Series& s, const DpOperator& op, long n, std::vector<long>* t0s) {
  std::vector<double> out;
  for (long t0 = op.history_n(n); t0 + n <= s.size(); ++t0) {
    bool whole = true;
    double mean = 0;
    for (long i = t0 - op.history_n(n); i < t0 + n; ++i)
      whole = whole && !std::isnan(s.rate_dph[static_cast<size_t>(i)]);
    if (!whole) continue;
    for (long i = t0; i < t0 + n; ++i) mean += s.rate_dph[static_cast<size_t>(i)] / static_cast<double>(n);
    out.push_back(mean - naive_prediction(s, op, n, t0));
    t0s->push_back(t0);
  }
  return out;
}

void check_operator(DpType type, const ErrorModel& nominal, const Series& s) {
  const DpOperator op = make_dp_operator(type, 1, nominal, 15);
  const DpRecord record(s, op);
  for (long n : {1L, 2L, 7L, 40L}) {
    std::vector<long> expected_t0, t0;
    std::vector<double> d;
    const auto expected = naive_samples(s, op, n, &expected_t0);
    assert_true(expected.size() > 10);
    record.samples(n, &d, &t0);
    assert_int_equal(d.size(), expected.size());
    double sum = 0;
    for (size_t i = 0; i < d.size(); ++i) {
      assert_int_equal(t0[i], expected_t0[i]);
      assert_near(d[i], expected[i], 1e-9);
      sum += expected[i] * expected[i];
    }
    const auto m = record.moments({n})[0];
    assert_int_equal(m.n_windows(), static_cast<long>(expected.size()));
    assert_near(m.mean_square() * static_cast<double>(expected.size()) / sum, 1, 1e-12);
  }
}

// A view that takes the mean away on the way, against a copy whose mean was removed: the same bits.
void check_view(const Series& raw) {
  Series removed = raw;
  remove_trend(Detrend{}, &removed);
  const RateView rates(raw.rate_dph.data(), raw.size(), true);
  assert_int_equal(rates.n_missing, raw.n_missing);
  for (DpType type : {DpType::kAv, DpType::kDp1, DpType::kDp2}) {
    const DpOperator op = make_dp_operator(type, 1, kTwoTerms, 15);
    const DpCurve copied = dp_curve(removed, DpRecord(removed, op), {1, 7, 40}, DpEstimator::kRms);
    const DpCurve viewed = dp_curve(raw.log, raw.axis, rates, DpRecord(rates, op), {1, 7, 40}, DpEstimator::kRms);
    assert_true(copied.dp_dph == viewed.dp_dph);
    assert_true(copied.n == viewed.n);
  }
}

// Sizes of d against d itself, sorted: kept whole, bracketed, with ties, and cut by gaps.
void check_sizes(const Series& s, const DpOperator& op) {
  const DpRecord record(s, op);
  for (long n : {1L, 3L, 50L, 400L}) {
    std::vector<double> d;
    record.samples(n, &d, nullptr);
    for (double& x : d) x = std::fabs(x);
    std::sort(d.begin(), d.end());
    const double place = 0.954 * static_cast<double>(d.size() - 1);
    const auto k = static_cast<size_t>(place);
    const double percentile = d[k] + (place - static_cast<double>(k)) * (d[std::min(k + 1, d.size() - 1)] - d[k]);
    const DpRecord::Size size = record.sizes({n})[0];
    assert_int_equal(size.n_windows, d.size());
    assert_true(size.largest == d.back());
    assert_true(size.percentile == percentile);
  }
}

void test_sizes_are_those_of_the_sorted_errors(void**) {
  for (long n : {3000L, 60000L}) {
    Series s = random_series(n, 5);
    check_sizes(s, make_dp_operator(DpType::kDp3, 1, kTwoTerms));
    // Loud at one end: the evenly spread sample must still bracket the percentile, or say that it does not.
    for (long i = 0; i < n / 50; ++i) s.rate_dph[static_cast<size_t>(i)] *= 100;
    check_sizes(s, make_dp_operator(DpType::kAv, 1, {}));
    for (double& x : s.rate_dph) x = std::round(x / 40) * 40; // many errors of the same size
    check_sizes(s, make_dp_operator(DpType::kAv, 1, {}));
    for (long i = 500; i < n; i += 1700) drop(&s, i);
    check_sizes(s, make_dp_operator(DpType::kAv, 1, {}));
    DpOperator filled = make_dp_operator(DpType::kDp1, 1, {});
    filled.min_fill = 0.9;
    check_sizes(s, filled);
  }
}

void test_operators_equal_their_definition(void**) {
  const Series s = random_series(700, 3);
  for (DpType type : {DpType::kAv, DpType::kDp1, DpType::kDp2, DpType::kDp3}) {
    check_operator(type, kNominal, s);
    check_operator(type, kTwoTerms, s);
  }
}

void test_rates_where_they_lie_give_the_bits_of_a_copy(void**) {
  Series s = random_series(2000, 3);
  for (double& x : s.rate_dph) x += 5000; // a mean that matters
  check_view(s);
  for (long i : {0L, 1L, 700L, 701L, 1999L}) drop(&s, i);
  check_view(s);
  const std::vector<double> none(5, kMissing);
  assert_int_equal(RateView(none.data(), 5, true).n_missing, 5);
  const RateView whole(s.rate_dph.data(), s.size(), false);
  assert_true(whole[5] == s.rate_dph[5] && whole.n_missing == s.n_missing);
}

void test_operators_with_gaps_use_whole_windows_only(void**) {
  Series s = random_series(1500, 4);
  for (long i : {0L, 200L, 201L, 640L, 1499L}) drop(&s, i);
  for (long i = 900; i < 930; ++i) drop(&s, i);
  for (DpType type : {DpType::kAv, DpType::kDp1, DpType::kDp2, DpType::kDp3}) check_operator(type, kNominal, s);
}

// Every n/8-th window of each run, as samples() lists them.
void check_spaced(const DpRecord& record, long n, const DpRecord::Sum& got) {
  std::vector<double> d;
  std::vector<long> t0;
  record.samples(n, &d, &t0);
  double sum = 0;
  long count = 0, first = 0;
  for (size_t i = 0; i < d.size(); ++i) {
    if (i == 0 || t0[i] != t0[i - 1] + 1) first = t0[i];
    if ((t0[i] - first) % std::max(1L, n / 8) != 0) continue;
    sum += d[i] * d[i], ++count;
  }
  assert_true(count > 10);
  assert_int_equal(got.count, count);
  assert_near(got.sum_sq / sum, 1, 1e-11);
}

void test_spaced_windows_are_some_of_all(void**) {
  Series s = random_series(20000, 13);
  const std::vector<long> n = {1, 7, 15, 16, 17, 19, 22, 25, 32, 35, 39, 40, 100, 1000};
  for (bool with_gaps : {false, true}) {
    for (long i : {0L, 8191L, 8192L, 8200L, 12345L, 19999L})
      if (with_gaps) drop(&s, i);
    for (DpType type : {DpType::kAv, DpType::kDp1, DpType::kDp2}) {
      const DpRecord record(s, make_dp_operator(type, 1, kNominal, 15));
      const auto sums = record.sums_of_some(n, 8);
      for (size_t i = 0; i < n.size(); ++i) check_spaced(record, n[i], sums[i]);
    }
  }
}

// Several n share a pass, yet each has the bits that it has alone.
void test_sums_do_not_depend_on_the_n_beside(void**) {
  Series s = random_series(20001, 14);
  for (long i : {500L, 9000L}) drop(&s, i);
  const std::vector<long> n = {3, 10, 16, 18, 33, 64, 501, 1200, 1201, 4000};
  const DpRecord record(s, make_dp_operator(DpType::kAv, 1, {}, 15));
  const auto together = record.moments(n);
  const auto some = record.sums_of_some(n, 8);
  for (size_t i = 0; i < n.size(); ++i) {
    const auto alone = record.moments({n[i]})[0];
    assert_int_equal(together[i].sum_sq.size(), alone.sum_sq.size());
    assert_memory_equal(together[i].sum_sq.data(), alone.sum_sq.data(), alone.sum_sq.size() * sizeof(double));
    assert_true(some[i].sum_sq == record.sums_of_some({n[i]}, 8)[0].sum_sq);
  }
}

void test_min_fill_admits_windows_with_few_missing(void**) {
  Series s = random_series(600, 5);
  for (long i = 10; i < 600; i += 20) drop(&s, i);
  DpOperator op = make_dp_operator(DpType::kAv, 1, {}, 15);
  assert_int_equal(DpRecord(s, op).moments({40})[0].n_windows(), 0);
  op.min_fill = 0.9;
  assert_int_equal(DpRecord(s, op).moments({40})[0].n_windows(), 600 - 80 + 1);
}

// Pushed sample by sample, with gaps at piece borders and elsewhere: the same windows and sums as from the whole record.
void test_stream_equals_whole_record(void**) {
  Series s = random_series(700000, 12);
  const std::vector<long> n = {1, 30, 2000};
  for (bool with_gaps : {false, true}) {
    for (long i : {5L, 262143L, 262144L, 262150L, 400000L})
      if (with_gaps) drop(&s, i);
    for (const ErrorModel& nominal : {kNominal, kTwoTerms})
      for (DpType type : {DpType::kAv, DpType::kDp2, DpType::kDp3}) {
        const DpOperator op = make_dp_operator(type, 1, nominal, 15);
        DpStream stream(op, n);
        for (double x : s.rate_dph) stream.push(x);
        const auto got = stream.finish(), expected = DpRecord(s, op).moments(n);
        for (size_t i = 0; i < n.size(); ++i) {
          assert_int_equal(got[i].n_windows(), expected[i].n_windows());
          assert_near(got[i].mean_square() / expected[i].mean_square(), 1, 1e-10);
        }
      }
  }
}

void test_adjoint_is_the_transpose(void**) {
  Series a = random_series(500, 6);
  for (long i : {3L, 210L, 211L}) drop(&a, i);
  for (const ErrorModel& nominal : {kNominal, kTwoTerms})
    for (DpType type : {DpType::kAv, DpType::kDp1, DpType::kDp2, DpType::kDp3}) {
      const DpOperator op = make_dp_operator(type, 1, nominal, 15);
      std::vector<double> d, y;
      std::vector<long> t0;
      const DpRecord record(a, op);
      record.samples(12, &d, &t0);
      Rng rng(7, 0, 0, Stream::kWhite);
      for (size_t i = 0; i < d.size(); ++i) y.push_back(rng.normal());
      const auto back = record.adjoint(12, y, t0);
      double left = 0, right = 0;
      for (size_t i = 0; i < d.size(); ++i) left += d[i] * y[i];
      for (size_t i = 0; i < back.size(); ++i)
        if (!std::isnan(a.rate_dph[i])) right += back[i] * a.rate_dph[i];
      assert_near(left, right, 1e-8 * std::fabs(left) + 1e-8);
    }
}

void test_estimators_follow_their_definition(void**) {
  std::vector<double> d;
  for (int i = 1; i <= 1001; ++i) d.push_back(i % 2 ? i : -i);
  std::vector<double> copy = d;
  assert_near(dp_sigma(DpEstimator::kMax, &copy), 1001.0 / 3, 1e-12);
  copy = d;
  assert_near(dp_sigma(DpEstimator::kP95, &copy), 0.5 * (1 + 0.954 * 1000), 1e-9); // rank 954 of 0 … 1000
  assert_near(dp_sigma(DpEstimator::kRms, &d), std::sqrt(1002.0 * 2003.0 / 6), 1e-9);
}

void test_quantiles_known_values(void**) {
  // NIST/SEMATECH e-Handbook tables 1.3.6.7.1 and 1.3.6.7.4.
  assert_near(normal_quantile(0.975), 1.959963984540054, 1e-12);
  assert_near(normal_quantile(1e-6), -4.753424308822899, 1e-10);
  assert_near(chi2_quantile(0.975, 1), 5.024, 5e-4);
  assert_near(chi2_quantile(0.025, 10), 3.247, 5e-4);
  assert_near(chi2_quantile(0.95, 100), 124.342, 5e-4);
  assert_near(chi2_quantile(0.025, 1), 0.000982, 5e-7);
  assert_near(chi2_cdf(chi2_quantile(0.3, 2.7), 2.7), 0.3, 1e-10);
}

int exit_of(const std::function<void()>& run, std::string* message) {
  try {
    run();
  } catch (const Error& e) {
    *message = e.what();
    return static_cast<int>(e.exit());
  }
  return 0;
}

void test_bad_input_is_refused_with_its_place(void**) {
  std::string message;
  Series flat = random_series(100, 1);
  for (double& x : flat.rate_dph) x = 5;
  const DpOperator av = make_dp_operator(DpType::kAv, 1, {});
  assert_int_equal(exit_of([&] { dp_curve(flat, DpRecord(flat, av), {2}, DpEstimator::kRms); }, &message), 3);
  assert_non_null(strstr(message.c_str(), "constant"));
  const Series s = random_series(100, 1);
  assert_int_equal(exit_of([&] { dp_curve(s, DpRecord(s, av), {51}, DpEstimator::kRms); }, &message), 3);
  assert_non_null(strstr(message.c_str(), "beyond the record"));
  assert_int_equal(exit_of([&] { dp_curve(s, DpRecord(s, av), {0.2}, DpEstimator::kRms); }, &message), 2);
  assert_int_equal(exit_of([&] { make_dp_operator(DpType::kDp2, 1, {}); }, &message), 2);
  assert_int_equal(exit_of([&] { make_dp_operator(DpType::kDp2, 1, ErrorModel{0.6, {}, 0, {}, {}}); }, &message), 2);
  assert_int_equal(exit_of([&] { Detrend::parse("poly:x"); }, &message), 2);
  assert_int_equal(exit_of(
                       [&] {
                         Series t = s;
                         remove_trend(Detrend::parse("poly:2"), &t);
                       },
                       &message),
                   3);
}

void test_detrend_removes_polynomials_of_temperature(void**) {
  Series s = random_series(400, 9);
  for (long i = 0; i < 400; ++i) {
    const double t = 20 + 0.1 * static_cast<double>(i) + 3 * std::sin(0.05 * static_cast<double>(i));
    s.temp_degc.push_back(t);
    s.rate_dph[static_cast<size_t>(i)] = 1e5 - 300 * t + 4 * t * t - 0.03 * t * t * t;
  }
  drop(&s, 17);
  remove_trend(Detrend::parse("poly:3"), &s);
  for (double x : s.rate_dph)
    if (!std::isnan(x)) assert_true(std::fabs(x) < 1e-7);
}

void test_quantum_is_found_where_there_is_one(void**) {
  Series s = random_series(5000, 10);
  assert_near(quantum_dph(s), 0, 0);
  for (double& x : s.rate_dph) x = std::round((std::round(x / 21.95) * 21.95 + 3) * 1000) / 1000;
  drop(&s, 100);
  assert_near(quantum_dph(s), 21.95, 0.01);
  for (size_t i = 0; i < s.rate_dph.size(); i += 3) s.rate_dph[i] += 8.1; // two lattices are none
  assert_near(quantum_dph(s), 0, 0);
}

void test_load_series_grid_keeps_gaps_and_flags(void**) {
  const std::string path = std::string(getenv("BUILD") ? getenv("BUILD") : "build") + "/test_dp_series.csv";
  std::ofstream(path) << "# imucal-log = 1\nt_s,temp_degc,gx_dph,gx_flags,gy_dps\n"
                         "10,20,1,0,0.001\n11,20.5,2,1,0.002\n12.001,21,,0,0.003\n15.002,21.5,4,2,0.004\n16,22,5,0,\n";
  const auto all = load_series(path, {}, true);
  assert_int_equal(all.size(), 2);
  assert_int_equal(all[0].size(), 7);    // 10, 11, 12, two missing rows, 15, 16
  assert_int_equal(all[0].n_missing, 4); // saturated 11, empty 12, rows 13 and 14
  assert_int_equal(all[0].n_flagged, 1);
  assert_near(all[0].rate_dph[5], 4, 0); // "samples missing" alone is kept
  assert_near(all[1].rate_dph[1], 7.2, 1e-12);
  assert_near(all[0].temp_degc[5], 21.5, 0);
  std::string message;
  assert_int_equal(exit_of([&] { load_series(path, {"gz_dph"}, true); }, &message), 3);
  assert_non_null(strstr(message.c_str(), "gz_dph"));
  std::remove(path.c_str());
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_nominal_filter_secular_roots_equal_riccati),
      cmocka_unit_test(test_nominal_filter_response_sums_poles),
      cmocka_unit_test(test_operators_equal_their_definition),
      cmocka_unit_test(test_sizes_are_those_of_the_sorted_errors),
      cmocka_unit_test(test_rates_where_they_lie_give_the_bits_of_a_copy),
      cmocka_unit_test(test_operators_with_gaps_use_whole_windows_only),
      cmocka_unit_test(test_spaced_windows_are_some_of_all),
      cmocka_unit_test(test_sums_do_not_depend_on_the_n_beside),
      cmocka_unit_test(test_min_fill_admits_windows_with_few_missing),
      cmocka_unit_test(test_stream_equals_whole_record),
      cmocka_unit_test(test_adjoint_is_the_transpose),
      cmocka_unit_test(test_estimators_follow_their_definition),
      cmocka_unit_test(test_quantiles_known_values),
      cmocka_unit_test(test_bad_input_is_refused_with_its_place),
      cmocka_unit_test(test_detrend_removes_polynomials_of_temperature),
      cmocka_unit_test(test_quantum_is_found_where_there_is_one),
      cmocka_unit_test(test_load_series_grid_keeps_gaps_and_flags),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
