// SPDX-License-Identifier: MIT
/* A second look at the Cortex-M0's float arithmetic, by somebody else than its author: what the linker puts in (float_v6m.c, all
 * four operations, with what it leaves answered by this machine) must have the bits of IEEE 754 for numbers built to be hard.
 * Reference: this machine's floats, themselves held against doubles rounded once: 53 bits are at least 2 * 24 + 2, so the double's
 * own rounding cannot be seen in a float's sum, difference, product or quotient (Figueroa, When is double rounding innocuous?,
 * SIGNUM Newsletter 30(3), 1995; that is for ordinary results, subnormal ones are held to the float alone). */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "num.h"
#include "port/arm/float_v6m.c"

enum { ADD, SUB, MUL, DIV, N_OPERATIONS };
static const char sign_of[] = "+-*/";

static uint64_t n_asked, n_left[N_OPERATIONS];

static float of_bits(uint32_t bits) {
  return imucal_float_from_bits(bits);
}

#define OPERATIONS_IN(number)                                                                                          \
  static number in_##number(int what, number a, number b) {                                                            \
    return what == ADD ? a + b : what == SUB ? a - b : what == MUL ? a * b : a / b;                                    \
  }
OPERATIONS_IN(float)
OPERATIONS_IN(double)

/* In libgcc's place. */
static uint32_t left(int what, uint32_t a, uint32_t b) {
  n_left[what]++;
  return imucal_bits_from_float(in_float(what, of_bits(a), of_bits(b)));
}
uint32_t __real___aeabi_fadd(uint32_t a, uint32_t b) {
  return left(ADD, a, b);
}
uint32_t __real___aeabi_fsub(uint32_t a, uint32_t b) {
  return left(SUB, a, b);
}
uint32_t __real___aeabi_fmul(uint32_t a, uint32_t b) {
  return left(MUL, a, b);
}
uint32_t __real___aeabi_fdiv(uint32_t a, uint32_t b) {
  return left(DIV, a, b);
}

static void check_one(int what, uint32_t a, uint32_t b) {
  static uint32_t (*const mine[])(uint32_t, uint32_t) = {__wrap___aeabi_fadd, __wrap___aeabi_fsub, __wrap___aeabi_fmul,
                                                         __wrap___aeabi_fdiv};
  const uint32_t out = mine[what](a, b);
  const float exact = in_float(what, of_bits(a), of_bits(b));
  const double wide = in_double(what, (double)of_bits(a), (double)of_bits(b));
  n_asked++;
  if (isnan(exact)) {
    if (!isnan(of_bits(out))) fail_msg("%08x %c %08x: %08x is a number", a, sign_of[what], b, out);
    return;
  }
  if (out != imucal_bits_from_float(exact))
    fail_msg("%08x %c %08x: %08x, exactly %08x", a, sign_of[what], b, out, imucal_bits_from_float(exact));
  if (fabs(wide) >= 0x1p-126 && out != imucal_bits_from_float((float)wide))
    fail_msg("%08x %c %08x: %08x, by doubles %08x", a, sign_of[what], b, out, imucal_bits_from_float((float)wide));
}

/* All four, both ways round, all signs. */
static void check(uint32_t a, uint32_t b) {
  for (uint32_t signs = 0; signs < 4; signs++)
    for (int what = 0; what < N_OPERATIONS; what++) {
      const uint32_t s_a = a ^ signs << 31, s_b = b ^ (signs >> 1) << 31;
      check_one(what, s_a, s_b);
      check_one(what, s_b, s_a);
    }
}

static uint64_t seed;
static uint32_t random_bits(void) { /* splitmix64 */
  uint64_t z = seed += 0x9E3779B97F4A7C15u;
  z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
  z = (z ^ z >> 27) * 0x94D049BB133111EBu;
  return (uint32_t)((z ^ z >> 31) >> 13);
}
static uint32_t float_from(uint32_t e, uint32_t m) {
  return e << 23 | (m & 0x7FFFFFu);
}
static uint32_t between(uint32_t lo, uint32_t hi) {
  return lo + random_bits() % (hi - lo + 1);
}

static int begin(void** state) {
  (void)state;
  n_asked = 0;
  for (int what = 0; what < N_OPERATIONS; what++) n_left[what] = 0;
  seed = 20261122;
  return 0;
}

