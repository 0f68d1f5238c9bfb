// SPDX-License-Identifier: MIT
// One search for causes beside a hypothesis without a name: singles, pairs, a third name, kinds of slow noise, and exchanges among
// them.
#pragma once
#include "analysis/diagnose/search/slow_scan.h"

namespace imucal {

// The hypothesis without a name, the likeliest from several time constants.
SlowModel fit_null(const SlowLikelihood& of);

// `about`: the noise about which the nodes of noise lie; `null`: the hypothesis without a name; `in_time`: the same with the jumps in
// time that were found, against which those at a temperature stand, or nullptr.
SlowResult search_causes(const SlowLikelihood& of, SlowScan* scans, const SlowModel& about, const SlowModel& null,
                         const SlowModel* in_time);

// The best hypothesis with exactly these causes, in the mean and at most one kind of slow noise, under the nodes of a search:
// `found`.  Causes that cannot be asked are left out.
SlowModel best_with(const SlowLikelihood& of, const SlowScan& scans, const SlowResult& found,
                    const std::vector<const Effect*>& effects);

} // namespace imucal
