// SPDX-License-Identifier: MIT
// Names against the tests of what is left: a kind of noise, or jumps, are names while what remains is noise by the tests.
#pragma once
#include "analysis/diagnose/fast_stage.h"
#include "analysis/diagnose/names.h"

namespace imucal {

// A member that its own coefficients contradict is left, and members in the mean that hold less with it: a memory whose runs
// began further out than it ever goes stands in for another cause.
void leave_contradicted(Names* names);
// `after`: tests of the innovations under the answer.  Opens names to their families, or leaves them.
void open_by_rest(const AxisQuestion& question, const Found& found, const std::vector<RestFinding>& after,
                  Names* names);

} // namespace imucal
