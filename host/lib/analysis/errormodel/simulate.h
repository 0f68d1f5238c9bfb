// SPDX-License-Identifier: MIT
// Noise of a model's components, sample by sample: for the checks, studies and benchmarks of this room.
// (Whole logs with temperature, thermometer and effects: gyrosim.)
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "noise/components.h"

namespace imucal {

// n samples; streams are addressed by (seed, run, axis) so that the result does not depend on threads or order.
// Markov terms start stationary, the random walk at 0, the ramp is 0 in the middle, a sinusoid has a random phase.
std::vector<double> simulate_noise(const std::vector<NoiseComponent>& components, long n, uint64_t seed, uint64_t run,
                                   uint32_t axis = 0);

// The same of several records, in two thirds of the time where the processor has AVX-512: up to eight streams of random
// numbers go side by side.  Bit for bit what simulate_noise gives.
constexpr size_t kStreamsAbreast = 8; // one for each component of each record
struct NoiseRecord {
  long n = 0;
  uint64_t run = 0;
  uint32_t axis = 0;
};
std::vector<std::vector<double>> simulate_noises(const std::vector<NoiseComponent>& components, uint64_t seed,
                                                 const std::vector<NoiseRecord>& records);

} // namespace imucal
