// SPDX-License-Identifier: MIT
#include "base/temperature_step.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "health.h"

namespace imucal {

constexpr double kMostStep_degc = 100; // the core takes no more

double smallest_temperature_step(const std::vector<double>& temp_degc) {
  double least = std::numeric_limits<double>::infinity();
  for (size_t k = 1; k < temp_degc.size(); ++k) {
    const double step = std::abs(temp_degc[k] - temp_degc[k - 1]);
    if (step > 0) least = std::min(least, step);
  }
  return least;
}

double expected_temperature_step(double smallest_step_degc, double dt_s) {
  const double quantum = std::isfinite(smallest_step_degc) ? smallest_step_degc : 0;
  const double of_rows = dt_s > 1.01 ? static_cast<double>(IMUCAL_HEALTH_TEMP_RATE_DEGC_PER_S) * dt_s : 0;
  return std::min(kMostStep_degc, std::max(quantum, of_rows));
}

} // namespace imucal
