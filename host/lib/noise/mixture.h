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

// Outliers: the further white variance of each sample [dph^2] under which it has its expected precision, as in the
// expectation step for a scale mixture (Dempster, Laird and Rubin, 1980).  The expected variance would give every sample,
// by the small probability that it is a hit, more than its own noise where hits are ten thousand times as large.
Eigen::VectorXd expected_hit_dph2(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd& residual);

// Telegraph noise: level of each sample [dph] as the whole residual shows it, and its variance: probabilities of the two
// levels by the filter above, then from the end (Kim, J. Econometrics 60, 1994).
struct TelegraphLevel {
  Eigen::VectorXd mean_dph, variance_dph2;
};
TelegraphLevel telegraph_level(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd& residual);

} // namespace imucal
