// SPDX-License-Identifier: MIT
// What the innovations of the one-state filter look like where the noise is richer than its one Markov process.
//
// Several Markov terms are merged into one of the same variance and density at low frequency (kf_config, fit.h).  The predicted
// error then holds, but the innovations are neither white nor of the variance that the filter believes: 40 dph over 3 s beside
// 20 dph over 100 s give 2.6 times that variance from a sensor that is as its model says.  So the figures of the core's rules are
// held against those that the full model foresees.
//
// Steady state of the filter (gain K, innovation variance S, transition m of its state), the polynomial known.  With
// p = m (1 - K) its prediction is x' = p x + m K z, z = sum s_i + v: a first-order filter of noise of known covariance, so the
// covariance c(h) of the innovations nu = z - x at lag h follows from the stationary moments E s_i x and E x^2 and from their
// recursion over h, exactly (Anderson and Moore 1979, Optimal Filtering, 4.1 and 6.4: a filter under another model).
#pragma once
#include "analysis/fit/fit.h"

namespace imucal {

struct ExpectedInnovations {
  double nis = 1;         // c(0)/S
  double lag1 = 0;        // c(1)/c(0)
  double slow = 1;        // of sums over blocks of 256 rows, over what S says (health.h)
  double rejects = 0;     // share of rows beyond the core's gate
  double nis_spread = 1;  // how many times the variance of the mean of nu^2/S is that of white innovations
  double slow_spread = 1; // the same of the mean over blocks
};

// noise: of the sensor (stationary: white noise and Markov terms); dt_s: step of the rows.
ExpectedInnovations expected_innovations(const imucal_kf_config_t& filter, const NoiseModel& noise, double dt_s);

// The core's rules on innovations (nis, lag1, slow, rejects) of an axis, judged anew: nis and slow become ratios to what is
// expected, lag1 what it has beyond it; error_factor follows.  n: innovations judged.  Read: health.  Changed: health,
// error_factor.
void judge_by_expected(const ExpectedInnovations& expected, long n, FitAxis* axis);

} // namespace imucal
