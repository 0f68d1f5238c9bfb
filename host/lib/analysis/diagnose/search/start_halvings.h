// SPDX-License-Identifier: MIT
// How finely the states in which a loop may have begun the logs must be followed: its start is a curve of which start columns take
// straight lines, and what these leave of a strong loop looks like a jump in time, or like slow noise.
#pragma once
#include "analysis/diagnose/search/slow_scan.h"

namespace imucal {

// For the loop that the logs may hold; RunInput::start_halvings, which the campaign searched should have.  `null`: the hypothesis
// without a name.  The nodes of `scans` must have been made.
int start_halvings(const SlowLikelihood& of, const SlowScan& scans, const SlowModel& null);

} // namespace imucal
