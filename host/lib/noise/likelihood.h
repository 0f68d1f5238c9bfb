// SPDX-License-Identifier: MIT
// Likelihood of one residual per run, where the gains of the filter serve that residual alone: they are not kept, and four
// runs are filtered side by side.
#pragma once
#include <vector>

#include "noise/gains.h"

namespace imucal {

// Whether follow_log_likelihood takes the model: one Markov process at most, no walk, no mixture.
bool can_follow(const NoiseModel& noise);

// -1/2 [sum log S + e'e] over all runs, without the constant of 2 pi; e and S as compute_gains and whiten give them, to
// rounding.  residuals: per run, times[r].n values.
double follow_log_likelihood(const std::vector<SampleTimes>& times, const NoiseModel& noise,
                             const std::vector<const double*>& residuals);

} // namespace imucal
