// SPDX-License-Identifier: MIT
// The model that reproduces what was found, for gyrosim, montecarlo and profile.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/result.h"

namespace imucal {

// Adds what the axes have to `model`, which is the believed one or empty: effects, and what was estimated in place of what
// nobody believed, or of what does not fit the logs.  Adds to `model_warnings` where a model cannot hold all axes.
// `sensor`: all axes that the model is of, those that were not asked too.
void complete_model(const std::vector<std::string>& sensor, DiagnoseResult* result);

} // namespace imucal
