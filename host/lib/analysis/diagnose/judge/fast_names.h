// SPDX-License-Identifier: MIT
// From what the seconds say to names: lines, the best kind of fast noise, other parameters of the believed noise.
#pragma once
#include "analysis/diagnose/stages/fast_stage.h"
#include "analysis/diagnose/stages/names.h"

namespace imucal {

// Beside the names of the slow stage.
void name_fast(const AxisQuestion& question, const Found& found, Names* names);
// Re-tuned noise is a finding of its own: it comes last and takes nobody's place.
void name_retuned(const AxisQuestion& question, const Found& found, Names* names);

} // namespace imucal
