// SPDX-License-Identifier: MIT
// Steady-state Kalman filter of a nominal error model (white noise + Markov terms): the estimator of DP2, DP3.
// Its gains, poles and responses: noise/steady_filter.h   (reference figures C, tests/README.md).
#pragma once
#include "io/model.h"
#include "noise/components.h"
#include "noise/steady_filter.h"

namespace imucal {

struct NominalFilter : SteadyFilter {
  double dt_s = 1;
  std::vector<NoiseComponent> components; // of the nominal model

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

} // namespace imucal
