// SPDX-License-Identifier: MIT
// Noise of the thermometer that the gyro does not feel.
//
// The polynomial is taken at the readings, as a device compensates.  Where B is steep, the noise of the readings then comes into the
// rates, and whatever looks at smoothed temperatures explains it: a lag of no length.  So the rates are asked: from sample to sample
// they follow c times what the polynomial makes of the readings less the smoothed temperatures.  c is 1 where the gyro feels what the
// thermometer shows, 0 where all of that is noise, and between the two where the temperature is restless and the thermometer noisy.
// (1 - c)^2 / (2 var c) is the logarithm of the likelihood of c over 1.
#pragma once
#include <optional>

#include "analysis/diagnose/logs/campaign.h"

namespace imucal {

struct ThermometerNoise {
  double felt = 0; // c, from 0 to 1: the part of what readings are off the smoothed temperatures that the gyro feels
  double rms_degc = 0;  // of the rest
  double rms_dph = 0;   // that they put into compensated rates
  double white_dph = 0; // of the rates themselves, from sample to sample
  // Whether rates that are compensated at every reading are noisier by 1 % and more.
  bool is_notable() const { return rms_dph > 0.14 * white_dph; }
};

// Of a campaign whose polynomial is taken at the readings: the noise that its rates do without.  nullopt: they follow the readings, or
// do not tell, or the thermometer is coarse (an effect of the library knows its steps).
std::optional<ThermometerNoise> thermometer_noise(const Campaign& campaign);

// From here on the polynomial is taken at the smoothed temperatures and the part of the rest that the gyro feels.
void take_smoothed(double felt, Campaign* campaign);

} // namespace imucal
