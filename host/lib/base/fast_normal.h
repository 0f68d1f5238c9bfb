// SPDX-License-Identifier: MIT
// Normal numbers by the hundred million: ziggurat (Marsaglia and Tsang 2000, 256 layers, 53-bit abscissae) on
// xoshiro256++ (Blackman and Vigna 2019).  A stream is seeded from an addressed Rng, so it depends on (seed,
// run, axis, purpose) only and never on threads.  About 3 ns per number; Rng::normal takes several times
// that.
#pragma once
#include <array>
#include <cstddef>
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
  friend class FastNormalLanes;
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

// Eight streams side by side, for eight things simulated at once: each gives the numbers that it gives alone, bit for bit.
// With AVX-512 in about half the time (`kernels`, row normals_of_8).
class FastNormalLanes {
public:
  static constexpr size_t kLanes = 8;
  explicit FastNormalLanes(const std::array<FastNormal, kLanes>& streams) : streams_(streams) {}
  // The next n numbers of every stream: out[8 i + lane], i < n.  A call costs as much as two of them.
  void normals(size_t n, double* out);

private:
  void normals_one_by_one(size_t n, double* out);
  void normals_avx512(size_t n, double* out);

  std::array<FastNormal, kLanes> streams_;
};

} // namespace imucal
