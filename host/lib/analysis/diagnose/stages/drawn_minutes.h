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

// Rms of the minutes of these units, each about its mean: after what changes over before.  1: nothing to judge.
double growth_of_minutes(const std::vector<HeldOutUnit>& units, double dt_s);

} // namespace imucal
