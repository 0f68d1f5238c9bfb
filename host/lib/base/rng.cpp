// SPDX-License-Identifier: MIT
#include "base/rng.h"

#include <algorithm>
#include <cmath>

#include "base/units.h"

namespace imucal {

uint32_t Rng::bits() {
  if (used_ == 4) {
    block_ = r123::Philox4x32()(counter_, key_);
    ++counter_[0];
    used_ = 0;
  }
  return block_[used_++];
}

static double uniform_of(uint64_t high, uint64_t low) {
  return (static_cast<double>((high << 21) ^ (low >> 11)) + 0.5) * 0x1p-53;
}

double Rng::uniform() {
  const uint64_t high = bits(), low = bits();
  return uniform_of(high, low);
}

struct NormalPair {
  double first, second;
};

// Box-Muller: two at a time.
static NormalPair normals_of(double u, double v) {
  const double radius = std::sqrt(-2.0 * std::log(u));
  const double angle = 2.0 * kPi * v;
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

double Rng::normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const double u = uniform();
  const NormalPair pair = normals_of(u, uniform());
  spare_ = pair.second;
  has_spare_ = true;
  return pair.first;
}

// A block of four words makes a pair.  Blocks first and pairs after them: nothing waits for what is before it.
void Rng::normals(uint32_t first, size_t n, double* out, size_t stride) const {
  constexpr size_t kBlocks = 32;
  r123::Philox4x32::ctr_type blocks[kBlocks], counter = counter_;
  const size_t end = first + n;
  for (size_t pair = first / 2; 2 * pair < end; pair += kBlocks) {
    const size_t n_blocks = std::min(kBlocks, (end + 1) / 2 - pair);
    for (size_t i = 0; i < n_blocks; ++i) {
      counter[0] = static_cast<uint32_t>(pair + i);
      blocks[i] = r123::Philox4x32()(counter, key_);
    }
    for (size_t i = 0; i < n_blocks; ++i) {
      const auto& b = blocks[i];
      const NormalPair both = normals_of(uniform_of(b[0], b[1]), uniform_of(b[2], b[3]));
      const size_t k = 2 * (pair + i);
      if (k >= first) out[(k - first) * stride] = both.first;
      if (k + 1 < end) out[(k + 1 - first) * stride] = both.second;
    }
  }
}

} // namespace imucal
