// SPDX-License-Identifier: MIT
// The Kalman filter of a stationary noise model at equal steps, long after its start, in closed form.
//
// Measurement y = sum_i s_i + v; s_i first-order Markov with phi_i, q_i (a random walk: phi = 1); v white with
// variance r.  In innovation form x_i <- phi_i x_i + gain_i e with e = y - sum_i phi_i x_i.  The gains need no
// Riccati iteration: y is an ARMA process, prod(1 - phi_i z) y = prod(1 - pole_m z) e, whose zeros are the roots of
// the secular equation
//     r + sum_i (q_i / phi_i) / (u_i - u) = 0,   u = pole + 1/pole - 2,
// There is one root between any two neighbouring u_i and one above the largest.  Then
//     gain_i = prod_m (1 - pole_m / phi_i) / prod_{j != i} (1 - phi_j / phi_i).
// For one term this is the textbook scalar filter: xh_k = a xh_{k-1} + K y_k with a = pole = phi (1 - K).
#pragma once
#include <vector>

#include "noise/noise_model.h"

namespace imucal {

struct SteadyFilter {
  std::vector<double> phi;  // per state, exp(-step/tau); terms of equal tau are merged, zero terms dropped
  std::vector<double> gain; // per state
  std::vector<double> pole; // of the filter, in [0, 1)
  // Response of state i, j samples after a unit sample: sum_m response[i][m] pole[m]^j.
  std::vector<std::vector<double>> response;
  double innovation_variance_dph2 = 0;
};

// For samples `step_s` apart, each the mean over dt_s.  The model needs white noise and at least one further term;
// slopes and mixtures are not allowed.
SteadyFilter steady_filter(const NoiseModel& noise, double step_s, double dt_s);

// The slowest pole; its error is about 1e-4 of its distance from 1.  White noise may be 0; with white noise alone the
// result is 0.  At each sample the filter's covariance comes nearer to its steady value by the factor pole^2.
double slowest_pole(const NoiseModel& noise, double step_s, double dt_s);

} // namespace imucal
