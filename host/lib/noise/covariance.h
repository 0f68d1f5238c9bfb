// SPDX-License-Identifier: MIT
// Multiplies by the covariance of a noise model at the samples of a run; the matrix itself is never formed.
#pragma once
#include <Eigen/Core>

#include "noise/gains.h"

namespace imucal {

// V v, v: one value per sample.  For stationary models and the random walk (which is zero at the first sample).
// Slopes and mixtures are an internal error.  Time O(samples x states).
Eigen::VectorXd covariance_times(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd& v);

} // namespace imucal
