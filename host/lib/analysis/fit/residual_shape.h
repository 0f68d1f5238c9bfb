// SPDX-License-Identifier: MIT
// What a residual shows that is neither polynomial nor noise, for fits that no model judges: a jump, and a warm-up.
//
// Means of 128 s.  A jump: the largest difference of two that are neighbours; a warm-up: the first of a log, from the middle
// of all.  Both are compared with what such differences and means usually are in the same residual (median of the size), so
// that no model of the noise is needed, and slow noise counts as what is usual.  Limits: of 2376 simulated healthy axes
// (0.6 deg/sqrt(h); 20 dph with 100 s and 15 dph with 200, 400 and 1000 s; three profiles of 78 to 235 min) the largest jump was
// 5.3 and the largest warm-up 4.5 times the usual: none is told (at 95 % fewer than 13 of 10,000 axes are).
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
