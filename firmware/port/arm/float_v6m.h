/* SPDX-License-Identifier: MIT */
/* Float addition, multiplication and division for a Cortex-M0, which has neither float instructions nor a multiplication
 * of more than 32 bits.  libgcc has one C source for all machines without them; these take less than half of its
 * instructions because they do usual numbers only: no zeros but as the smaller summand, nothing subnormal, infinite or NaN,
 * no exponent near either end, and hardly any result half way between two floats.  Everything else they leave to libgcc
 * (false), so that every result has the bits of IEEE 754, round to nearest even: nothing that uses floats sees a difference
 * but time (tests/firmware/test_float_v6m.c and test_float_v6m_hard.c, make cycles).
 * A float is sign, exponent e, 23 bits of fraction: (-1)^sign 2^(e - 150) m, m in [2^23, 2^24) with the leading one. */
#ifndef IMUCAL_PORT_FLOAT_V6M_H
#define IMUCAL_PORT_FLOAT_V6M_H

#include <stdbool.h>
#include <stdint.h>

#define FLOAT_SIGN 0x80000000u
#define FLOAT_ONE 0x00800000u /* the leading one of m, and a step of the exponent */

/* Sign and e.  Sums of heads: e adds to e, and the sum of two signs has the product's in its last bit. */
static inline uint32_t float_head(uint32_t bits) {
  return bits >> 23;
}
static inline uint32_t float_m(uint32_t bits) {
  return (bits & (FLOAT_ONE - 1)) | FLOAT_ONE;
}
/* e in 66 .. 190: products and quotients of two such have an e in 1 .. 254, whatever their m. */
static inline bool float_is_usual(uint32_t head) {
  return (uint8_t)head - 66u <= 124;
}
/* head: the result's, less one, which the leading one of m adds; m may be 2^24 by rounding up. */
static inline uint32_t float_of(uint32_t head, uint32_t m) {
  return (head << 23) + m;
}

/* P = m_a m_b in [2^46, 2^48), by halves of 16 and 8 bits; top = floor(P / 2^16) has all the bits that are kept and the one
 * that rounds.  What is below them matters only where that one is followed by zeros: those are left.
 * Heads: 2^(e_a - 150) m_a 2^(e_b - 150) m_b = 2^(e_a + e_b - 127 - 150) P/2^23. */
static inline bool float_mul(uint32_t a, uint32_t b, uint32_t* product) {
  const uint32_t head_a = float_head(a), head_b = float_head(b);
  if (!float_is_usual(head_a) || !float_is_usual(head_b)) return false;
  const uint32_t head = head_a + head_b;
  const uint32_t a_1 = float_m(a) >> 16, b_1 = float_m(b) >> 16, a_0 = (uint16_t)a, b_0 = (uint16_t)b;
  const uint32_t top = (a_1 * b_1 << 16) + a_1 * b_0 + a_0 * b_1 + (a_0 * b_0 >> 16);
  if ((top & FLOAT_SIGN) != 0) { /* 2^47 or more; top <= 2^32 - 2^9: no carry */
    const uint32_t rounded = top + 0x80;
    *product = float_of(head - 127, rounded >> 8);
    return rounded << 24 != 0;
  }
  const uint32_t rounded = top + 0x40;
  *product = float_of(head - 128, rounded >> 7);
  return rounded << 25 != 0;
}

/* m with seven bits more, 2^30 .. 2^31. */
static inline uint32_t float_m7(uint32_t bits) {
  return (bits << 8 | FLOAT_SIGN) >> 1;
}
/* Half way between two floats, unless a place of b was lost below: to the even one. */
static inline bool float_add_half(uint32_t head, uint32_t m, uint32_t shift, uint32_t* sum) {
  *sum = float_of(head, m & ~1u);
  return shift <= 7;
}

/* What b loses below the seven bits, if more than seven places down, matters only where those are half a place: rounded up
 * or down by more than that loss everywhere else.  The larger's e is 32 .. 253: it can fall by 25 and rise by one, and with
 * shift <= 25 the smaller is an ordinary number too. */
static inline bool float_add(uint32_t a, uint32_t b, uint32_t* sum) {
  if (a << 1 < b << 1) {
    const uint32_t larger = b;
    b = a;
    a = larger;
  }
  const uint32_t e = a << 1 >> 24, shift = e - (b << 1 >> 24);
  if (e - 32 > 221) return false;
  if (shift > 25) { /* b is below a quarter of the last place of a */
    *sum = a;
    return true;
  }
  uint32_t head = float_head(a);
  const uint32_t m_b = float_m7(b) >> shift;
  uint32_t s = float_m7(a);
  if (((a ^ b) & FLOAT_SIGN) == 0) {
    s += m_b;
    if ((s & FLOAT_SIGN) != 0) { /* at most 2^32 - 2^8: no carry */
      const uint32_t rounded = s + 0x80;
      if (rounded << 24 == 0) return float_add_half(head, rounded >> 8, shift, sum);
      *sum = float_of(head, rounded >> 8);
      return true;
    }
  } else {
    s -= m_b;
    if (s == 0) { /* a - a is +0 */
      *sum = 0;
      return true;
    }
    for (; s < 1u << 30; s <<= 1) head--;
  }
  const uint32_t rounded = s + 0x40;
  if (rounded << 25 == 0) return float_add_half(head - 1, rounded >> 7, shift, sum);
  *sum = float_of(head - 1, rounded >> 7);
  return true;
}

/* m_a/m_b in [1, 2) to 24 places, two digits of 13 and 11 bits, each a product with x <= 2^39/divisor, so that none is too
 * large; what they lack is made up at the end.  Differences modulo 2^32: the true ones are small.  A quotient of two m is
 * never half way between two floats, so what is left over does not matter.
 * x: 1/t at t = (floor(divisor/2^8) + 1)/2^16 in (1/2, 1], by the line 2.928 - 2 t (7.2 % off) and two Newton steps, which
 * err downwards only, x (2 - t x) = (1 - error^2)/t: 0.52 %, 0.003 % and what rounding down takes, together below
 * 2^-13.5.  So the first digit lacks at most 3, rest < 4 divisor; the second at most 2. */
static inline bool float_div(uint32_t a, uint32_t b, uint32_t* quotient) {
  uint32_t head = float_head(a), rest = float_m(a);
  const uint32_t head_b = float_head(b), divisor = float_m(b);
  if (!float_is_usual(head) || !float_is_usual(head_b)) return false;
  head += 126 - head_b;
  if (rest < divisor) {
    rest <<= 1;
    head--;
  }
  const uint32_t t_q16 = (divisor >> 8) + 1;
  uint32_t x = 95951 - t_q16;         /* 2^15/t, 16 bits */
  x = x * (-(t_q16 * x) >> 16) >> 15; /* t x: 31 fractional bits */
  x = x * (-(t_q16 * x) >> 16) >> 15;
  const uint32_t digit = (rest >> 9) * x >> 17;
  rest = (rest << 13) - digit * divisor;
  const uint32_t next = (rest >> 10) * x >> 18;
  rest = (rest << 11) - next * divisor;
  uint32_t m = (digit << 11) + next;
  for (; rest >= divisor; rest -= divisor) m++;
  *quotient = float_of(head, (m + 1) >> 1);
  return true;
}

#endif
