// SPDX-License-Identifier: MIT
// The one home of unit conversions.  Rates inside the programs are in degrees per hour (dph), times in
// seconds, temperatures in degrees Celsius.
#pragma once
#include <string>

namespace imucal {

constexpr double kSecondsPerMinute = 60.0, kSecondsPerHour = 3600.0;
constexpr double kPi = 3.14159265358979323846;
constexpr double kDphPerDps = 3600.0;
constexpr double kDphPerRadps = 180.0 / kPi * 3600.0;
constexpr double kMgPerMs2 = 1000.0 / 9.80665;

// Angle random walk [deg/sqrt(h)] to the standard deviation [dph] of the white noise of means over dt_s:
// 60 arw / sqrt(dt).
double white_sigma_dph(double arw_deg_rt_h, double dt_s = 1.0);
// The inverse for 1-s means.
constexpr double arw_from_white_sigma(double sigma_dph) {
  return sigma_dph / 60.0;
}

// A number in a message: six digits at most.
std::string shown(double value);

} // namespace imucal
