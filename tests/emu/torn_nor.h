// SPDX-License-Identifier: MIT
// A NOR flash for the store, with cells that a power cut leaves torn: two slots in memory behind imucal_flash_t.  (The flash of
// emulated devices, firmware/port/sim/nor.h, is flat, keeps its bytes in a file, and what a cut left there reads alike for ever.)
// Stricter than a chip: alignment, bounds, program only of erased units and only once between erases (as units with ECC
// have it), wear counted.  Power can be cut inside any unit of a program and inside the erase of any page.  What the cut
// caught is torn: some of its bits took the new value, some kept the old one, some read differently from read to read or
// from start to start; or the unit cannot be read at all (ECC).  After the cut every call fails until torn_nor_power_on.
#ifndef TESTS_EMU_TORN_NOR_H
#define TESTS_EMU_TORN_NOR_H
#include <stdint.h>
#include <string.h>

#include "store.h"

#define TORN_NOR_MAX_SLOT_BYTES 4096u

typedef struct {
  uint32_t slot_bytes, page_bytes, unit_bytes;
} torn_nor_geometry_t;

// What torn cells do.
enum { TORN_NOR_STABLE, TORN_NOR_PER_READ, TORN_NOR_PER_BOOT, TORN_NOR_UNREADABLE, TORN_NOR_MODES };
// How much of the unit or page the cut lets happen; from TORN_NOR_MIXED on at random.
enum {
  TORN_NOR_NOTHING_TOOK,
  TORN_NOR_ALL_TOOK,
  TORN_NOR_ALL_WAVER,
  TORN_NOR_FRONT_TOOK,
  TORN_NOR_FEW_WAVER,
  TORN_NOR_MIXED,
  TORN_NOR_PATTERNS
};
enum { TORN_NOR_NEVER = -1 };
// Silent failures: the driver reports success.
enum { TORN_NOR_DOES_NOTHING, TORN_NOR_DOES_HALF, TORN_NOR_REPORTS_FAILURE };

typedef struct {
  torn_nor_geometry_t geometry;
  uint8_t bytes[2][TORN_NOR_MAX_SLOT_BYTES];                                        // of a wavering bit: nothing
  uint8_t wavers[2][TORN_NOR_MAX_SLOT_BYTES];                                       // bits torn
  uint8_t is_torn[2][TORN_NOR_MAX_SLOT_BYTES], is_used[2][TORN_NOR_MAX_SLOT_BYTES]; // per unit, at its first byte
  uint32_t n_erase[2];
  int mode, pattern;
  long steps_left, steps_used; // units programmed and pages erased until the cut; TORN_NOR_NEVER
  int is_off;
  uint32_t boot;
  uint64_t random;
  int fail_at_call, fail_how, n_calls; // erase, program and, with TORN_NOR_REPORTS_FAILURE, read calls; 0: none fails
  uint32_t n_reads, n_programs, n_erases; // calls since power on
  int n_violations;
  const char* violation;
} torn_nor_t;

static inline uint64_t torn_nor_mix(uint64_t x) {
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}
static inline uint64_t torn_nor_random(torn_nor_t* nor) {
  return torn_nor_mix(nor->random += 0x9E3779B97F4A7C15ULL);
}

static inline void torn_nor_init(torn_nor_t* nor, torn_nor_geometry_t geometry) {
  memset(nor, 0, sizeof *nor);
  memset(nor->bytes, 0xFF, sizeof nor->bytes);
  nor->geometry = geometry;
  nor->steps_left = TORN_NOR_NEVER;
}
static inline void torn_nor_power_on(torn_nor_t* nor) {
  nor->is_off = 0;
  nor->steps_left = TORN_NOR_NEVER;
  nor->steps_used = 0;
  nor->boot++;
  nor->n_reads = nor->n_programs = nor->n_erases = 0;
}
static inline void torn_nor_violate(torn_nor_t* nor, const char* what) {
  nor->n_violations++;
  nor->violation = what;
}
// One unit or page of work; 0: the power goes inside it.
static inline int torn_nor_step(torn_nor_t* nor) {
  nor->steps_used++;
  if (nor->steps_left == TORN_NOR_NEVER) return 1;
  if (nor->steps_left-- > 0) return 1;
  nor->is_off = 1;
  return 0;
}
// Is this call the one that fails?
static inline int torn_nor_fails(torn_nor_t* nor, int is_read) {
  if (is_read && nor->fail_how != TORN_NOR_REPORTS_FAILURE) return 0;
  return nor->fail_at_call != 0 && ++nor->n_calls == nor->fail_at_call;
}

