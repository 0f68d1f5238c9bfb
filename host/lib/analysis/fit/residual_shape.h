// SPDX-License-Identifier: MIT
// What a residual shows that is neither polynomial nor noise, for fits that no model judges: a jump, and a warm-up.
//
// Means of 128 s.  A jump: the largest difference of two that are neighbours; a warm-up: the first of a log, from the middle
// of all.  Both are compared with what such differences and means usually are in the same residual (median of the size), so
// that no model of the noise is needed, and slow noise counts as what is usual.  Limits: of 320 healthy logs of 140 min
// (0.6 deg/sqrt(h); 20 dph with 100 s, 15 dph with 200, 400 and 1000 s) none is told anything: fewer than 1 in 100 are, with
// 95 % confidence (tests/host/test_fit.cpp, LONG=1).
#pragma once
#include <cstddef>
#include <vector>

namespace imucal {

constexpr double kJump_times = 6.5, kWarmUp_times = 6; // from here on it is told

struct ResidualShape {
  double jump_dph = 0, jump_times = 0;
  size_t jump_run = 0, jump_row = 0; // first row behind it
  double warm_up_dph = 0, warm_up_times = 0;
  size_t warm_up_run = 0;
  double mean_s = 0; // length of the means; 0: the logs are too short to judge
};

// residual: of each run, a row each, NaN where there is none.
ResidualShape shape_of(std::vector<std::vector<double>> residual_dph, double dt_s);

} // namespace imucal
