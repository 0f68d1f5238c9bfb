// SPDX-License-Identifier: MIT
// What the fit of the answer says of its terms: coefficients, and standard errors of coefficients and shapes.
#pragma once
#include "analysis/diagnose/stages/fast_stage.h"

namespace imucal {

// Into the terms of found->seconds.final and into the effects that are named by them.  `fit`: of that hypothesis.
void fill_coefficients(const AxisQuestion& question, const Fit& fit, Found* found,
                       std::vector<SelectedEffect>* effects);

} // namespace imucal
