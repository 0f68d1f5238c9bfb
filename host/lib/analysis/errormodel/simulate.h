// SPDX-License-Identifier: MIT
// Noise of a model's components, sample by sample: for the checks, studies and benchmarks of this room.
// (Whole logs with temperature, thermometer and effects: gyrosim.)
#pragma once
#include <cstdint>
#include <vector>

#include "noise/components.h"

namespace imucal {

// n samples; streams are addressed by (seed, run, axis) so that the result does not depend on threads or order.
// Markov terms start stationary, the random walk at 0, the ramp is 0 in the middle, a sinusoid has a random phase.
std::vector<double> simulate_noise(const std::vector<NoiseComponent>& components, long n, uint64_t seed, uint64_t run,
                                   uint32_t axis = 0);

} // namespace imucal
