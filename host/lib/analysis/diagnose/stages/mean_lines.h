// SPDX-License-Identifier: MIT
// Lines of the spectrum that join the mean: which one is named next, and how exactly it is placed.
#pragma once
#include <optional>

#include "analysis/diagnose/stages/question.h"
#include "analysis/diagnose/stages/selected.h"

namespace imucal {

constexpr size_t kMostLines = 3; // that are named

// The line to name next, if any is strong enough.  `e`: innovations of what the answer leaves, run by run.
std::optional<NamedLine> line_found(const AxisQuestion& question, const std::vector<Eigen::VectorXd>& e);
// Whether the temperatures of these logs have that line too, or one of half its frequency, and the rates follow it from run to
// run: what follows the cycle of a chamber, in proportion or by its size, is no tone, however little it seems to drift.
bool is_of_temperature(const Campaign& campaign, const NamedLine& line);
// As an effect of the answer.
SelectedEffect effect_of_line(const NamedLine& line);
// Standard errors of the place of a line that is one of the terms of a design, under the noise of the answer.
Theta line_errors(const Campaign& campaign, const Design& design, const Fit& fit, const NoiseModel& noise,
                  const Term& line, size_t i_term);

} // namespace imucal
