// SPDX-License-Identifier: MIT
/* Purpose: keep two tables in flash so that a power cut at any moment leaves the old or the new one ruling.
 * Data: bytes of a valid table in (table.h); at boot the newest valid one out, and why others were refused.
 * Memory: no state of its own; the caller gives work memory.  Thread: one context.
 *
 * Slot:  [table bytes .. erased ..][commit word][revoke word]   (last 8 bytes of the slot)
 *  - write: invalidate the loser (commit word and magic to 0), erase it, program the table, read back, then program the
 *    commit word.  The ruling slot is not touched.
 *  - rollback: program the ruling slot's revoke word to 0; the other slot rules.
 *  - A commit word that is not exact is no commit.  A revoke word that is not erased revokes.
 * NOR rules assumed: erase sets all bits of the slot, program only clears bits, a word may be programmed a second
 * time to 0 (nRF51: two writes per word and erase; so used).  One 4-byte word is the largest unit needed to be
 * programmed at once; a cut inside a word is covered. */
#ifndef IMUCAL_STORE_H
#define IMUCAL_STORE_H

#include "status.h"
#include "table.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_STORE_SLOTS 2
#define IMUCAL_STORE_COMMIT 0x3AC5965Au
#define IMUCAL_STORE_MIN_SLOT_BYTES (IMUCAL_TABLE_MAX_BYTES + 8)

/* The flash, as the port offers it.  slot: 0 or 1; offset and len are multiples of 4; data is aligned to 4.
 * Each returns IMUCAL_OK or IMUCAL_ERR_FLASH. */
typedef struct imucal_flash {
  imucal_status (*erase)(void* ctx, uint32_t slot);
  imucal_status (*program)(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len);
  imucal_status (*read)(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len);
  void* ctx;
  uint32_t slot_bytes; /* multiple of 4, >= IMUCAL_STORE_MIN_SLOT_BYTES */
} imucal_flash_t;

/* What is in the slots. */
typedef struct imucal_store_report {
  imucal_status slot_status[IMUCAL_STORE_SLOTS]; /* IMUCAL_OK: valid; else why not */
  uint32_t sequence[IMUCAL_STORE_SLOTS];         /* as written there when the bytes are intact; else 0 */
  int8_t ruling;                                 /* 0, 1, or -1: none */
} imucal_store_report_t;

/* Work memory: aligned to 4 by its type. */
typedef struct imucal_store_work {
  uint32_t words[IMUCAL_TABLE_MAX_BYTES / 4];
} imucal_store_work_t;

/* Find the ruling table for the device `serial` (IMUCAL_SERIAL_LEN characters, 0-padded; null: any) with n_channels
 * (0: any).  IMUCAL_OK: *table is it; IMUCAL_ERR_NO_TABLE: none, see report.  report may not be null. */
IMUCAL_MUST_USE imucal_status imucal_store_load(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                                imucal_store_work_t* work, imucal_table_t* table,
                                                imucal_store_report_t* report);

/* Write `table` into the loser with the next sequence number (set in *table) and commit.  On IMUCAL_OK it rules and
 * the report says so.  Any error: the old table still rules (IMUCAL_ERR_SERIAL, IMUCAL_ERR_CHANNELS: table of another
 * device, flash untouched; status of table_validate: flash untouched; IMUCAL_ERR_FLASH, IMUCAL_ERR_VERIFY).
 * work must not overlap table. */
IMUCAL_MUST_USE imucal_status imucal_store_write(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                                 imucal_store_work_t* work, imucal_table_t* table,
                                                 imucal_store_report_t* report);

/* Revoke the ruling table; the other valid one rules (loaded into *table).  IMUCAL_ERR_NO_OTHER: nothing to go back
 * to, nothing changed; IMUCAL_ERR_NO_TABLE. */
IMUCAL_MUST_USE imucal_status imucal_store_rollback(const imucal_flash_t* flash, const char* serial,
                                                    uint32_t n_channels, imucal_store_work_t* work,
                                                    imucal_table_t* table, imucal_store_report_t* report);

/* Erase both slots, the ruling one last. */
IMUCAL_MUST_USE imucal_status imucal_store_erase(const imucal_flash_t* flash, imucal_store_work_t* work,
                                                 imucal_store_report_t* report);

#if defined(__cplusplus)
}
#endif
#endif
