// SPDX-License-Identifier: MIT
/* Purpose: small arithmetic that must give the same bits on every machine, and little-endian bytes by shifts.
 * No libm.  Float is IEEE 754 binary32, round to nearest even; host, M4F (hardware) and M0 (libgcc) agree.
 * Compile the core without -ffast-math (refused below) and without contraction of a * b + c into one operation, which no macro
 * tells: -ffp-contract=off.  GCC contracts by default with -std=gnu.. where the processor can, on a Cortex-M4F too. */
#ifndef IMUCAL_NUM_H
#define IMUCAL_NUM_H

#include "status.h"

#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__)
#error "the core gives other results with -ffast-math: compile common/ with -fno-fast-math -ffp-contract=off"
#endif

#if defined(__cplusplus)
extern "C" {
#endif

/* Bit pattern of a float and back (no aliasing tricks: through a union, defined in C99). */
static inline uint32_t imucal_bits_from_float(float value) {
  union {
    float f;
    uint32_t u;
  } pun;
  pun.f = value;
  return pun.u;
}
static inline float imucal_float_from_bits(uint32_t bits) {
  union {
    float f;
    uint32_t u;
  } pun;
  pun.u = bits;
  return pun.f;
}

/* True for every number, false for NaN and the infinities; by bits, so that no compiler flag can change it. */
static inline bool imucal_is_finite(float value) {
  return (imucal_bits_from_float(value) & 0x7F800000u) != 0x7F800000u;
}
/* True when value is finite and inside [lo, hi]. */
bool imucal_is_within(float value, float lo, float hi);

/* Square root, correctly rounded (nearest even), by integers only.  Negative or not finite input gives 0. */
float imucal_sqrtf(float value);

/* numerator / denominator rounded to the nearest integer, ties to even.
 * Pre: 1 <= denominator <= 2^61, |numerator| < 2^62.  No overflow: the result is no larger than the numerator. */
int64_t imucal_divide_rne(int64_t numerator, int64_t denominator);

/* Little-endian fields. */
static inline void imucal_put_u16(uint8_t* at, uint32_t value) {
  at[0] = (uint8_t)value;
  at[1] = (uint8_t)(value >> 8);
}
static inline void imucal_put_u32(uint8_t* at, uint32_t value) {
  imucal_put_u16(at, value);
  imucal_put_u16(at + 2, value >> 16);
}
static inline void imucal_put_u64(uint8_t* at, uint64_t value) {
  imucal_put_u32(at, (uint32_t)value);
  imucal_put_u32(at + 4, (uint32_t)(value >> 32));
}
static inline void imucal_put_f32(uint8_t* at, float value) {
  imucal_put_u32(at, imucal_bits_from_float(value));
}
static inline uint16_t imucal_get_u16(const uint8_t* at) {
  return (uint16_t)((uint32_t)at[0] | ((uint32_t)at[1] << 8));
}
static inline uint32_t imucal_get_u32(const uint8_t* at) {
  return (uint32_t)at[0] | ((uint32_t)at[1] << 8) | ((uint32_t)at[2] << 16) | ((uint32_t)at[3] << 24);
}
static inline uint64_t imucal_get_u64(const uint8_t* at) {
  return (uint64_t)imucal_get_u32(at) | ((uint64_t)imucal_get_u32(at + 4) << 32);
}
static inline float imucal_get_f32(const uint8_t* at) {
  return imucal_float_from_bits(imucal_get_u32(at));
}

#if defined(__cplusplus)
}
#endif
#endif