/* Zeros, subnormals, the least and the largest ordinary numbers, ones, infinities, NaNs, last bits odd and even: each with each. */
static void test_float_hard_every_special_pattern_with_every_other(void** state) {
  (void)state;
  static const uint32_t e[] = {0,   1,   2,   3,   23,  24,  25,  63,  64,  102, 103, 125, 126,
                               127, 128, 150, 151, 152, 190, 191, 229, 230, 252, 253, 254, 255};
  static const uint32_t m[] = {0,        1,        2,        3,        0x0007FF, 0x000800, 0x000801, 0x3FFFFF,
                               0x400000, 0x400001, 0x555555, 0x2AAAAA, 0x7FF800, 0x7FFFFD, 0x7FFFFE, 0x7FFFFF};
  enum { N_M = sizeof m / sizeof m[0], N = N_M * (sizeof e / sizeof e[0]) };
  assert_true(N > 400);
  for (uint32_t i = 0; i < N; i++)
    for (uint32_t j = i; j < N; j++) check(float_from(e[i / N_M], m[i % N_M]), float_from(e[j / N_M], m[j % N_M]));
}

/* Sums: b's lost places are a half exactly, a half and one more, a half less one, all ones, one alone; the last bit of a odd and
 * even; a at the power of two, where a difference is normalised after it was rounded. */
static void test_float_hard_sums_at_and_beside_the_half(void** state) {
  (void)state;
  static const uint32_t m_a[] = {0, 1, 2, 3, 0x400000, 0x7FFFFC, 0x7FFFFD, 0x7FFFFE, 0x7FFFFF};
  for (uint32_t shift = 1; shift <= 27; shift++)
    for (size_t i = 0; i < sizeof m_a / sizeof m_a[0]; i++)
      for (uint32_t n = 0; n < 200; n++) {
        const uint32_t lost = shift < 24 ? shift : 24, half = 1u << (lost - 1), mask = (half << 1) - 1;
        const uint32_t ends[] = {half, half + 1, half - 1, mask, 1, 0};
        const uint32_t e_a = between(shift + 1, 254), kept = random_bits() & 0x7FFFFFu & ~mask;
        for (size_t k = 0; k < sizeof ends / sizeof ends[0]; k++) {
          check(float_from(e_a, m_a[i]), float_from(e_a - shift, kept | (ends[k] & mask)));
          check(float_from(e_a, random_bits()), float_from(e_a - shift, kept | (ends[k] & mask)));
        }
      }
}

/* What is left when neighbours are taken from one another: one last place, down to subnormals and zero. */
static void test_float_hard_differences_of_neighbours(void** state) {
  (void)state;
  for (uint32_t e = 0; e <= 254; e++)
    for (uint32_t n = 0; n < 40; n++) {
      const uint32_t a = float_from(e, n < 4 ? n : n < 8 ? 0x7FFFFF - (n - 4) : random_bits());
      for (uint32_t apart = 0; apart <= 3; apart++) check(a, a + apart); /* over the power of two too */
      check(a, a + (1u << 23));
      check(a, (a + (1u << 23)) ^ 1u);
    }
}

/* m with m * odd = wanted, modulo 2^24. */
static uint32_t solve(uint32_t odd, uint32_t wanted) {
  uint32_t inverse = odd;
  for (int i = 0; i < 5; i++) inverse *= 2 - odd * inverse;
  return inverse * wanted & 0xFFFFFFu;
}

/* Products whose lost 23 or 24 places are a half, or a half with a little more or less far below; exponents lo .. hi. */
static void check_products_beside_the_half(uint32_t lo, uint32_t hi) {
  uint32_t n_found = 0;
  for (uint32_t n = 0; n < 40000; n++) {
    const uint32_t m_a = between(0x800000, 0xFFFFFF) | 1, places = 23 + (n & 1), half = 1u << (places - 1);
    const uint32_t m_b = solve(m_a, half + between(0, 16) - 8);
    if (m_b < 0x800000) continue;
    n_found++;
    check(float_from(between(lo, hi), m_a), float_from(between(lo, hi), m_b));
  }
  assert_true(n_found > 15000);
}
static void test_float_hard_products_at_and_beside_the_half(void** state) {
  (void)state;
  check_products_beside_the_half(66, 190);
  assert_true(n_left[MUL] < n_asked / 4 / 3); /* most were computed here */
  check_products_beside_the_half(1, 254);
  for (uint32_t n = 0; n < 20000; n++) { /* two factors of 12 and 13 bits: 25 bits, the last one is the half */
    const uint32_t p = between(0x800, 0xFFF) | 1, q = between(0x1000, 0x1FFF) | 1;
    check(float_from(between(90, 160), p << 12), float_from(between(90, 160), q << 11));
  }
}

