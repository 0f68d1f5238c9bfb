// SPDX-License-Identifier: MIT
// The filters of the noise room for a run of a campaign.
#pragma once
#include "analysis/diagnose/campaign.h"
#include "noise/gains.h"
#include "noise/mixture.h"
#include "noise/whiten.h"

namespace imucal {

RunGains compute_gains(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2 = nullptr);
double mixture_log_likelihood(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual,
                              Eigen::VectorXd* scores = nullptr, Eigen::VectorXd* hit = nullptr);

} // namespace imucal