static inline uint8_t torn_nor_get(torn_nor_t* nor, uint32_t slot, uint32_t at) {
  const uint8_t wavers = nor->wavers[slot][at];
  if (wavers == 0) return nor->bytes[slot][at];
  const uint64_t noise =
      nor->mode == TORN_NOR_PER_READ ? torn_nor_random(nor) : torn_nor_mix((uint64_t)nor->boot << 32 ^ slot << 16 ^ at);
  return (uint8_t)((nor->bytes[slot][at] & ~wavers) | ((noise >> 20) & wavers));
}

// A byte on its way from old to new when the power goes: bits that differ took, stay or waver.
static inline void torn_nor_tear_byte(torn_nor_t* nor, uint32_t slot, uint32_t at, uint8_t to, uint32_t place,
                                      uint32_t n) {
  const uint8_t old = nor->bytes[slot][at];
  const uint8_t moving = (uint8_t)((old ^ to) | nor->wavers[slot][at]);
  const uint8_t random = (uint8_t)torn_nor_random(nor), wavering = (uint8_t)torn_nor_random(nor),
                rare = (uint8_t)(wavering & torn_nor_random(nor) & torn_nor_random(nor));
  uint8_t took = 0, wavers = 0;
  switch (nor->pattern) {
  case TORN_NOR_NOTHING_TOOK:
    break;
  case TORN_NOR_ALL_TOOK:
    took = moving;
    break;
  case TORN_NOR_ALL_WAVER:
    wavers = moving;
    break;
  case TORN_NOR_FRONT_TOOK:
    took = place < n / 2 ? moving : 0;
    break;
  case TORN_NOR_FEW_WAVER:
    took = moving & random, wavers = moving & rare;
    break;
  default:
    took = moving & random, wavers = moving & wavering;
    break;
  }
  if (nor->mode == TORN_NOR_STABLE || nor->mode == TORN_NOR_UNREADABLE)
    took = (uint8_t)(took | (wavers & random)), wavers = 0;
  nor->bytes[slot][at] = (uint8_t)((old & ~took) | (to & took));
  nor->wavers[slot][at] = wavers;
}
static inline void torn_nor_tear(torn_nor_t* nor, uint32_t slot, uint32_t from, const uint8_t* to, uint32_t n) {
  for (uint32_t i = 0; i < n; i++) torn_nor_tear_byte(nor, slot, from + i, to ? to[i] : 0xFF, i, n);
  for (uint32_t i = 0; i < n; i += nor->geometry.unit_bytes) nor->is_torn[slot][from + i] = 1;
}

static inline imucal_status torn_nor_erase(void* ctx, uint32_t slot) {
  torn_nor_t* nor = (torn_nor_t*)ctx;
  if (nor->is_off) return IMUCAL_ERR_FLASH;
  nor->n_erases++;
  const int fails = torn_nor_fails(nor, 0);
  if (fails && nor->fail_how == TORN_NOR_REPORTS_FAILURE) return IMUCAL_ERR_FLASH;
  if (fails && nor->fail_how == TORN_NOR_DOES_NOTHING) return IMUCAL_OK;
  nor->n_erase[slot]++;
  const uint32_t end = fails ? nor->geometry.slot_bytes / 2 : nor->geometry.slot_bytes; // silently only half of it
  for (uint32_t page = 0; page < end; page += nor->geometry.page_bytes) {
    const uint32_t n = page + nor->geometry.page_bytes < end ? nor->geometry.page_bytes : end - page;
    if (!torn_nor_step(nor)) {
      torn_nor_tear(nor, slot, page, NULL, n);
      return IMUCAL_ERR_FLASH;
    }
    memset(nor->bytes[slot] + page, 0xFF, n);
    memset(nor->wavers[slot] + page, 0, n);
    memset(nor->is_torn[slot] + page, 0, n);
    memset(nor->is_used[slot] + page, 0, n);
  }
  return IMUCAL_OK;
}

