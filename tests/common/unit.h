// SPDX-License-Identifier: MIT
// What every CMocka test of the core includes, and repeatable random numbers (xorshift64*, Vigna 2016).
#ifndef TESTS_COMMON_UNIT_H
#define TESTS_COMMON_UNIT_H
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

typedef struct {
  uint64_t state;
} unit_rng_t;

static inline uint64_t unit_bits(unit_rng_t* rng) {
  rng->state ^= rng->state >> 12;
  rng->state ^= rng->state << 25;
  rng->state ^= rng->state >> 27;
  return rng->state * 0x2545F4914F6CDD1DULL;
}
static inline double unit_uniform(unit_rng_t* rng) {
  return (double)(unit_bits(rng) >> 11) * 0x1p-53;
}
static inline double unit_between(unit_rng_t* rng, double lo, double hi) {
  return lo + (hi - lo) * unit_uniform(rng);
}
static inline int64_t unit_integer(unit_rng_t* rng, int64_t lo, int64_t hi) {
  return lo + (int64_t)(unit_bits(rng) % (uint64_t)(hi - lo + 1));
}
static inline double unit_normal(unit_rng_t* rng) {
  return sqrt(-2 * log(1 - unit_uniform(rng))) * cos(6.283185307179586 * unit_uniform(rng));
}
/* SEED=n in the environment; printed by tests that fail at random input. */
static inline uint64_t unit_seed(void) {
  const char* text = getenv("SEED");
  return text ? strtoull(text, NULL, 10) * 0x9E3779B97F4A7C15ULL + 1 : 0x9E3779B97F4A7C15ULL;
}
/* How often to repeat: IMUCAL_QUICK=1 in the environment (tests/mutate) asks for a twentieth. */
static inline int unit_repeats(int n) {
  return getenv("IMUCAL_QUICK") ? (n + 19) / 20 : n;
}
#endif
