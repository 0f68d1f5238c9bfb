// SPDX-License-Identifier: MIT
// Means over a minute: what an engineer reads off a chart, and what is left of it when the noise is taken into account.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "noise/noise_model.h"

namespace imucal {

constexpr double kMinute_s = 60;

// Squares of the minutes of one stretch of rates, and their number.
struct Minutes {
  double sum = 0, n = 0;
};
// About the mean of the stretch; rows at its end that make no whole minute are left out.
Minutes minutes_of(Eigen::VectorXd rest, double dt_s);
// Over all stretches; none: 0.
double mean_square(const std::vector<Minutes>& rest);

// What the noise itself would make of the minutes of a stretch of `length_s`: their mean square about the mean of the stretch.
double noise_of_minutes(const NoiseModel& noise, double length_s);
// Standard error of the mean square over stretches of different lengths, weighted by their minutes.
double error_of_minutes(const NoiseModel& noise, const std::vector<Minutes>& rest);

} // namespace imucal
