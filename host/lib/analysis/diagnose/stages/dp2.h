// SPDX-License-Identifier: MIT
// The Direct Predictor of what the model and the answer leave, beside that of simulations of both.
#pragma once
#include <cstdint>
#include <vector>

#include "analysis/diagnose/evidence/fit.h"

namespace imucal {

// Curves over tau, and how far those of the logs are from those of simulations (rms).
struct Dp2Comparison {
  std::vector<double> tau_s, nominal_dph, final_dph;
  std::vector<double> data_dph, left_dph; // of the logs: less the mean of the model, less that of the answer
  double before_dph = 0, after_dph = 0;   // of the model, of the answer
};

// DP2 of the residuals of both models against simulations of both.
Dp2Comparison compare_dp2(const Campaign& seconds, const NoiseModel& nominal, const NoiseModel& final,
                          const Fit& before, const Fit& after, uint64_t seed);

} // namespace imucal
