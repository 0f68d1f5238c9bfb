// SPDX-License-Identifier: MIT
// The size of an effect that begins every run anew, each from another start (EffectEstimator::is_start_a_size).
#pragma once
#include "analysis/diagnose/evidence/fit.h"
#include "analysis/diagnose/stages/selected.h"

namespace imucal {

// Of a term of a hypothesis, by its fit; no runs: the effect is not of that kind.
StartSizes start_sizes(const Campaign& campaign, const Design& design, const Fit& fit, const Term& term, size_t place);
// The largest in the place of the mean over the runs, which is that of no run.
void tell_largest(SelectedEffect* effect);

} // namespace imucal
