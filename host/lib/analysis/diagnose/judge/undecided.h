// SPDX-License-Identifier: MIT
// Slow noise explains it, but a repeatable cause that takes most of it would do so as well: both are said.
#pragma once
#include "analysis/diagnose/stages/names.h"
#include "analysis/diagnose/stages/slow_answer.h"

namespace imucal {

// `names`: of what the slow stage found.  Where there are such causes, its only effect becomes one that leaves it open.
void name_undecided(const AxisQuestion& question, const SlowAnswer& slow, Names* names);

} // namespace imucal
