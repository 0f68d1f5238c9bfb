// SPDX-License-Identifier: MIT
/* Purpose: the NOR flash of emulated devices, flat, its bytes kept where the caller says; what a cut left reads alike for
 * ever (cells that waver after one: tests/emu/torn_nor.h).  Stricter than a chip: erase sets whole pages to ones,
 * programming only clears bits, is aligned to words and refuses a word that is not erased; the power can be cut at any
 * operation and at any byte inside it.
 * Data: the bytes live where `load` and `save` say (memory, a file of the emulator's host); every word programmed
 * and every part of a page erased is saved at once, so that killing the process is a power cut too.
 * Memory: this struct.  Time: linear in the bytes touched. */
#ifndef IMUCAL_PORT_SIM_NOR_H
#define IMUCAL_PORT_SIM_NOR_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define NOR_NEVER 0xFFFFFFFFu

typedef enum {
  NOR_OK = 0,
  NOR_ERR_BOUNDS = -1,     /* outside the flash */
  NOR_ERR_ALIGNMENT = -2,  /* erase not on pages, or program not on words */
  NOR_ERR_NOT_ERASED = -3, /* a word to program is not all ones */
  NOR_ERR_BACKING = -4,    /* load or save failed */
  NOR_ERR_NO_POWER = -5    /* after a cut, where power_off returns (unit tests) */
} nor_result_t;

typedef struct {
  void* ctx;
  bool (*load)(void* ctx, uint32_t offset_bytes, uint8_t* data, size_t length);
  bool (*save)(void* ctx, uint32_t offset_bytes, const uint8_t* data, size_t length);
  void (*power_off)(void* ctx); /* at the cut; need not return; may be NULL */
  uint32_t size_bytes;
  uint32_t page_bytes;
  uint32_t word_bytes; /* 1 to 32: smallest unit of programming */

  uint32_t cut_operation; /* the power fails in this erase or program (0 is the first), NOR_NEVER: not at all */
  uint32_t cut_byte;      /* after this many bytes of it; the torn word keeps half its bits */

  uint32_t n_operations; /* erases and programs begun since start */
  bool has_power;
} nor_t;

/* Sets counters and power; the other fields stay as the caller filled them. */
void nor_power_on(nor_t* nor);

nor_result_t nor_read(nor_t* nor, uint32_t offset_bytes, uint8_t* data, size_t length);
nor_result_t nor_erase(nor_t* nor, uint32_t offset_bytes, size_t length);
nor_result_t nor_program(nor_t* nor, uint32_t offset_bytes, const uint8_t* data, size_t length);
#endif
