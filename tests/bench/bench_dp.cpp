// SPDX-License-Identifier: MIT
// Times the library on records written as raw doubles by host/scripts/bench_dp.py, which times the Python packages on
// the very same records and compares the values.  usage: bench_dp SHORT.f64 LONG.f64 [REPEATS [package]]; JSON on standard output.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>

#include "analysis/dp/tau_grid.h"
#include "analysis/errormodel/confidence.h"
#include "analysis/errormodel/curve_fit.h"
#include "analysis/errormodel/likelihood.h"
#include "io/json_file.h"

using namespace imucal;

namespace {

const ErrorModel kNominal = {0.6, {{20, 100}}, 0, {}, {}};

Series read_record(const char* path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  Series s;
  s.log = path, s.axis = "rate_dph";
  s.rate_dph.resize(static_cast<size_t>(in.tellg()) / sizeof(double));
  in.seekg(0);
  in.read(reinterpret_cast<char*>(s.rate_dph.data()), static_cast<std::streamsize>(s.rate_dph.size() * sizeof(double)));
  return s;
}

// Least processor time of some repeats: what the work costs when nothing else disturbs.  One thread, so this is the time
// on an idle machine.  `prepare` is not counted.
template <typename P, typename F> double best_s(int repeats, P prepare, F f) {
  double best = 1e300;
  for (int k = 0; k < repeats; ++k) {
    prepare();
    const std::clock_t start = std::clock();
    f();
    best = std::min(best, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  return best;
}
template <typename F> double best_s(int repeats, F f) {
  return best_s(
      repeats, [] {}, f);
}

// Mean removal, running sums and the curve: everything from rates to result.
Json time_curve(const Series& series, DpType type, const std::vector<double>& tau_s, int repeats) {
  const DpOperator op = make_dp_operator(type, 1, kNominal);
  DpCurve curve;
  Series s;
  const double seconds = best_s(
      repeats, [&] { s = series; },
      [&] {
        remove_trend(Detrend{}, &s);
        curve = dp_curve(s, DpRecord(s, op), tau_s, DpEstimator::kRms);
      });
  return {{"seconds", seconds}, {"tau_s", curve.tau_s}, {"dp_dph", curve.dp_dph}};
}

// The curve with its 95 % intervals of an array as it lies: the very work of the Python package's allan_deviation.
double time_intervals(const Series& series, const std::vector<double>& tau_s, int repeats) {
  const DpOperator op = make_dp_operator(DpType::kAv, 1, kNominal);
  return best_s(repeats, [&] {
    const RateView rates(series.rate_dph.data(), series.size(), true);
    curve_intervals(dp_curve("array", "rate", rates, DpRecord(rates, op), tau_s, DpEstimator::kRms), op, {});
  });
}

void time_million(Series series, int repeats, Json* json) {
  series.rate_dph.resize(std::min<size_t>(series.rate_dph.size(), 1000000));
  const auto tau_s = parse_tau("octave", 1, static_cast<double>(series.size()) / 2);
  (*json)["av_octave_1e6"] = time_curve(series, DpType::kAv, tau_s, repeats);
  (*json)["av_octave_1e6_intervals"] = {{"seconds", time_intervals(series, tau_s, repeats)}};
}

} // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: bench_dp SHORT.f64 LONG.f64 [REPEATS [package]]\n");
    return 2;
  }
  const int repeats = argc > 3 ? std::atoi(argv[3]) : 5;
  Series record = read_record(argv[1]), extended = read_record(argv[2]);
  Json json;
  time_million(extended, repeats, &json);
  if (argc > 4) { // what the Python package is compared with, alone
    std::cout << json.dump() << "\n";
    return 0;
  }
  const auto taus300 = parse_tau("2:600:2", 1, 0);
  json["av_300_taus_6000"] = time_curve(record, DpType::kAv, taus300, 4 * repeats);
  json["dp2_300_taus_6000"] = time_curve(record, DpType::kDp2, taus300, 4 * repeats);
  std::vector<Series> all = {record};
  remove_trend(Detrend{}, &all[0]);
  const DpOperator op = make_dp_operator(DpType::kDp2, 1, kNominal);
  const CurveData data = make_curve_data(all, op, Detrend{}, parse_tau("2:600", 1, 0), Across::kRms);
  json["bound_2_terms_599_taus"] = {{"seconds", best_s(4 * repeats, [&] { fit_bound(data, 2); })}};
  json["ls_2_terms_599_taus"] = {{"seconds", best_s(repeats, [&] { fit_least_squares(data, 2); })}};
  json["ml_1_term_6000"] = {
      {"seconds", best_s(4 * repeats, [&] { fit_maximum_likelihood(Likelihood({record}, Detrend{}), 1); })}};
  json["av_octave_1e7"] =
      time_curve(extended, DpType::kAv, parse_tau("octave", 1, static_cast<double>(extended.size()) / 2), repeats);
  std::cout << json.dump() << "\n";
}
