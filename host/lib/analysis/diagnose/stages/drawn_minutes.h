// SPDX-License-Identifier: MIT
// Minutes of held-out logs (minutes.h) under draws of a noise, which may follow the temperature.
#pragma once
#include <vector>

#include "analysis/diagnose/evidence/reduction.h"

namespace imucal {

// What a noise of block means makes of the minutes of these units, each about its mean: the mean square, and by how much one
// draw of the noise scatters about it.
struct MinutesOfNoise {
  double ms_dph2 = 0, ms_error_dph2 = 0;
};
MinutesOfNoise drawn_minutes(const std::vector<HeldOutUnit>& units, const NoiseModel& noise, double dt_s);

// How the minutes change by an answer.  Were it right, all that it leaves would be noise and errors of its fit, whose
// product with the change scatters about nothing.
struct Growth {
  double times = 1;  // their rms, after over before
  double errors = 0; // by so many standard deviations that product speaks against the change
};
Growth growth_of_minutes(const std::vector<HeldOutUnit>& units, const NoiseModel& noise, double dt_s);

} // namespace imucal
