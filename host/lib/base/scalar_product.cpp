// SPDX-License-Identifier: MIT
#include "base/scalar_product.h"

#include "base/simd.h"

namespace imucal {

// Eight chains side by side: an addition does not wait for the one before.
IMUCAL_WIDE double scalar_product(const double* a, const double* b, size_t n) {
  Lanes s0 = {0, 0, 0, 0}, s1 = s0;
  size_t i = 0;
  for (; i + 8 <= n; i += 8) {
    Lanes a0, a1, b0, b1;
    load_lanes(&a0, &a[i]), load_lanes(&a1, &a[i + 4]);
    load_lanes(&b0, &b[i]), load_lanes(&b1, &b[i + 4]);
    s0 += a0 * b0;
    s1 += a1 * b1;
  }
  const Lanes s = s0 + s1;
  double sum = (s[0] + s[1]) + (s[2] + s[3]);
  for (; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

} // namespace imucal
