// SPDX-License-Identifier: MIT
// The noise of a rate signal in the form that can be whitened: white noise of 1-s means, Gauss-Markov processes,
// a rate random walk, and what temperature, hits and telegraph noise make of them.
#pragma once
#include <vector>

#include "io/model.h"

namespace imucal {

// The noise of a hypothesis: white noise of 1-s means and Gauss-Markov processes, with what effects make of
// them.
struct NoiseModel {
  double white_sigma_dph = 0;
  std::vector<Markov> markov;
  double walk_dph_per_rt_s = 0;                            // rate random walk
  double white_slope = 0, markov_slope = 0, tau_slope = 0; // log-variances and log-tau per unit of Tn
  double extra_white_dph2 = 0;                             // quantisation and the like
  double hit_probability = 0, hit_sigma_dph = 0;           // outliers
  double telegraph_dph = 0, telegraph_tau_s = 0;

  bool is_mixture() const { return hit_probability > 0 || telegraph_dph > 0; }
  bool is_stationary() const { return white_slope == 0 && markov_slope == 0 && tau_slope == 0; }
};

// White noise and Gauss-Markov processes of an error model; what its effects say is not read.
NoiseModel noise_of(const ErrorModel& model);

// The Gaussian model with the second moments of a mixture without hits: telegraph noise as a Markov process.
NoiseModel gaussian_equivalent(NoiseModel noise);

} // namespace imucal
