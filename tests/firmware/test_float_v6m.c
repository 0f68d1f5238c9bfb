// SPDX-License-Identifier: MIT
/* The Cortex-M0's own float arithmetic against this machine's: the same bits, or left to libgcc. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "num.h"
#include "port/arm/float_v6m.h"

typedef bool (*operation_t)(uint32_t a, uint32_t b, uint32_t* out);

static float sum(float a, float b) {
  return a + b;
}
static float product(float a, float b) {
  return a * b;
}
static float quotient(float a, float b) {
  return a / b;
}

static const struct {
  const char* name;
  operation_t mine;
  float (*exact)(float a, float b);
} operations[] = {{"add", float_add, sum}, {"mul", float_mul, product}, {"div", float_div, quotient}};

/* Checks all three; the number of those that were done here. */
static unsigned check(uint32_t a, uint32_t b) {
  unsigned n_done = 0;
  for (size_t k = 0; k < sizeof operations / sizeof operations[0]; k++) {
    uint32_t out = 0;
    if (!operations[k].mine(a, b, &out)) continue;
    n_done++;
    const uint32_t exact =
        imucal_bits_from_float(operations[k].exact(imucal_float_from_bits(a), imucal_float_from_bits(b)));
    if (out != exact)
      fail_msg("%s %08x %08x: %08x, exactly %08x", operations[k].name, (unsigned)a, (unsigned)b, (unsigned)out,
               (unsigned)exact);
  }
  return n_done;
}

static uint64_t state = 88172645463325252u; /* xorshift64: any seed but 0 */
static uint32_t bits(void) {
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  return (uint32_t)(state >> 20);
}

/* Any bits; and of near exponents, where sums cancel and round. */
static void test_float_any_bits_same_result_or_left(void** unused) {
  (void)unused;
  for (int i = 0; i < 1000000; i++) {
    const uint32_t a = bits(), b = bits();
    check(a, b);
    check(a, (b & 0x807FFFFFu) | ((a + (bits() % 9 << 23) - (4u << 23)) & 0x7F800000u));
  }
}

/* Few bits set: sums, products and quotients that are exact or half way between two floats. */
static void test_float_few_bits_same_result_or_left(void** unused) {
  (void)unused;
  for (int i = 0; i < 1000000; i++) {
    const uint32_t e_a = 100 + bits() % 56, e_b = 100 + bits() % 56;
    check((bits() & 0x807F0001u) | e_a << 23, (bits() & 0x80600003u) | e_b << 23);
  }
}

static void test_float_edges_same_result_or_left(void** unused) {
  (void)unused;
  static const uint32_t edges[] = {0,           1,           0x007FFFFFu, 0x00800000u, 0x00800001u, 0x00FFFFFFu,
                                   0x3F7FFFFFu, 0x3F800000u, 0x3F800001u, 0x3FFFFFFFu, 0x4B000000u, 0x4B7FFFFFu,
                                   0x7E800000u, 0x7F000000u, 0x7F7FFFFFu, 0x7F800000u, 0x7F800001u, 0x7FC00000u};
  const size_t n = sizeof edges / sizeof edges[0];
  for (size_t i = 0; i < n; i++)
    for (size_t j = 0; j < n; j++)
      for (uint32_t sign = 0; sign < 4; sign++) check(edges[i] | sign << 31, edges[j] | sign >> 1 << 31);
}

/* What a filter computes is done here and not by libgcc: all but one in 60. */
static void test_float_usual_numbers_are_not_left(void** unused) {
  (void)unused;
  unsigned n_done = 0;
  for (int i = 0; i < 100000; i++) {
    const uint32_t e_a = 110 + bits() % 30, e_b = 110 + bits() % 30;
    n_done += check((bits() & 0x807FFFFFu) | e_a << 23, (bits() & 0x807FFFFFu) | e_b << 23);
  }
  if (n_done < 300000u - 5000u) fail_msg("%u of 300000", n_done);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_float_any_bits_same_result_or_left),
      cmocka_unit_test(test_float_few_bits_same_result_or_left),
      cmocka_unit_test(test_float_edges_same_result_or_left),
      cmocka_unit_test(test_float_usual_numbers_are_not_left),
  };
  return cmocka_run_group_tests_name("float_v6m", tests, NULL, NULL);
}
