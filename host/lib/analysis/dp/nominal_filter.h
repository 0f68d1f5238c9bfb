// SPDX-License-Identifier: MIT
// Steady-state Kalman filter of a nominal error model (white noise + Markov terms): the estimator of DP2, DP3.
//
// Measurement y = sum_i s_i + v; s_i first-order Markov with phi_i, q_i; v white with variance r.  In innovation
// form x_i <- phi_i x_i + gain_i e with e = y - sum_i phi_i x_i.  The gains need no Riccati iteration: y is an
// ARMA process, prod(1 - phi_i z) y = prod(1 - pole_m z) e, whose zeros are the roots of the secular equation
// r + sum_i (q_i / phi_i) / (u_i - u) = 0 with u = pole + 1/pole - 2, one between every two neighbouring u_i and
// one above; then gain_i = prod_m (1 - pole_m / phi_i) / prod_{j != i} (1 - phi_j / phi_i).  For one term this is
// the textbook scalar filter: xh_k = a xh_{k-1} + K y_k with a = pole = phi (1 - K)   (design 2.4).
#pragma once
#include <vector>

#include "io/model.h"

namespace imucal {

struct NominalFilter {
  double dt_s = 1;
  std::vector<double> phi;   // per state, exp(-dt/tau); terms of equal tau are merged, zero terms dropped
  std::vector<double> gain;  // per state
  std::vector<double> pole;  // of the filter, in (0, 1)
  // Response of state i, j samples after a unit sample: sum_m response[i][m] pole[m]^j.
  std::vector<std::vector<double>> response;
  double innovation_variance_dph2 = 0;

  size_t size() const { return phi.size(); }
  // Samples after which the part of the estimate's weight still missing is below 1e-4: the burn-in of DP2 and
  // DP3 at the start of a record and after a gap.
  long warm_up_n() const;
  // Factor of state i in the prediction of the mean of the next n samples: 1 for DP2, optimal for DP3:
  // phi (1 - phi^n) / (n (1 - phi)).
  double prediction_factor(size_t i, long n, bool optimal) const;
};

// usage_error when the model has no Markov term with sigma > 0: then there is nothing to estimate.
// A model without white noise is given 1e-9 of the Markov variance.
NominalFilter make_nominal_filter(const ErrorModel& nominal, double dt_s = 1.0);

}  // namespace imucal
