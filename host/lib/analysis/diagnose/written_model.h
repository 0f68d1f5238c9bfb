// SPDX-License-Identifier: MIT
// The model that reproduces what was found, for gyrosim, montecarlo and profile.
#pragma once
#include "analysis/diagnose/result.h"

namespace imucal {

// Adds what the axes have to `model`, which is the believed one or empty: effects, and what was estimated in place of what
// nobody believed.  Adds to `model_warnings` where a model cannot hold all axes.
void complete_model(DiagnoseResult* result);

} // namespace imucal
