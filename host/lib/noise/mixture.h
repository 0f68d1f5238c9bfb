// SPDX-License-Identifier: MIT
// Likelihood of noise that is no single Gaussian: outliers and telegraph noise.
#pragma once
#include <Eigen/Core>

#include "noise/gains.h"

namespace imucal {

// Log-likelihood of a residual (rate minus its fitted mean): outliers by assumed-density filtering of the
// contaminated normal, telegraph noise by interacting multiple models with two modes (Blom and Bar-Shalom 1988).
// Without the constant n/2 ln 2 pi.  `scores`, when given, receives Phi^-1 of the predictive distribution
// function: N(0,1) and white when the model is true.  `hit` (outliers): the probability that the sample is a hit.
double mixture_log_likelihood(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd& residual,
                              Eigen::VectorXd* scores = nullptr, Eigen::VectorXd* hit = nullptr);

} // namespace imucal
