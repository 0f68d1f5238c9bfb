// SPDX-License-Identifier: MIT
// What the core's rules are to expect of a log's thermometer (common/health.h, temp_step_degc): one answer for all programs.
#pragma once
#include <vector>

namespace imucal {

// Smallest step between neighbouring readings, the quantum of the thermometer or finer; infinite where nothing moves.  Not
// finite readings are none.
double smallest_temperature_step(const std::vector<double>& temp_degc);

// temp_step_degc of rows that are dt_s apart, with that smallest step: the quantum, and rows further apart than a second may lie
// further apart in temperature.
double expected_temperature_step(double smallest_step_degc, double dt_s);

} // namespace imucal
