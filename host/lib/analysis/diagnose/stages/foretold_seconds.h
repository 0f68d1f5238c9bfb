// SPDX-License-Identifier: MIT
// What an answer makes of the likelihood of held-out seconds.  Block means hide a tone and a noise of the seconds: where one is
// named, the gain is that of the seconds.
//
// A unit (a log, or a quarter of the only one) has under a hypothesis the density
//   log p = log p(y | b) + log p(b) - 1/2 log |H|   at the likeliest b,   H the curvature there,
// exact where the noise is Gaussian.  b are a constant (flat), start states, cosine and sine of a tone (normal, as large as they
// were in the fitted logs), and the coefficients of the fitted logs, known from these as well as they are.
#pragma once
#include <vector>

#include "analysis/diagnose/stages/gap.h"
#include "analysis/diagnose/stages/selected.h"

namespace imucal {

// Whether a name is of the seconds: a tone, or noise that is not slow.
bool has_names_of_seconds(const std::vector<SelectedEffect>& effects);
// Deviance that the answer takes off each unit of measure_gap; jumps in time are of single logs, and foretell none.
std::vector<double> gain_of_seconds(const Campaign& fitted, const Campaign* held_out, const Hypothesis& nominal,
                                    const Hypothesis& final);

} // namespace imucal
