// SPDX-License-Identifier: MIT
// Names against the tests of what is left: a kind of noise, or jumps, are names while what remains is noise by the tests.
#pragma once
#include "analysis/diagnose/stages/fast_stage.h"
#include "analysis/diagnose/stages/names.h"
#include "analysis/diagnose/stages/rest.h"

namespace imucal {

// A memory of which the logs show the start states of the runs and no loop.  Where runs began further out than a loop ever goes it
// stands in for another cause: it is left, and members in the mean that hold less with it.  Else its family is told: what begins
// anew in every run and fades looks alike.
void judge_unseen(Names* names);
// Jumps in time that all go one way and take back what a drift in time brings are the teeth of a saw: the drift is no cause of
// its own, and is left.
void judge_teeth(const Campaign& campaign, Names* names);
// `after`: tests of the innovations under the answer.  Opens names to their families, or leaves them: also small ones in the mean
// beside an open shape, or beside what the tests find left.
void open_by_rest(const AxisQuestion& question, const Found& found, const std::vector<RestFinding>& after,
                  Names* names);

} // namespace imucal
