// SPDX-License-Identifier: MIT
// Are the data of a fit those of a healthy sensor?  No model is to be made of a sick one in silence.
//
//   repeated     more than 40 seconds in a row have the same value (as common/health.h has it: chance 0.52^40), or rows repeat
//                the one before more often than by chance (sample and hold; base/repeats.h)
//   outliers     the mean square, which the fit takes, is more than 1.25 times that of the 95.4th percentile (dp's ratio), beyond
//                4 of its standard deviations: the tolerance and the probability of common/health.h
//   temp-jump, temp-spikes  as in common/health.h: a thermometer that jumps, or a column that is no temperature
#pragma once
#include <string>
#include <vector>

#include "analysis/dp/ratios.h"
#include "analysis/dp/series.h"

namespace imucal {

struct SanityReason {
  std::string log, axis, rule;
  double value = 0, limit = 0;
  std::string text; // one sentence with figures
};

struct Sanity {
  std::vector<SanityReason> reasons; // empty: nothing speaks against the axis
  DpRatios ratios;                   // dp's own verdict, of the Allan deviation
  std::string note;                  // events that dp would name, too small to matter here
};

std::vector<std::string> sanity_rules();

// `raw` with its temperatures where the log has some; `detrended`: the same axis, ready for a curve.
Sanity sanity_of(const Series& raw, const Series& detrended);

} // namespace imucal
