// SPDX-License-Identifier: MIT
#include "nor.h"

#include <string.h>

#define CHUNK_BYTES 64u

void nor_power_on(nor_t* nor) {
  nor->n_operations = 0;
  nor->has_power = true;
}

static bool is_outside(const nor_t* nor, uint32_t offset_bytes, size_t length) {
  return offset_bytes > nor->size_bytes || length > nor->size_bytes - offset_bytes;
}

/* True where this operation loses the power somewhere inside: then `*length` is what is still done. */
static bool is_cut_here(nor_t* nor, size_t* length) {
  if (nor->n_operations++ != nor->cut_operation || nor->cut_byte > *length) return false;
  *length = nor->cut_byte;
  return true;
}

static nor_result_t cut(nor_t* nor) {
  nor->has_power = false;
  if (nor->power_off) nor->power_off(nor->ctx);
  return NOR_ERR_NO_POWER;
}

nor_result_t nor_read(nor_t* nor, uint32_t offset_bytes, uint8_t* data, size_t length) {
  if (!nor->has_power) return NOR_ERR_NO_POWER;
  if (is_outside(nor, offset_bytes, length)) return NOR_ERR_BOUNDS;
  return nor->load(nor->ctx, offset_bytes, data, length) ? NOR_OK : NOR_ERR_BACKING;
}

/* The bytes at the cut: bits half way to their new value. */
static bool save_torn_byte(nor_t* nor, uint32_t offset_bytes, uint8_t target) {
  uint8_t old;
  if (offset_bytes >= nor->size_bytes || !nor->load(nor->ctx, offset_bytes, &old, 1)) return false;
  const uint8_t torn = (uint8_t)((old & 0x55u) | (target & 0xAAu));
  return nor->save(nor->ctx, offset_bytes, &torn, 1);
}

nor_result_t nor_erase(nor_t* nor, uint32_t offset_bytes, size_t length) {
  if (!nor->has_power) return NOR_ERR_NO_POWER;
  if (is_outside(nor, offset_bytes, length)) return NOR_ERR_BOUNDS;
  if (offset_bytes % nor->page_bytes || length % nor->page_bytes) return NOR_ERR_ALIGNMENT;
  const size_t wanted = length;
  const bool is_cut = is_cut_here(nor, &length);
  uint8_t ones[CHUNK_BYTES];
  memset(ones, 0xFF, sizeof ones);
  for (size_t done = 0; done < length; done += CHUNK_BYTES) {
    const size_t n = length - done < CHUNK_BYTES ? length - done : CHUNK_BYTES;
    if (!nor->save(nor->ctx, offset_bytes + (uint32_t)done, ones, n)) return NOR_ERR_BACKING;
  }
  if (!is_cut) return NOR_OK;
  if (length < wanted) (void)save_torn_byte(nor, offset_bytes + (uint32_t)length, 0xFF);
  return cut(nor);
}

/* Every byte to program is erased. */
static nor_result_t check_erased(nor_t* nor, uint32_t offset_bytes, size_t length) {
  uint8_t old[CHUNK_BYTES];
  for (size_t done = 0; done < length; done += CHUNK_BYTES) {
    const size_t n = length - done < CHUNK_BYTES ? length - done : CHUNK_BYTES;
    if (!nor->load(nor->ctx, offset_bytes + (uint32_t)done, old, n)) return NOR_ERR_BACKING;
    for (size_t i = 0; i < n; i++)
      if (old[i] != 0xFF) return NOR_ERR_NOT_ERASED;
  }
  return NOR_OK;
}

nor_result_t nor_program(nor_t* nor, uint32_t offset_bytes, const uint8_t* data, size_t length) {
  if (!nor->has_power) return NOR_ERR_NO_POWER;
  if (is_outside(nor, offset_bytes, length)) return NOR_ERR_BOUNDS;
  if (offset_bytes % nor->word_bytes || length % nor->word_bytes) return NOR_ERR_ALIGNMENT;
  const nor_result_t erased = check_erased(nor, offset_bytes, length);
  if (erased != NOR_OK) return erased;
  const size_t wanted = length;
  const bool is_cut = is_cut_here(nor, &length);
  for (size_t done = 0; done < length; done += nor->word_bytes) {
    const size_t n = length - done < nor->word_bytes ? length - done : nor->word_bytes;
    if (!nor->save(nor->ctx, offset_bytes + (uint32_t)done, data + done, n)) return NOR_ERR_BACKING;
  }
  if (!is_cut) return NOR_OK;
  if (length < wanted) (void)save_torn_byte(nor, offset_bytes + (uint32_t)length, data[length]);
  return cut(nor);
}
