// SPDX-License-Identifier: MIT
// The Direct Predictor of what the model and the answer leave, beside that of simulations of both.
#pragma once
#include <cstdint>

#include "analysis/diagnose/stages/gap.h"

namespace imucal {

// DP2 of the residuals of both models against simulations of both (in `gap`).
void compare_dp2(const Campaign& seconds, const NoiseModel& nominal, const NoiseModel& final, const Fit& before,
                 const Fit& after, uint64_t seed, GapResult* gap);

} // namespace imucal
