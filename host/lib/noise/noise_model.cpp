// SPDX-License-Identifier: MIT
#include "noise/noise_model.h"

namespace imucal {

NoiseModel gaussian_equivalent(NoiseModel noise) {
  noise.hit_probability = noise.hit_sigma_dph = 0;
  if (noise.telegraph_dph > 0) noise.markov.push_back({noise.telegraph_dph, noise.telegraph_tau_s});
  noise.telegraph_dph = noise.telegraph_tau_s = 0;
  return noise;
}

} // namespace imucal
