// SPDX-License-Identifier: MIT
// How long the analysis of profiles takes, and how it grows with duration, order and Markov terms (one core).
#include <chrono>
#include <cstdio>
#include <ctime>

#include "analysis/profile/optimize.h"

using namespace imucal;

// CPU time of one call, the best of `rounds`.
template <class F> static double cpu_ms(int rounds, F&& call) {
  double best = 1e300;
  for (int i = 0; i < rounds; ++i) {
    const std::clock_t start = std::clock();
    call();
    best = std::min(best, 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  return best;
}

static OptimizeRequest request_of(double duration_s, double rate, int order) {
  OptimizeRequest r;
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  r.setup.order = order;
  r.setup.hi_degc = 60;
  r.setup.truth = r.setup.filter = model;
  r.limits = {0, 60, rate, rate, 0, 0};
  r.duration_s = duration_s;
  return r;
}

int main() {
  std::printf("profile error, CPU ms (matched | truth covariance), ramp and soak:\n  duration_s order terms\n");
  for (double duration_s : {8400.0, 28800.0, 86400.0})
    for (int order : {3, 5})
      for (int terms : {1, 3}) {
        OptimizeRequest r = request_of(duration_s, 0.6, order);
        r.setup.truth.markov.resize(static_cast<size_t>(terms), {10, 30});
        r.setup.filter = r.setup.truth;
        const auto runs = runs_of_profile(paper_profile(r.limits, duration_s));
        const double matched = cpu_ms(20, [&] { calibration_error(runs, r.setup); });
        r.setup.filter.arw_deg_rt_h = 0.7;
        const double truth = cpu_ms(10, [&] { calibration_error(runs, r.setup); });
        std::printf("  %10.0f %5d %5d  %7.2f | %7.2f\n", duration_s, order, terms, matched, truth);
      }
  std::printf("profile bound with a rate limit, CPU s:\n");
  for (int order : {1, 3, 5})
    std::printf("  order %d: %.2f\n", order,
                1e-3 * cpu_ms(1, [&] {
                  calibration_bound({request_of(1, 1, 3).setup.truth, order, 8400, 60, 1.0});
                }));
  std::printf("profile optimize, CPU s (accuracy | telling six effects apart):\n");
  for (double duration_s : {8400.0, 14400.0, 28800.0})
    for (int order : {1, 3, 5}) {
      OptimizeRequest r = request_of(duration_s, 2, order);
      const double plain = 1e-3 * cpu_ms(1, [&] { optimize_profile(r); });
      r.tell_apart = standard_effects(order);
      const double apart = duration_s < 20000 || order == 3 ? 1e-3 * cpu_ms(1, [&] { optimize_profile(r); }) : 0;
      std::printf("  %6.0f s, order %d: %6.2f | %6.2f\n", duration_s, order, plain, apart);
      std::fflush(stdout);
    }
}
