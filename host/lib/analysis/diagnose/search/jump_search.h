// SPDX-License-Identifier: MIT
// Whether jumps in time stand beside the causes, and which: the search without them and beside them.
#pragma once
#include "analysis/diagnose/search/slow_scan.h"

namespace imucal {

// `start`: the hypothesis without a name, as fitted first; `start_null`: that, or the one with the noise as believed where this does
// better.
SlowResult search_with_jumps(const SlowLikelihood& of, SlowScan* scans, const SlowModel& start,
                             const SlowModel& start_null);

} // namespace imucal
