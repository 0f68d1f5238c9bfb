// SPDX-License-Identifier: MIT
// How far the gap shrinks on data the fit never saw: held-out deviance of the nominal and of the final model.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "analysis/diagnose/select.h"

namespace imucal {

struct GapResult {
  std::string method;           // "held-out logs", "each log in turn", "quarters of the one log"
  double before = 0, after = 0; // deviance per hour above the best reference
  double shrinkage = 0;
  double ci_lo = 0, ci_hi = 0; // 95 % of the shrinkage
  double gain = 0, gain_lo = 0,
         gain_hi = 0;        // deviance per hour that the effects remove, with its 95 % interval
  double delta_deviance = 0; // D(nominal) - D(final), all held-out units
  std::vector<double> delta_by_unit;
  // Per term of the final hypothesis: deviance per hour that the held-out data lose when this term alone is
  // left out of it; negative: they speak against it.  NaN: a step, which belongs to its log.
  std::vector<double> gain_by_term;
  double hours = 0;
  double rms_before_dph = 0, rms_after_dph = 0; // 60-s means of rate minus fitted mean
  double dp2_before_dph = 0, dp2_after_dph = 0; // distance of the DP2 curves of data and model
  std::string interval_method, remainder;
  std::vector<double> dp2_tau_s, dp2_data_dph, dp2_nominal_dph, dp2_final_dph;
};

// `held_out`: further logs; nullptr: each log of `campaign` in turn.
GapResult measure_gap(const Campaign& campaign, const Campaign* held_out, const Selection& selection,
                      uint64_t seed);

} // namespace imucal
