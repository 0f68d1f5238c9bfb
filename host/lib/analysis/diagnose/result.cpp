// SPDX-License-Identifier: MIT
#include "analysis/diagnose/result.h"

namespace imucal {

bool is_judged(const AxisResult& axis) {
  return axis.refused.empty() && !axis.study.selection.cannot_judge;
}

Parameters effect_values(const Term& term, const Campaign& campaign) {
  if (!term.fixed_parameters.empty()) return term.fixed_parameters;
  Estimate estimate = term.estimate();
  if (term.form() == Form::kSteps)
    for (size_t s = 0; s + 1 < estimate.shape.size(); s += 2) {
      const CampaignRun& run = campaign.runs[static_cast<size_t>(term.shape[s])];
      estimate.shape[s] = static_cast<double>(run.input.log);
      estimate.shape[s + 1] = time_in_log_s(run, estimate.shape[s + 1]);
    }
  return term.estimator->values_on(campaign.runs.front().input, estimate);
}

} // namespace imucal
