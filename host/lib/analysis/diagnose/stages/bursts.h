// SPDX-License-Identifier: MIT
// Whether hits come one by one, as outliers do, or in bursts.
#pragma once
#include "analysis/diagnose/stages/rest.h"

namespace imucal {

// Hits of a noise that has them: whether more pairs of them lie within 10 or 60 samples than the same hits have at any samples
// of their runs.  `residual`: rate minus fitted mean [dph], per run.  Says so at rest_rate where hits come one by one; where
// the noise has none it says nothing.
RestFinding hits_in_bursts(const Campaign& campaign, const std::vector<Eigen::VectorXd>& residual,
                           const NoiseModel& noise, const SelectorConstants& constants);

} // namespace imucal
