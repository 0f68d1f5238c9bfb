// SPDX-License-Identifier: MIT
// Calibration tests of several runs side by side: random numbers, white and Markov noise and raw samples in vectors of
// eight runs, then every second through each run's own core.  The same bits as calibrate_run gives run by run: the same
// random numbers, the same order of additions, sums of integers.
#pragma once
#include <vector>

#include "analysis/montecarlo/campaign.h"

namespace imucal {

// No effects, no lost samples or seconds, no jitter, no noise of the thermometer: all runs see the same time stamps and
// temperatures.
bool can_batch(const CampaignPlan& plan);

// Runs first_run … first_run + n - 1, n <= kBatch.  Pre: can_batch(plan).
std::vector<CalibrationTest> calibrate_batch(const CampaignPlan& plan, uint64_t first_run, uint64_t n);

} // namespace imucal
