// SPDX-License-Identifier: MIT
// A block of Philox's four words -> two normal numbers (Box and Muller 1958): sqrt(-2 ln u) times cosine and sine of 2 pi v.
// Logarithm, sine and cosine are written out here instead of asked of libm: so that they can be done for eight blocks side
// by side, and so that a seed gives the same bits with every libm.  Only + - * / and square roots, each rounded correctly.
// Errors (test_base.cpp): logarithm below 4.5e-16 of itself, sine and cosine below 2.3e-16.
//
// Written for one number (V double, W uint64_t) and for a vector of them: W holds the bits of V, or integers.
// Results through references, so that no vector is passed in registers that a processor may lack.
#pragma once
#include <cmath>
#include <cstdint>
#include <cstring>

#include "base/simd.h"
#include "base/units.h"

namespace imucal {

template <class To, class From> IMUCAL_WIDE_PART void copy_bits(const From& from, To& to) {
  static_assert(sizeof to == sizeof from, "the same bits");
  std::memcpy(&to, &from, sizeof to);
}

// An integer below 2^52 as a double: it stands in the fraction of 2^52.
template <class V, class W> IMUCAL_WIDE_PART void whole_number(const W& integer, V& out) {
  copy_bits(W(integer | 0x4330000000000000), out);
  out = out - 0x1p52;
}

// Two words of 32 bits -> (0, 1], 53 bits: those of Rng::uniform.
template <class V, class W> IMUCAL_WIDE_PART void uniform_of(const W& high, const W& low, V& out) {
  const W bits = high << 21 ^ low >> 11;
  V upper, lower;
  whole_number(W(bits >> 32), upper);
  whole_number(W(bits & 0xFFFFFFFF), lower);
  out = (upper * 0x1p32 + lower + 0.5) * 0x1p-53;
}

// ln u of an ordinary u > 0: u = 2^k m, m in [sqrt(1/2), sqrt(2)); ln m = 2 artanh s = 2 (s + s^3/3 + s^5/5 + ..),
// s = (m - 1)/(m + 1), |s| < 0.172: what follows s^23/23 is below 2^-66 of the sum.
template <class V, class W> IMUCAL_WIDE_PART void logarithm(const V& u, V& out) {
  constexpr uint64_t root_half = 0x3FE6A09E667F3BCD;
  W bits;
  copy_bits(u, bits);
  const W exponent = (bits - root_half + 0x3FF0000000000000) >> 52; // k + 1023
  V m, k;
  copy_bits(W(bits - (exponent << 52) + 0x3FF0000000000000), m);
  whole_number(exponent, k);
  const V s = (m - 1.0) / (m + 1.0), z = s * s;
  V sum = z * (1.0 / 23) + 1.0 / 21;
  for (const double term : {1.0 / 19, 1.0 / 17, 1.0 / 15, 1.0 / 13, 1.0 / 11, 1.0 / 9, 1.0 / 7, 1.0 / 5, 1.0 / 3})
    sum = sum * z + term;
  const V twice = s + s;
  constexpr double kLn2 = 0.69314718055994530942;
  out = (k - 1023.0) * kLn2 + (twice + twice * z * sum);
}

// cos and sin of 2 pi v, 0 <= v <= 1, by Taylor's series in the nearest quarter of the circle: |angle| <= pi/4, what follows
// is below 2^-60.
template <class V, class W> IMUCAL_WIDE_PART void cos_sin(const V& v, V& cosine, V& sine) {
  const V shifted = v * 4.0 + 0x1.8p52; // rounds to a whole number of quarters, which stands in the last bits
  W quarter;
  copy_bits(shifted, quarter);
  const V angle = (v - (shifted - 0x1.8p52) * 0.25) * (2.0 * kPi), z = angle * angle;
  V c = z * (1.0 / 20922789888000.0) - 1.0 / 87178291200.0; // 1/16! and 1/14!
  for (const double term : {1.0 / 479001600, -1.0 / 3628800, 1.0 / 40320, -1.0 / 720, 1.0 / 24, -0.5}) c = c * z + term;
  c = c * z + 1.0;
  V s = z * (1.0 / 355687428096000.0) - 1.0 / 1307674368000.0; // 1/17! and 1/15!
  for (const double term : {1.0 / 6227020800.0, -1.0 / 39916800, 1.0 / 362880, -1.0 / 5040, 1.0 / 120, -1.0 / 6})
    s = s * z + term;
  s = angle + angle * z * s;
  // After one quarter (cos, sin) is (-sin, cos).
  const W odd = W() - (quarter & 1);
  W c_bits, s_bits;
  copy_bits(c, c_bits);
  copy_bits(s, s_bits);
  const W exchanged = (c_bits ^ s_bits) & odd;
  copy_bits(W((c_bits ^ exchanged) ^ ((quarter + 1) & 2) << 62), cosine);
  copy_bits(W((s_bits ^ exchanged) ^ (quarter & 2) << 62), sine);
}

} // namespace imucal
