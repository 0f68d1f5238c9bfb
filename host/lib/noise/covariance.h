// SPDX-License-Identifier: MIT
// The covariance of a noise model at the samples of a run, applied without writing it out.
#pragma once
#include <Eigen/Dense>

#include "noise/gains.h"

namespace imucal {

// V v, v: one value per sample.  Stationary models and the random walk (zero at the first sample); no slopes,
// no mixtures (internal error).  Time O(samples x states).
Eigen::VectorXd covariance_times(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd& v);

} // namespace imucal
