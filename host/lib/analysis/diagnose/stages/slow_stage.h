// SPDX-License-Identifier: MIT
// The slow stage of one axis: the search in block means (search.h), weighed against data that were not fitted.  A jump in
// time, a kind of slow noise or a name stays where these data say so; a free function of everything that repeats is held
// against the answer.
#pragma once
#include "analysis/diagnose/stages/slow_answer.h"

namespace imucal {

// Data and search of these logs: those of the question, or the same less the levels of noise that jumps.  Sets
// logs->spread_dph.
void prepare_slow(const AxisQuestion& question, Campaign* logs, const Campaign* held_out, SlowAnswer* slow);
// Searches and weighs what prepare_slow has laid out.
void run_slow(const AxisQuestion& question, SlowAnswer* slow);
// What found.best leaves of a cause, after it was changed.
void look_beside(const AxisQuestion& question, SlowAnswer* slow);

} // namespace imucal
