// SPDX-License-Identifier: MIT
// What only held-out logs have.  Somebody knocked against the chamber, a supply was switched, a pump ran: no fitted log can foretell
// it, and what the log says of everything else must not hang on it.  Its level after a jump is free under every hypothesis, and where
// its noise is stronger than that of the fitted logs it counts as so strong.
#pragma once
#include "analysis/diagnose/stages/slow_answer.h"

namespace imucal {

// Into `own_jumps` and `own_strength` of the held-out blocks, of which none may be known yet.  One or two jumps of a log: more are a noise, and so are
// those beside a noise that jumps.  Nor is one near a jump of a named cause: there the log speaks for or against that cause.  A
// jump is a change that no change over minutes follows as well, by the noise that was found and as strong as it is in that log.
// How strong the innovations of a log are, 1: as the noise says.  By the median of their differences from row to row: a
// burst does not move it, and a jump that is not taken yet shifts the level of the others.
double strength_of_innovations(const Eigen::VectorXd& e);
// Whether so strong a noise in n rows of a log is no chance, where n_fitted rows told the noise: of 1000 logs with this very
// noise one is, and none that is less than 1.25 times as strong.
bool is_clearly_stronger(double strength, size_t n, size_t n_fitted);
void forget_own(SlowAnswer* slow);
void find_own(const AxisQuestion& question, SlowAnswer* slow);
// Into the seconds of the held-out logs, each to its sample, by what a hypothesis leaves of them.
void place_own_jumps(const Campaign& blocks, const Hypothesis& found, Campaign* seconds);
// Their sizes as a fit of those seconds tells them.
void measure_own_jumps(const Fit& fit, Campaign* seconds);

} // namespace imucal
