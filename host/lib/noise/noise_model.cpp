// SPDX-License-Identifier: MIT
#include "noise/noise_model.h"

#include "base/units.h"

namespace imucal {

NoiseModel noise_of(const ErrorModel& model) {
  NoiseModel out;
  out.white_sigma_dph = white_sigma_dph(model.arw_deg_rt_h, 1.0);
  for (const Markov& m : model.markov)
    if (m.sigma_dph > 0) out.markov.push_back(m);
  return out;
}

NoiseModel gaussian_equivalent(NoiseModel noise) {
  noise.hit_probability = noise.hit_sigma_dph = 0;
  if (noise.telegraph_dph > 0) noise.markov.push_back({noise.telegraph_dph, noise.telegraph_tau_s});
  noise.telegraph_dph = noise.telegraph_tau_s = 0;
  return noise;
}

} // namespace imucal
