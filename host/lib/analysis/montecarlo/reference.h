// SPDX-License-Identifier: MIT
// The calibration filter once more, in double and in the plain covariance form: the yardstick for the float32
// core. It sees the very seconds that the core saw (float32 means, temperatures, gaps), so that what differs
// is arithmetic.
#pragma once
#include <vector>

#include "analysis/montecarlo/chain.h"

namespace imucal {

struct ReferenceFilter {
  std::vector<double> coeff_dph;       // b0 … bM
  std::vector<double> covariance_dph2; // of them, row-major
};

ReferenceFilter reference_filter(const ChainSetup& setup, const std::vector<SecondMean>& seconds);

// Variance of B(T) for a covariance of coefficients (row-major, p x p), and B itself.
double bias_variance_dph2(const std::vector<double>& covariance_dph2, double tn);
double bias_dph(const std::vector<double>& coeff_dph, double tn);

} // namespace imucal
