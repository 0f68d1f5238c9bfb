// SPDX-License-Identifier: MIT
// Jumps in time of held-out logs.  Somebody knocked against the chamber, a supply was switched: no fitted log can foretell it, and
// what the log says of everything else must not hang on it.  Its level after such a jump is free under every hypothesis.
#pragma once
#include "analysis/diagnose/stages/slow_answer.h"

namespace imucal {

// Into `own_jumps` of the held-out blocks.  Only where the fitted logs have no jump of any kind, which might come back, and the
// held-out ones one or two each: more are a noise.  A jump is a change that no change over minutes follows as well, by the noise
// that was found.
void find_own_jumps(const AxisQuestion& question, SlowAnswer* slow);
// Into the seconds of the held-out logs, each to its sample, by what a hypothesis leaves of them.
void place_own_jumps(const Campaign& blocks, const Hypothesis& found, Campaign* seconds);
// Their sizes as a fit of those seconds tells them.
void measure_own_jumps(const Fit& fit, Campaign* seconds);

} // namespace imucal
