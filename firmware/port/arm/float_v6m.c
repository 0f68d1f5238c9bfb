/* SPDX-License-Identifier: MIT */
/* What the compiler calls for + - * / of floats on a Cortex-M0 (run-time ABI for Arm: a float is passed as its bits), put
 * before libgcc's by the linker (-Wl,--wrap). */
#include "port/arm/float_v6m.h"

uint32_t __real___aeabi_fmul(uint32_t a, uint32_t b);
uint32_t __real___aeabi_fadd(uint32_t a, uint32_t b);
uint32_t __real___aeabi_fsub(uint32_t a, uint32_t b);
uint32_t __real___aeabi_fdiv(uint32_t a, uint32_t b);
uint32_t __wrap___aeabi_fmul(uint32_t a, uint32_t b);
uint32_t __wrap___aeabi_fadd(uint32_t a, uint32_t b);
uint32_t __wrap___aeabi_fsub(uint32_t a, uint32_t b);
uint32_t __wrap___aeabi_fdiv(uint32_t a, uint32_t b);

uint32_t __wrap___aeabi_fmul(uint32_t a, uint32_t b) {
  uint32_t out;
  return float_mul(a, b, &out) ? out : __real___aeabi_fmul(a, b);
}
uint32_t __wrap___aeabi_fadd(uint32_t a, uint32_t b) {
  uint32_t out;
  return float_add(a, b, &out) ? out : __real___aeabi_fadd(a, b);
}
uint32_t __wrap___aeabi_fsub(uint32_t a, uint32_t b) {
  uint32_t out;
  return float_add(a, b ^ FLOAT_SIGN, &out) ? out : __real___aeabi_fsub(a, b);
}
uint32_t __wrap___aeabi_fdiv(uint32_t a, uint32_t b) {
  uint32_t out;
  return float_div(a, b, &out) ? out : __real___aeabi_fdiv(a, b);
}
