// SPDX-License-Identifier: MIT
// The 1-s sums of raw samples of eight runs side by side, without the samples: the integers that the core's sum (sum.h)
// makes of what RawSampler gives for each run alone, from the same random numbers.  Sums of integers are exact, so that
// any order gives the same ones.
#pragma once
#include <array>
#include <cstdint>

#include "base/fast_normal.h"
#include "physics/sim/raw_samples.h"

namespace imucal {

// One second of one axis in every lane.
struct RawSums {
  int64_t counts[FastNormalLanes::kLanes]; // sum of the samples
  uint32_t saturated;                      // bit l: a sample of lane l is at its limit
};

class RawSummer {
public:
  static constexpr size_t kLanes = FastNormalLanes::kLanes;

  // Every sample comes, at its time, with nothing carried on and no noise of the thermometer.
  static bool can_sum(const RawFormat& format);

  // seed, run: of every lane, as RawSampler takes them; one axis.  usage_error: bad format.  Pre: can_sum(format).
  RawSummer(const RawFormat& format, const std::array<uint64_t, kLanes>& seed, const std::array<uint64_t, kLanes>& run);

  // The next n seconds.  mean_dph[8 k + lane]: finite; white_sigma_dph: in a 1-s mean, of all.
  void seconds(size_t n, const double* mean_dph, double white_sigma_dph, RawSums* out);
  // The counts that the thermometer shows in a second, the same in every sample.
  int32_t temp_counts(double temp_degc) const;
  uint32_t samples_per_second() const { return static_cast<uint32_t>(n_); }

private:
  RawFormat format_;
  size_t n_;
  FastNormalLanes noise_;
  std::vector<double> normals_; // of some seconds
};

} // namespace imucal
