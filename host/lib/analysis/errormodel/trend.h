// SPDX-License-Identifier: MIT
// Does the rate of a log follow its temperature?  If it does, that part is no noise and must be removed first.
#pragma once
#include "analysis/dp/series.h"

namespace imucal {

// F statistic of a cubic in temperature, fitted to the means of 32 blocks: 3 and n - 4 degrees of freedom, fewer where
// the temperatures do not determine a cubic.  The blocks are nearly independent if the noise is short against them.
// 0 where there is no temperature, where it moves by less than 0.5 degC, or where too few blocks are whole.
double temperature_f(const Series& series);

// Above it the rate follows the temperature: false alarm 1e-4 with independent blocks.
constexpr double kTemperatureF = 10.0;

} // namespace imucal
