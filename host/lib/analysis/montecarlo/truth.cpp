// SPDX-License-Identifier: MIT
// What exact covariance analysis says of a campaign: no simulation, no core.
#include "analysis/montecarlo/truth.h"

#include "analysis/profile/covariance.h"

namespace imucal {

TruthCovariance truth_covariance(const CampaignPlan& plan) {
  CalibrationSetup setup;
  setup.order = plan.options.order;
  setup.lo_degc = plan.chain.t0_degc - plan.chain.range_degc;
  setup.hi_degc = plan.chain.t0_degc + plan.chain.range_degc;
  setup.prior_sigma_dph = plan.options.prior_sigma_dph;
  setup.truth = plan.options.model;
  setup.truth.effects.clear();
  setup.filter = plan.options.filter;
  CalibrationRun run;
  run.temp_degc = plan.chamber_degc;
  const CalibrationError error = calibration_error({run}, setup);
  return {error.covariance, error.believed_covariance};
}

} // namespace imucal
