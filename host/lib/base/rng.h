// SPDX-License-Identifier: MIT
// Counter-based random numbers (Philox 4x32-10, Salmon et al. 2011, through Random123): every stream is
// addressed by (seed, run, axis, purpose), so that results do not depend on threads or on order.
#pragma once
#include <Random123/philox.h>

#include <cstddef>
#include <cstdint>

namespace imucal {

// What a stream of random numbers is for; streams of different purpose never overlap.
enum class Stream : uint32_t {
  kWhite = 1,
  kMarkov = 2,
  kTurnOn = 3,
  kBias = 4,
  kJitter = 5,
  kThermometer = 6,
  kMissing = 7,
  kEffect = 100 /* + place of the effect in the list */,
  kTool = 1000
};

class Rng {
public:
  Rng(uint64_t seed, uint64_t run, uint32_t axis, uint32_t purpose)
      : key_{{static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32)}},
        counter_{{0, static_cast<uint32_t>(run), axis, purpose ^ (static_cast<uint32_t>(run >> 32) * 0x9E3779B9u)}} {}
  Rng(uint64_t seed, uint64_t run, uint32_t axis, Stream purpose)
      : Rng(seed, run, axis, static_cast<uint32_t>(purpose)) {}

  uint32_t bits();  // 32 random bits; a stream holds 2^34 of them
  double uniform(); // in (0, 1), 53 bits
  double normal();  // mean 0, variance 1

  // Normal numbers first … first + n - 1 of the stream, counted from its beginning whatever was drawn before: those that
  // normal() gives, bit for bit, in half the time.  They are written `stride` apart.
  void normals(uint32_t first, size_t n, double* out, size_t stride = 1) const;

private:
  r123::Philox4x32::key_type key_;
  r123::Philox4x32::ctr_type counter_;
  r123::Philox4x32::ctr_type block_{};
  unsigned used_ = 4;
  double spare_ = 0;
  bool has_spare_ = false;
};

} // namespace imucal
