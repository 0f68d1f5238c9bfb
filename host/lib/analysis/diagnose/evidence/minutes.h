// SPDX-License-Identifier: MIT
// Means over a minute: an engineer reads from them how far rates are off.  And what the noise alone would make of them.
//
// A minute is as many whole rows as come nearest to 60 s, one at least: four blocks of a long log, 17 s each, are 68 s.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "noise/noise_model.h"

namespace imucal {

long rows_of_minute(double dt_s);
double minute_s(double dt_s); // how long these last

// Squares of the minutes of one stretch of rates, their number, and how strong the noise is there (CampaignRun::own_strength).
struct Minutes {
  double sum = 0, n = 0;
  double strength = 1;
  double own_white_dph2 = 0; // white variance of its means over 1 s beside that of the noise of all
};
// Adds those of a stretch; rows at its end that make no whole minute are left out.
void add_minutes(const Eigen::VectorXd& rest, double dt_s, Minutes* to);
// Of one stretch about its mean.
Minutes minutes_of(Eigen::VectorXd rest, double dt_s);
// Of the minutes of all stretches; none: 0.
double mean_square(const std::vector<Minutes>& rest);

// What the noise itself would make of the minutes of a stretch of `length_s`: their mean square about the mean of the stretch.
double noise_of_minutes(const NoiseModel& noise, double minute_s, double length_s);
// The same over stretches of different lengths and strengths, weighted by their minutes.
double noise_of_all(const NoiseModel& noise, double minute_s, const std::vector<Minutes>& rest);
// Standard error of that.
double error_of_minutes(const NoiseModel& noise, double minute_s, const std::vector<Minutes>& rest);

} // namespace imucal
