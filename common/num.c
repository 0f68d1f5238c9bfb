// SPDX-License-Identifier: MIT
#include "num.h"

bool imucal_is_within(float value, float lo, float hi) {
  return imucal_is_finite(value) && value >= lo && value <= hi;
}

/* value = m 2^e with e even and m in [2^24, 2^26).  The root of m 2^24, in [2^24, 2^25), has one bit more than a
 * float.  A tie cannot occur: the square of an odd 25-bit number has about 50 significant bits, no float has.  So
 * rounding by that one bit is rounding to nearest even. */
float imucal_sqrtf(float value) {
  uint32_t bits = imucal_bits_from_float(value);
  if (!imucal_is_finite(value) || (bits >> 31) != 0 || bits == 0) return 0.0f;
  int32_t exponent = (int32_t)(bits >> 23) - 150;
  uint32_t mantissa = bits & 0x7FFFFFu;
  if (exponent == -150) {
    exponent = -149; /* subnormal: at most 23 rounds */
    while (mantissa < 0x800000u) {
      mantissa <<= 1;
      exponent--;
    }
  } else {
    mantissa |= 0x800000u;
  }
  uint32_t shift = (exponent & 1) != 0 ? 1u : 2u;
  mantissa <<= shift;
  exponent -= (int32_t)shift;
  uint64_t radicand = (uint64_t)mantissa << 24;
  uint32_t root = 0;
  for (uint32_t bit = (uint32_t)1 << 24; bit != 0; bit >>= 1) {
    uint32_t trial = root | bit;
    if ((uint64_t)trial * trial <= radicand) root = trial;
  }
  uint32_t rounded = (root + 1u) >> 1; /* [2^23, 2^24]; at 2^24 the carry below raises the exponent */
  return imucal_float_from_bits(((uint32_t)(exponent / 2 - 11 + 150) << 23) + (rounded - 0x800000u));
}

int64_t imucal_divide_rne(int64_t numerator, int64_t denominator) {
  int64_t quotient = numerator / denominator;
  int64_t remainder = numerator % denominator;
  if (remainder < 0) { /* to floor division: 0 <= remainder < denominator */
    remainder += denominator;
    quotient -= 1;
  }
  int64_t twice_excess = 2 * remainder - denominator;
  if (twice_excess > 0 || (twice_excess == 0 && (quotient & 1) != 0)) quotient += 1;
  return quotient;
}
