// SPDX-License-Identifier: MIT
// The residual after compensation, as a user of the table meets it: a fresh test of the same device,
// compensated sample by sample by the core (`comp`) with the table learnt in the first test, and its DP type
// 2 curve.
//
// Expected:  E d^2 = E d^2 of the model alone (closed form, analysis/errormodel/expect.h) + trace(W_n P): the
// calibration error delta (covariance P) puts -h(T(t))' delta into the rate, of which the operator makes
// w_n(t0)' delta; W_n = mean over t0 of w_n w_n'.  The turn-on constants are known here and taken out.
#pragma once
#include <vector>

#include "analysis/montecarlo/campaign.h"

namespace imucal {

// W_n of every window of plan.dp_n, row-major; the model's own DP in closed form.
struct ResidualExpectation {
  std::vector<std::vector<double>> weight;
  std::vector<double> model_dp_dph;
};
ResidualExpectation expect_residual(const CampaignPlan& plan);

// Adds the mean squares of one device.  turn_on_dph: the constant of the calibration test less that of the
// fresh one.
void score_residual(const CampaignPlan& plan, const CoreChain& chain, const SimulatedLog& fresh, const SimOptions& sim,
                    double turn_on_dph, Tally* tally);
Json residual_json(const CampaignPlan& plan, const Tally& tally);

} // namespace imucal
