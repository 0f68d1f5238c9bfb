// SPDX-License-Identifier: MIT
#include "base/rng.h"

#include <algorithm>
#include <cmath>

#include "base/box_muller.h"
#include "base/simd.h"

#if defined(IMUCAL_AVX512)
#include <immintrin.h>
#endif

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
  double u;
  uniform_of(high, low, u);
  return u;
}

struct NormalPair {
  double first, second;
};

// Box-Muller: two at a time.
static NormalPair normals_of(double u, double v) {
  double log_u, cosine, sine;
  logarithm<double, uint64_t>(u, log_u);
  cos_sin<double, uint64_t>(v, cosine, sine);
  const double radius = std::sqrt(-2.0 * log_u);
  return {radius * cosine, radius * sine};
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

constexpr size_t kSide = 8; // blocks side by side

// Blocks pair … pair + kSide - 1: what normals_of makes of each.
static void block_normals(const r123::Philox4x32::key_type& key, const r123::Philox4x32::ctr_type& counter, size_t pair,
                          double* first, double* second) {
  r123::Philox4x32::ctr_type at = counter;
  for (size_t i = 0; i < kSide; ++i) {
    at[0] = static_cast<uint32_t>(pair + i);
    const auto b = r123::Philox4x32()(at, key);
    double u, v;
    uniform_of<double, uint64_t>(b[0], b[1], u);
    uniform_of<double, uint64_t>(b[2], b[3], v);
    const NormalPair both = normals_of(u, v);
    first[i] = both.first;
    second[i] = both.second;
  }
}

#if defined(IMUCAL_AVX512)
typedef uint64_t Words8 __attribute__((vector_size(64)));

// Philox's ten rounds on eight counters: words of 32 bits, each in the lower half of 64.  The upper halves of what is only
// multiplied may hold anything.
IMUCAL_AVX512 static void philox_of_8(const r123::Philox4x32::key_type& key, Words8 (&c)[4]) {
  uint32_t k_0 = key[0], k_1 = key[1];
  for (int round = 0; round < 10; ++round, k_0 += PHILOX_W32_0, k_1 += PHILOX_W32_1) {
    const auto p_0 = Words8(_mm512_maskz_mul_epu32(0xff, __m512i(c[0]), _mm512_set1_epi64(PHILOX_M4x32_0)));
    const auto p_1 = Words8(_mm512_maskz_mul_epu32(0xff, __m512i(c[2]), _mm512_set1_epi64(PHILOX_M4x32_1)));
    c[0] = p_1 >> 32 ^ c[1] ^ uint64_t { k_0 };
    c[1] = p_1 & 0xFFFFFFFF;
    c[2] = p_0 >> 32 ^ c[3] ^ uint64_t { k_1 };
    c[3] = p_0 & 0xFFFFFFFF;
  }
}

// block_normals in vectors, the same bits.
IMUCAL_AVX512 static void block_normals_avx512(const r123::Philox4x32::key_type& key,
                                               const r123::Philox4x32::ctr_type& counter, size_t pair, double* first,
                                               double* second) {
  const Words8 places = {0, 1, 2, 3, 4, 5, 6, 7}, none = {};
  Words8 c[4] = {(places + pair) & 0xFFFFFFFF, none + counter[1], none + counter[2], none + counter[3]};
  philox_of_8(key, c);
  Lanes8 u, v, log_u, cosine, sine;
  uniform_of(c[0], c[1], u);
  uniform_of(c[2], c[3], v);
  logarithm<Lanes8, Words8>(u, log_u);
  cos_sin<Lanes8, Words8>(v, cosine, sine);
  const auto radius = Lanes8(_mm512_mask_sqrt_pd(_mm512_setzero_pd(), 0xff, -2.0 * log_u));
  store_lanes(Lanes8(radius * cosine), first);
  store_lanes(Lanes8(radius * sine), second);
}
#endif

// A block of four words makes a pair.
void Rng::normals(uint32_t first, size_t n, double* out, size_t stride) const {
#if defined(IMUCAL_AVX512)
  const auto make = has_avx512() ? block_normals_avx512 : block_normals;
#else
  const auto make = block_normals;
#endif
  const size_t end = first + n;
  for (size_t pair = first / 2; 2 * pair < end; pair += kSide) {
    double even[kSide], odd[kSide];
    make(key_, counter_, pair, even, odd);
    const size_t from = std::max<size_t>(first, 2 * pair), to = std::min(end, 2 * (pair + kSide));
    for (size_t k = from; k < to; ++k) {
      const double* half = k & 1 ? odd : even;
      out[(k - first) * stride] = half[k / 2 - pair];
    }
  }
}

} // namespace imucal
