// SPDX-License-Identifier: MIT
// What exact covariance analysis (analysis/profile/covariance.h) says of a campaign: the other half of the comparison.
#pragma once
#include <vector>

#include "analysis/montecarlo/campaign.h"

namespace imucal {

// Of b0 … bM in the plan's normalisation, row-major [dph^2], without missing seconds and effects.
struct TruthCovariance {
  std::vector<double> actual;   // the error this filter makes on the true model
  std::vector<double> believed; // what the filter should say of itself
};
TruthCovariance truth_covariance(const CampaignPlan& plan);

} // namespace imucal