// Does every read of the unit show that it is not erased?  A caller who programs it did not look.
static inline int torn_nor_is_surely_begun(const torn_nor_t* nor, uint32_t slot, uint32_t at) {
  if (nor->mode == TORN_NOR_UNREADABLE && nor->is_torn[slot][at]) return 1;
  for (uint32_t i = 0; i < nor->geometry.unit_bytes; i++)
    if ((nor->bytes[slot][at + i] | nor->wavers[slot][at + i]) != 0xFF) return 1;
  return 0;
}

// As the controller of a chip with ECC: a unit that does not read erased is refused.
static inline imucal_status torn_nor_program_unit(torn_nor_t* nor, uint32_t slot, uint32_t at, const uint8_t* data) {
  const uint32_t n = nor->geometry.unit_bytes;
  const int is_begun = torn_nor_is_surely_begun(nor, slot, at);
  int is_erased = !is_begun;
  for (uint32_t i = 0; i < n; i++) is_erased = is_erased && torn_nor_get(nor, slot, at + i) == 0xFF;
  if (is_begun) torn_nor_violate(nor, "program of a unit that is not erased");
  if (nor->is_used[slot][at] && !nor->is_torn[slot][at]) torn_nor_violate(nor, "unit programmed twice");
  if (!is_erased) return IMUCAL_ERR_FLASH;
  nor->is_used[slot][at] = 1;
  if (!torn_nor_step(nor)) {
    torn_nor_tear(nor, slot, at, data, n);
    return IMUCAL_ERR_FLASH;
  }
  int wavers = 0;
  for (uint32_t i = 0; i < n; i++) {
    nor->bytes[slot][at + i] &= data[i];
    nor->wavers[slot][at + i] &= data[i]; // a wavering bit programmed to 0 is 0; one that should be 1 goes on wavering
    wavers |= nor->wavers[slot][at + i];
  }
  nor->is_torn[slot][at] = wavers != 0;
  return IMUCAL_OK;
}

static inline imucal_status torn_nor_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data,
                                             uint32_t len) {
  torn_nor_t* nor = (torn_nor_t*)ctx;
  const uint32_t unit = nor->geometry.unit_bytes;
  if (nor->is_off) return IMUCAL_ERR_FLASH;
  nor->n_programs++;
  if (slot > 1 || offset % unit || len % unit || len == 0 || offset + len > nor->geometry.slot_bytes)
    torn_nor_violate(nor, "program bounds");
  if ((uintptr_t)data % 4) torn_nor_violate(nor, "data not aligned");
  const int fails = torn_nor_fails(nor, 0);
  if (fails && nor->fail_how == TORN_NOR_REPORTS_FAILURE) return IMUCAL_ERR_FLASH;
  if (fails && nor->fail_how == TORN_NOR_DOES_NOTHING) return IMUCAL_OK;
  const uint32_t n = fails ? len / 2 / unit * unit : len;
  for (uint32_t i = 0; i < n; i += unit) {
    const imucal_status status = torn_nor_program_unit(nor, slot, offset + i, data + i);
    if (status != IMUCAL_OK) return status;
  }
  return IMUCAL_OK;
}

static inline imucal_status torn_nor_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  torn_nor_t* nor = (torn_nor_t*)ctx;
  if (nor->is_off) return IMUCAL_ERR_FLASH;
  nor->n_reads++;
  if (torn_nor_fails(nor, 1)) return IMUCAL_ERR_FLASH;
  if (slot > 1 || offset % 4 || len % 4 || offset + len > nor->geometry.slot_bytes)
    torn_nor_violate(nor, "read bounds");
  const uint32_t unit = nor->geometry.unit_bytes;
  for (uint32_t at = offset / unit * unit; nor->mode == TORN_NOR_UNREADABLE && at < offset + len; at += unit)
    if (nor->is_torn[slot][at]) return IMUCAL_ERR_FLASH;
  for (uint32_t i = 0; i < len; i++) data[i] = torn_nor_get(nor, slot, offset + i);
  return IMUCAL_OK;
}

static inline imucal_flash_t torn_nor_flash(torn_nor_t* nor) {
  return (imucal_flash_t){torn_nor_erase,           torn_nor_program,         torn_nor_read,           nor,
                          nor->geometry.slot_bytes, nor->geometry.page_bytes, nor->geometry.unit_bytes};
}
#endif
