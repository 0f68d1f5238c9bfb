// SPDX-License-Identifier: MIT
// Size and shape of an effect whose runs begin anywhere between two extremes of its own size, as a play does.
#pragma once
#include "analysis/diagnose/stages/slow_answer.h"

namespace imucal {

// From the likelihood over the shape of a name of found.best, the state in which each run began at its best within the extremes.
// The free start columns of the search are not bounded by the size, and follow a play from any start only nearly: where logs do
// not turn, a shape far from the true one may take their whole course.  Errors become wide enough to hold every shape that is as
// likely; a shape that is not goes; where any larger one would do, only the ratio of size and shape is told.
void tell_bounded(const SlowAnswer& slow, size_t name, SelectedEffect* effect);

} // namespace imucal
