// SPDX-License-Identifier: MIT
// Normal numbers by the hundred million: ziggurat (Marsaglia and Tsang 2000, 256 layers, 53-bit abscissae) on
// xoshiro256++ (Blackman and Vigna 2019).  A stream is seeded from an addressed Rng, so it depends on (seed,
// run, axis, purpose) only and never on threads.  About 3 ns per number; Rng::normal takes several times
// that.
#pragma once
#include <cstdint>

#include "base/rng.h"

namespace imucal {

class FastNormal {
public:
  explicit FastNormal(Rng seeder);
  uint64_t bits() {
    const uint64_t result = rotated(s_[0] + s_[3], 23) + s_[0];
    const uint64_t t = s_[1] << 17;
    s_[2] ^= s_[0];
    s_[3] ^= s_[1];
    s_[1] ^= s_[2];
    s_[0] ^= s_[3];
    s_[2] ^= t;
    s_[3] = rotated(s_[3], 45);
    return result;
  }
  double uniform() { return (static_cast<double>(bits() >> 11) + 0.5) * 0x1p-53; } // in (0, 1)
  double normal() {                                                                // mean 0, variance 1
    const uint64_t random = bits();
    const unsigned layer = random & 0xff;
    const auto signed_part = static_cast<int64_t>(random) >> 11; // 53 bits with the sign
    const double x = static_cast<double>(signed_part) * table_->scale[layer];
    if (signed_part < table_->inside[layer] && signed_part > -table_->inside[layer]) return x;
    return rare(layer, x);
  }

private:
  // Layer i spans the heights y[i] … y[i+1] of exp(-x^2/2) and is x_edge[i] wide.
  struct Table {
    double scale[256];   // x per unit of the 52-bit integer
    int64_t inside[256]; // below it the point surely lies under the curve
    double x_edge[257], y[257];
    Table();
  };
  static const Table& table();
  static uint64_t rotated(uint64_t x, int k) { return (x << k) | (x >> (64 - k)); }
  double rare(unsigned layer, double x);

  const Table* table_ = &table();
  uint64_t s_[4];
};

} // namespace imucal
