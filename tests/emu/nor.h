// SPDX-License-Identifier: MIT
// A NOR flash in memory, stricter than a chip: alignment, bounds, program only clears bits, at most two programs of a
// word between erases (nRF51), wear counted.  Power can be cut inside any operation, at any byte of it: an erase has
// then reached only part of the slot (from the front, the back, or scattered), a program stops after some bytes, the
// last of them with only some of its bits cleared.  After the cut every call fails until nor_power_on.
#ifndef TESTS_EMU_NOR_H
#define TESTS_EMU_NOR_H
#include <stdint.h>
#include <string.h>

#include "store.h"

#define NOR_SLOT_BYTES 1024u

typedef struct {
  uint8_t bytes[2][NOR_SLOT_BYTES];
  uint8_t writes[2][NOR_SLOT_BYTES / 4];
  uint32_t n_erase[2];
  int n_violations;      /* of the rules above: a test demands 0 */
  const char* violation; /* the last one */
  long steps_left;       /* bytes of erase or program until the power goes; < 0: never */
  long steps_used;
  int is_off;
  int order;             /* 0 front to back, 1 back to front, 2 scattered */
  uint8_t torn_bits;     /* of the byte being programmed at the cut, those not yet cleared */
  int fail_at_call, n_calls; /* the driver reports failure at this call (1 ..); 0: never */
} nor_t;

static inline void nor_init(nor_t* nor) {
  memset(nor, 0, sizeof *nor);
  memset(nor->bytes, 0xFF, sizeof nor->bytes);
  nor->steps_left = -1;
}
static inline void nor_power_on(nor_t* nor) {
  nor->is_off = 0;
  nor->steps_left = -1;
  nor->steps_used = 0;
}
static inline void nor_violate(nor_t* nor, const char* what) {
  nor->n_violations++;
  nor->violation = what;
}
/* One byte of work; 0: the power is gone. */
static inline int nor_step(nor_t* nor) {
  nor->steps_used++;
  if (nor->steps_left < 0) return 1;
  if (nor->steps_left == 0) {
    nor->is_off = 1;
    return 0;
  }
  nor->steps_left--;
  return 1;
}
static inline int nor_fails(nor_t* nor) { return nor->is_off || ++nor->n_calls == nor->fail_at_call; }

static inline imucal_status nor_erase(void* ctx, uint32_t slot) {
  nor_t* nor = (nor_t*)ctx;
  if (nor_fails(nor)) return IMUCAL_ERR_FLASH;
  nor->n_erase[slot]++;
  for (uint32_t i = 0; i < NOR_SLOT_BYTES; i++) {
    uint32_t at = nor->order == 0 ? i : nor->order == 1 ? NOR_SLOT_BYTES - 1 - i : (i * 389u + 7u) % NOR_SLOT_BYTES;
    if (!nor_step(nor)) {
      nor->bytes[slot][at] |= nor->torn_bits; /* half erased */
      return IMUCAL_ERR_FLASH;
    }
    nor->bytes[slot][at] = 0xFF;
  }
  memset(nor->writes[slot], 0, sizeof nor->writes[slot]);
  return IMUCAL_OK;
}

static inline imucal_status nor_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  nor_t* nor = (nor_t*)ctx;
  if (nor_fails(nor)) return IMUCAL_ERR_FLASH;
  if (slot > 1 || offset % 4 || len % 4 || len == 0 || offset + len > NOR_SLOT_BYTES) nor_violate(nor, "bounds");
  if ((uintptr_t)data % 4) nor_violate(nor, "data not aligned");
  for (uint32_t i = 0; i < len; i++) {
    uint8_t* cell = &nor->bytes[slot][offset + i];
    if (data[i] & (uint8_t)~*cell) nor_violate(nor, "program sets a bit");
    int has_power = nor_step(nor);
    uint8_t to = has_power ? data[i] : (uint8_t)(data[i] | nor->torn_bits);
    int is_counted = has_power ? i % 4 == 0 : i % 4 == 0 && (*cell & to) != *cell;
    if (is_counted && ++nor->writes[slot][(offset + i) / 4] > 2) nor_violate(nor, "word written three times");
    if (!has_power) {
      *cell &= to;
      return IMUCAL_ERR_FLASH;
    }
    *cell &= data[i];
  }
  return IMUCAL_OK;
}

static inline imucal_status nor_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  nor_t* nor = (nor_t*)ctx;
  if (nor_fails(nor)) return IMUCAL_ERR_FLASH;
  if (slot > 1 || offset % 4 || len % 4 || offset + len > NOR_SLOT_BYTES) nor_violate(nor, "read bounds");
  memcpy(data, nor->bytes[slot] + offset, len);
  return IMUCAL_OK;
}

static inline imucal_flash_t nor_flash(nor_t* nor) {
  return (imucal_flash_t){nor_erase, nor_program, nor_read, nor, NOR_SLOT_BYTES};
}
#endif
