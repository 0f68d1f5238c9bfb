// SPDX-License-Identifier: MIT
// What the fit of the answer says of its terms: coefficients, and standard errors of coefficients and shapes.
#pragma once
#include "analysis/diagnose/stages/fast_stage.h"

namespace imucal {

// Into the terms of found->seconds.final and into the effects that are named by them.  `fit`: of that hypothesis.
void fill_coefficients(const AxisQuestion& question, const Fit& fit, Found* found,
                       std::vector<SelectedEffect>* effects);
// Standard errors of the shapes of what is named in the mean, and what they add to those of its coefficients: with other time
// constants an amplitude is another.  Not known where the likelihood has no curvature at the shape.  After what was seen is
// judged, which asks for the error at the shape that was found.
void add_errors_of_shapes(const SlowAnswer& slow, std::vector<SelectedEffect>* effects);
// The same of slow noise that follows the temperature, beside the fast noise that was found.
void add_errors_of_noise(const AxisQuestion& question, const Found& found, std::vector<SelectedEffect>* effects);

} // namespace imucal
