// SPDX-License-Identifier: MIT
// The noise of a rate signal in a form that can be whitened: white noise of 1-s means, Gauss-Markov processes and
// a rate random walk.  Their size may depend on temperature; outliers and telegraph noise may be added.
#pragma once
#include <vector>

#include "io/model.h"

namespace imucal {

// The noise that one hypothesis assumes.  What is 0 is absent; slopes say how a part changes with the normalised
// temperature Tn.
struct NoiseModel {
  double white_sigma_dph = 0;
  std::vector<Markov> markov;
  double walk_dph_per_rt_s = 0;                            // rate random walk
  double white_slope = 0, markov_slope = 0, tau_slope = 0; // log-variances and log-tau per unit of Tn
  double extra_white_dph2 = 0; // of 1-s means, beside white_sigma_dph^2: processes faster than a block; may be negative
  double hit_probability = 0, hit_sigma_dph = 0; // outliers
  double telegraph_dph = 0, telegraph_tau_s = 0;

  bool is_mixture() const { return hit_probability > 0 || telegraph_dph > 0; }
  bool is_stationary() const { return white_slope == 0 && markov_slope == 0 && tau_slope == 0; }
};

// Variance of the mean of a Markov process of variance one over a time of so many time constants: its covariance exp(-|u|/tau),
// integrated over the square of that time.
double variance_of_mean(double time_over_tau);

// Whether every number is the same.
bool operator==(const NoiseModel& a, const NoiseModel& b);

// White noise, density (2 sigma^2 / tau) and time constants of the Markov processes times exp(x[0]), exp(x[1]), exp(x[2]).
NoiseModel with_factors(const NoiseModel& base, const double* x);

// White noise and Gauss-Markov processes of an error model.  Its effects are ignored.
NoiseModel noise_of(const ErrorModel& model);

// The Gaussian model of the same covariance, hits left out: telegraph noise becomes a Markov process.
NoiseModel gaussian_equivalent(NoiseModel noise);

} // namespace imucal
