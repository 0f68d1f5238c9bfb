/* SPDX-License-Identifier: MIT */
/* Float addition, multiplication and division for a Cortex-M0, which has neither float instructions nor a multiplication
 * of more than 32 bits.  libgcc has one C source for all machines without them; these take some two thirds of its
 * instructions because they do ordinary numbers only: operands and result neither zero nor subnormal, infinite or NaN, and
 * hardly any that lie half way between two floats.  Everything else they leave to libgcc (false), so that every result has
 * the bits of IEEE 754, round to nearest even: nothing that uses floats sees a difference but time
 * (tests/firmware/test_float_v6m.c and test_float_v6m_hard.c, make cycles).
 * A float is sign, exponent e, 23 bits of fraction: (-1)^sign 2^(e - 150) m, m in [2^23, 2^24) with the leading one. */
#ifndef IMUCAL_PORT_FLOAT_V6M_H
#define IMUCAL_PORT_FLOAT_V6M_H

#include <stdbool.h>
#include <stdint.h>

#define FLOAT_SIGN 0x80000000u
#define FLOAT_ONE 0x00800000u /* the leading one of m, and a step of the exponent */

static inline uint32_t float_exponent(uint32_t bits) {
  return bits << 1 >> 24;
}
static inline uint32_t float_m(uint32_t bits) {
  return (bits & (FLOAT_ONE - 1)) | FLOAT_ONE;
}
/* 1 .. 254: an ordinary number. */
static inline bool float_is_ordinary(uint32_t e) {
  return e - 1 < 254;
}
/* e: the result's exponent before rounding, less one; a carry out of m raises it, at most to 254. */
static inline bool float_fits(uint32_t e) {
  return e < 253;
}
/* The leading one of m adds the one that e lacks. */
static inline uint32_t float_of(uint32_t sign, uint32_t e, uint32_t m) {
  return (sign >> 31 << 31) | ((e << 23) + m);
}

/* P = m_a m_b in [2^46, 2^48), by halves of 16 and 8 bits; top = floor(P / 2^16) has all the bits that are kept and the one
 * that rounds.  What is below them matters only where that one is followed by zeros. */
static inline bool float_mul(uint32_t a, uint32_t b, uint32_t* product) {
  const uint32_t e_a = float_exponent(a), e_b = float_exponent(b);
  if (!float_is_ordinary(e_a) || !float_is_ordinary(e_b)) return false;
  const uint32_t a_1 = float_m(a) >> 16, b_1 = float_m(b) >> 16, a_0 = (uint16_t)a, b_0 = (uint16_t)b;
  uint32_t top = (a_1 * b_1 << 16) + a_1 * b_0 + a_0 * b_1 + (a_0 * b_0 >> 16);
  uint32_t e = e_a + e_b - 127;
  if ((top & FLOAT_SIGN) == 0) {
    top <<= 1;
    e--;
  }
  if (!float_fits(e)) return false;
  if (top << 24 == FLOAT_SIGN) return false;
  *product = float_of(a ^ b, e, (top >> 8) + (top >> 7 & 1u));
  return true;
}

/* m with seven bits more.  What b loses below them, if more than seven places down, matters only where those seven are half
 * a place: rounded up or down by more than that loss everywhere else. */
static inline bool float_add(uint32_t a, uint32_t b, uint32_t* sum) {
  if (a << 1 < b << 1) {
    const uint32_t larger = b;
    b = a;
    a = larger;
  }
  uint32_t e = float_exponent(a);
  const uint32_t e_b = float_exponent(b), shift = e - e_b;
  if (e > 254 || e_b == 0) return false;
  if (shift > 25) { /* b is below a quarter of the last place of a */
    *sum = a;
    return true;
  }
  const uint32_t m_b = float_m(b) << 7 >> shift;
  uint32_t s = float_m(a) << 7;
  if (((a ^ b) & FLOAT_SIGN) == 0) {
    s += m_b;
    if ((s & FLOAT_SIGN) != 0) {
      s = s >> 1 | (s & 1u);
      e++;
    }
  } else {
    s -= m_b;
    if (s == 0) { /* a - a is +0 */
      *sum = 0;
      return true;
    }
    for (; s < 1u << 30; s <<= 1) e--;
  }
  if (!float_fits(--e)) return false;
  uint32_t m = (s >> 7) + (s >> 6 & 1u);
  if (s << 25 == FLOAT_SIGN) {
    if (shift > 7) return false;
    m &= ~1u;
  }
  *sum = float_of(a, e, m);
  return true;
}

/* Digit by digit: 24 digits and one to round by.  A quotient of two m is never half way between two floats. */
#define FLOAT_DIGIT                                                                                                    \
  m <<= 1;                                                                                                             \
  if (rest >= divisor) {                                                                                               \
    rest -= divisor;                                                                                                   \
    m++;                                                                                                               \
  }                                                                                                                    \
  rest <<= 1;
static inline bool float_div(uint32_t a, uint32_t b, uint32_t* quotient) {
  const uint32_t e_a = float_exponent(a), e_b = float_exponent(b), divisor = float_m(b);
  if (!float_is_ordinary(e_a) || !float_is_ordinary(e_b)) return false;
  uint32_t rest = float_m(a), e = e_a - e_b + 126, m = 0;
  if (rest < divisor) {
    rest <<= 1;
    e--;
  }
  if (!float_fits(e)) return false;
  for (uint32_t i = 0; i < 5; i++) {
    FLOAT_DIGIT FLOAT_DIGIT FLOAT_DIGIT FLOAT_DIGIT FLOAT_DIGIT
  }
  *quotient = float_of(a ^ b, e, (m + 1) >> 1);
  return true;
}

#endif
