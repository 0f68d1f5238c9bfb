// SPDX-License-Identifier: MIT
#include "base/rng.h"

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

double Rng::uniform() {
  const uint64_t high = bits(), low = bits();
  return (static_cast<double>((high << 21) ^ (low >> 11)) + 0.5) * 0x1p-53;
}

// Box-Muller: two at a time.
double Rng::normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const double radius = std::sqrt(-2.0 * std::log(uniform()));
  const double angle = 2.0 * kPi * uniform();
  spare_ = radius * std::sin(angle);
  has_spare_ = true;
  return radius * std::cos(angle);
}

} // namespace imucal