/* Quotients as near to a half as 24 bits allow: a is the nearest m to (odd half places) times b. */
static void check_quotients_beside_the_half(uint32_t lo, uint32_t hi) {
  uint32_t n_found = 0;
  for (uint32_t n = 0; n < 60000; n++) {
    const uint64_t quotient = (uint64_t)between(0x1000000, 0x1FFFFFF) | 1, m_b = between(0x800000, 0xFFFFFF);
    for (int places = 24; places <= 25; places++) {
      const uint64_t m_a = (quotient * m_b + (1ull << (places - 1))) >> places;
      if (m_a < 0x800000 || m_a > 0xFFFFFF) continue;
      n_found++;
      for (int64_t d = -1; d <= 1; d++)
        check(float_from(between(lo, hi), (uint32_t)m_a + (uint32_t)d), float_from(between(lo, hi), (uint32_t)m_b));
    }
  }
  assert_true(n_found > 50000);
}
static void test_float_hard_quotients_beside_the_half(void** state) {
  (void)state;
  check_quotients_beside_the_half(66, 190);
  assert_int_equal(n_left[DIV], 0);
  check_quotients_beside_the_half(40, 215);
}

/* The quotient's two digits: every divisor that its reciprocal can see, with its lost bits least and most, at both ends of
 * the quotient and in between. */
static void test_float_hard_every_reciprocal(void** state) {
  (void)state;
  for (uint32_t t = 0x8000; t <= 0xFFFF; t++)
    for (uint32_t lost = 0; lost <= 0xFF; lost += 0x55) {
      const uint32_t m_b = t << 8 | lost, m_a[] = {0x800000, m_b - 1, m_b, m_b + 1, 0xFFFFFF, random_bits() | 0x800000};
      for (size_t i = 0; i < sizeof m_a / sizeof m_a[0]; i++)
        check_one(DIV, float_from(127, m_a[i]), float_from(127, m_b));
    }
  assert_int_equal(n_left[DIV], 0);
}

/* Results round the largest float, infinity, the least ordinary number and the subnormals. */
static void test_float_hard_results_at_both_ends_of_the_exponent(void** state) {
  (void)state;
  for (uint32_t n = 0; n < 40000; n++) {
    const uint32_t e = between(1, 254), top = between(252, 256) + 127 - e, low = between(0, 28) + 104;
    const uint32_t m_a = n & 1 ? random_bits() : 0x7FFFFF - (random_bits() & 3),
                   m_b = n & 2 ? random_bits() : random_bits() & 3;
    if (top >= 1 && top <= 254) check(float_from(e, m_a), float_from(top, m_b));         /* a product */
    if (low >= e && low - e <= 254) check(float_from(e, m_a), float_from(low - e, m_b)); /* a small one */
    const uint32_t over = e + 127 - between(252, 256), under = e + 127 - between(0, 3);
    if (over >= 1 && over <= 254) check(float_from(e, m_a), float_from(over, m_b));    /* a quotient */
    if (under >= 1 && under <= 254) check(float_from(e, m_a), float_from(under, m_b)); /* a small one */
    check(float_from(between(252, 254), m_a), float_from(between(228, 254), m_b));     /* sums to infinity */
    check(float_from(between(0, 2), m_a), float_from(between(0, 26), m_b));            /* sums of the least */
  }
}

static void test_float_hard_random_bits(void** state) {
  (void)state;
  for (uint32_t n = 0; n < 4000000; n++) {
    const uint32_t a = random_bits(), b = n % 4 ? random_bits() : (random_bits() & 0x807FFFFFu) | (a & 0x7F800000u);
    for (int what = 0; what < N_OPERATIONS; what++) check_one(what, a, b);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_float_hard_every_special_pattern_with_every_other, begin),
      cmocka_unit_test_setup(test_float_hard_sums_at_and_beside_the_half, begin),
      cmocka_unit_test_setup(test_float_hard_differences_of_neighbours, begin),
      cmocka_unit_test_setup(test_float_hard_products_at_and_beside_the_half, begin),
      cmocka_unit_test_setup(test_float_hard_quotients_beside_the_half, begin),
      cmocka_unit_test_setup(test_float_hard_every_reciprocal, begin),
      cmocka_unit_test_setup(test_float_hard_results_at_both_ends_of_the_exponent, begin),
      cmocka_unit_test_setup(test_float_hard_random_bits, begin),
  };
  return cmocka_run_group_tests_name("float_v6m_hard", tests, NULL, NULL);
}
