// SPDX-License-Identifier: MIT
// From what the slow stage found to names: members of the library, families, jumps in time and kinds of slow noise.
#pragma once
#include "analysis/diagnose/stages/names.h"
#include "analysis/diagnose/stages/slow_answer.h"

namespace imucal {

// The first names; `dropped` are those of `slow` and a kind of noise that held-out data speak against.
Names name_slow(const AxisQuestion& question, const SlowAnswer& slow);

} // namespace imucal
