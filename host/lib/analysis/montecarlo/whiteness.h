// SPDX-License-Identifier: MIT
// Whiteness of a filter's innovations over the second half of a test: before, while the prior is being forgotten,
// innovations carry the difference between the true coefficients and the prior and are neither white nor of variance S.
// Of one run (double, float), or of eight side by side (Lanes8, Lanes8f).
#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "base/simd.h"

namespace imucal {

// Lags at which the innovations' autocorrelation is kept [s].
constexpr int kInnovationLags[] = {1, 2, 5, 10, 20, 50, 100};
constexpr size_t kInnovationLagCount = sizeof kInnovationLags / sizeof kInnovationLags[0];

IMUCAL_WIDE_PART void widen(const float& from, double& to) {
  to = static_cast<double>(from);
}
IMUCAL_WIDE_PART void widen(const Lanes8f& from, Lanes8& to) {
  to = __builtin_convertvector(from, Lanes8);
}
IMUCAL_WIDE_PART void square_root(const float& of, float& root) {
  root = std::sqrt(of);
}
IMUCAL_WIDE_PART void square_root(const Lanes8f& of, Lanes8f& root) {
  for (size_t lane = 0; lane < 8; ++lane) root[lane] = std::sqrt(of[lane]);
}

template <class Double, class Float> struct Whiteness {
  static constexpr size_t kRing = 128;
  Float ring[kRing] = {}; // the newest innovations over their standard deviations, e(k)
  uint64_t n = 0;
  Double lag_sums[kInnovationLagCount] = {}; // of e(k) e(k - lag)
  int64_t lag_counts[kInnovationLagCount] = {};
  Double weighted = {}, inverse = {}; // sums of nu/S and 1/S

  IMUCAL_WIDE_PART void keep(const Float& innovation, const Float& weight) {
    Float e;
    square_root(weight, e);
    e = innovation * e;
    Double now, then;
    widen(Float(innovation * weight), now);
    weighted += now;
    widen(weight, now);
    inverse += now;
    widen(e, now);
    for (size_t i = 0; i < kInnovationLagCount; ++i) {
      const auto lag = static_cast<uint64_t>(kInnovationLags[i]);
      if (n < lag) break;
      widen(ring[(n - lag) % kRing], then);
      lag_sums[i] += now * then;
      ++lag_counts[i];
    }
    ring[n++ % kRing] = e;
  }
};

} // namespace imucal
