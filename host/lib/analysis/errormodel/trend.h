// SPDX-License-Identifier: MIT
// Noise is what is left when the temperature's part is gone: does the rate of a log still follow its temperature?
#pragma once
#include "analysis/dp/series.h"

namespace imucal {

// F statistic (3 and n - 4 degrees of freedom; fewer where the temperatures tell no cubic) of a cubic in temperature for
// the means of 32 blocks: long blocks are nearly independent where the noise is short against them.  0 where there is no
// temperature, it moves by less than 0.5 degC, or too few blocks are whole.
double temperature_f(const Series& series);

// Above it the rate follows the temperature: false alarm 1e-4 with independent blocks.
constexpr double kTemperatureF = 10.0;

} // namespace imucal
