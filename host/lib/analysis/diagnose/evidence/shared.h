// SPDX-License-Identifier: MIT
// What the axes of one device share from second to second: correlation of what every axis's own answer leaves.
#pragma once
#include <cstddef>
#include <vector>

#include "analysis/diagnose/evidence/fit.h"

namespace imucal {

// One axis: its campaign, its fit, and the noise that whitened it.
struct AxisRest {
  const Campaign* campaign = nullptr;
  const Fit* fit = nullptr;
  NoiseModel noise;
};

// Two axes whose innovations of the same seconds go together.
struct SharedNoise {
  double correlation = 0;     // of the innovations
  double covariance_dph2 = 0; // of the white noise of 1-s means
  double gain_nats = 0;       // -n/2 log(1 - correlation^2): log-likelihood over independent axes
  size_t n = 0;               // seconds that both have
};

// Means over half a minute are taken off first: two axes with a slow cause each that nothing explains are not shared
// noise.  n = 0: no seconds in common.
SharedNoise shared_noise(const AxisRest& a, const AxisRest& b);

} // namespace imucal
