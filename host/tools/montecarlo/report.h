// SPDX-License-Identifier: MIT
// What a campaign says: JSON (host/README.md) and a text table.
#pragma once
#include <string>

#include "analysis/montecarlo/campaign.h"

namespace imucal {

// Fields beside the contract's: believed is what the filter itself predicts (predicted_sigma_dph),
// truth_sigma_dph the exact error that this filter makes on the true model (truth covariance; equal where the
// models are). nees.mean: e' P^-1 e of the coefficients, expected value nees.expected = order + 1; ci95 is
// the interval in which the mean of that many runs lies with 95 % probability when the filter's covariance is
// right.  nis likewise, expected
// 1.  ratio_ci95: interval for the true ratio of empirical to predicted sigma at each temperature.
Json campaign_json(const CampaignPlan& plan, const CampaignResult& result);

// The same as text for people.
std::string campaign_text(const Json& json);

} // namespace imucal
