// SPDX-License-Identifier: MIT
/* Purpose: keep two tables in flash so that a power cut at any moment leaves the old or the new one ruling, also where
 * the cells that the cut caught read differently from read to read or from start to start.
 * Data: bytes of a valid table in (table.h); at boot the newest valid one out, and why others were refused.
 * Memory: no state of its own; the caller gives work memory.  Thread: one context.
 *
 * Slot:  [table | origin .. erased .. endorse n-1 .. endorse 0 | revoke | commit m-1 .. commit 1 | commit 0]
 * m = 8, n = 8, or m = 3 and n = 1..12 in a slot without room for that many.  A mark has program units of its own:
 * max(8, program_bytes) bytes, of which the first 8 count: u32 0x3AC5965A, u32 NOT sequence number.
 * A unit is programmed once between two erases, so units with ECC that may be written once will do.
 *  - write: give the ruling slot one more commit mark, which notes the newest sequence number; erase the other slot and
 *    check that it is erased; program the table, read it back; program commit 0, read it back.
 *  - rollback: program an endorse mark in the older slot, read it back; then the revoke mark in the ruling one.
 *  - A slot is valid with any commit mark exact and a table that passes every check.  Of two valid slots the one with
 *    the higher sequence number rules, unless it is revoked: by its own revoke mark, or in the older slot by the endorse
 *    mark of this pair (which one: difference of the sequence numbers - 1).  Four bits of such a mark revoke.
 *
 * Why a cut at any unit leaves old or new.  A unit or page is "whole" when its last program or erase was not cut; whole
 * cells read the same for ever.  "Ruling slot" R, other slot O.
 *  (1) Table: commit 0 is begun only after the table, and the note of its origin in the same program, were read back with
 *      the power on: a slot that shows any sign of a commit mark has a whole table.  A cut in the table's units leaves all
 *      commit marks erased: not valid.
 *  (2) Cut in commit 0 of the new slot: it is valid or not, from read to read.  The old slot is whole: old or new.
 *  (3) O is erased only after R got a commit mark that was programmed and read back since this start, or where all m
 *      commit marks of R are begun.  So R has a whole table and a whole commit mark while O is in pieces, unless m cuts
 *      caught the m marks of R.  R is valid at every read; it rules because
 *      - what may come back out of a half-erased O is O as it was (or bytes whose CRC is wrong): an older table, whose
 *        sequence number is lower; or
 *      - O was rolled back: the endorse mark that outranks it is in R, where the erase of O cannot reach it.
 *        (A revoke mark alone could be erased first, and a table rolled back would return.)
 *      The next table must not get the number that an endorse mark in R stands for, though O can no longer be read:
 *      R's marks note it; with no commit mark left the number is chosen beyond all endorse marks.
 *  (4) Cut in a commit mark added to R: R is as valid as before, O untouched.  Next time another mark is taken; a mark that
 *      was caught and reads erased is programmed again, to the same value: whole then.
 *  (5) Cut in endorse: either table rules, both are whole, the rollback was not reported as done.  Where the newer one
 *      rules, the mark may be begun with fewer than the four bits that revoke: it is not programmed again, and a rollback
 *      of this pair is refused (IMUCAL_ERR_NO_MARK) until the next write.  Revoke is begun only when endorse was read
 *      back: it says the same and stays when the older table rots.
 *  (6) Nothing rules: both slots are erased before the write, so that nothing half erased comes back over the new
 *      table later.
 *  (7) Erase: a commit mark for R, then O, then R; a cut leaves R or nothing, as asked for.
 * So cuts never matter, however often they come, unless m (3 or 8) of them hit the m commit marks of one slot.
 * `make torn` cuts every unit of every state to depth two and samples depth three.
 *
 * Bits that flip at rest: a table that fails its CRC is refused, the other slot rules; a slot that has been written
 * after has two commit marks.
 * Silent failures of the driver: erase, table and marks are read back before the next step.
 * (3) rests on an erase that touches its slot alone.  Where one takes both, as with a page larger than declared, R is gone
 * with it: the ruling table is read again after the erase, the new one is written all the same, and the write is told as
 * failed (IMUCAL_ERR_SLOTS).  Slots that share addresses are found by the first write. */
#ifndef IMUCAL_STORE_H
#define IMUCAL_STORE_H

#include "status.h"
#include "table.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_STORE_SLOTS 2
#define IMUCAL_STORE_COMMIT 0x3AC5965Au
#define IMUCAL_STORE_MIN_COMMITS 3u           /* commit marks of a small slot */
#define IMUCAL_STORE_MAX_COMMITS 8u           /* and of one with room for IMUCAL_STORE_MAX_MARKS */
#define IMUCAL_STORE_MAX_MARKS 17u            /* 8 commit, 1 revoke, 8 endorse */
#define IMUCAL_STORE_MAX_SEQUENCE 0xFFFFFF00u /* no further writes: room for the steps of a write */
/* Longest program unit in bytes: a power of two.  64, 128 and 256 cost as many bytes more of work memory, and on the stack of a
 * write; a mark takes a unit, so slots of 4 KB hold 12 marks of 256.  (Flash that takes pages of 256 but programs bits, as plain
 * NOR: better declare 4 or 8 and fill the page up with ones in the callback.) */
#ifndef IMUCAL_STORE_MAX_PROGRAM
#define IMUCAL_STORE_MAX_PROGRAM 32u
#endif
#if IMUCAL_STORE_MAX_PROGRAM < 8u || IMUCAL_STORE_MAX_PROGRAM > 256u ||                                                \
    (IMUCAL_STORE_MAX_PROGRAM & (IMUCAL_STORE_MAX_PROGRAM - 1u)) != 0
#error "IMUCAL_STORE_MAX_PROGRAM must be 8, 16, 32, 64, 128 or 256"
#endif
#define IMUCAL_STORE_MARK_BYTES(program_bytes) ((program_bytes) < 8u ? 8u : (uint32_t)(program_bytes))
/* Room for the longest table, three commit marks, revoke and one endorse: 904 bytes up to units of 8, 1024 with 32. */
#define IMUCAL_STORE_MIN_SLOT_BYTES(program_bytes)                                                                     \
  ((IMUCAL_TABLE_MAX_BYTES + (program_bytes)-1u) / (program_bytes) * (program_bytes) +                                 \
   (IMUCAL_STORE_MIN_COMMITS + 2u) * IMUCAL_STORE_MARK_BYTES(program_bytes))

/* The flash, as the port offers it.  slot: 0 or 1; offset and len are multiples of 4 and, for program, of program_bytes;
 * data is aligned to 4.  Each returns IMUCAL_OK or IMUCAL_ERR_FLASH (read: where ECC cannot correct, for example).
 * erase: the whole slot to ones.  program: units that are erased, each once. */
typedef struct imucal_flash {
  imucal_status (*erase)(void* ctx, uint32_t slot);
  imucal_status (*program)(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len);
  imucal_status (*read)(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len);
  void* ctx;
  uint32_t slot_bytes;    /* multiple of erase_bytes, >= IMUCAL_STORE_MIN_SLOT_BYTES(program_bytes) */
  uint32_t erase_bytes;   /* smallest unit of erasing (a page); multiple of program_bytes and of 8 */
  uint32_t program_bytes; /* smallest unit of programming: 1, 2, 4, .. IMUCAL_STORE_MAX_PROGRAM */
} imucal_flash_t;

/* What is in the slots. */
typedef struct imucal_store_report {
  imucal_status slot_status[IMUCAL_STORE_SLOTS]; /* IMUCAL_OK: valid; else why not */
  uint32_t sequence[IMUCAL_STORE_SLOTS];         /* as written there when the bytes are intact; else 0 */
  int8_t ruling;                                 /* 0, 1, or -1: none */
} imucal_store_report_t;

/* Where the ruling table comes from. */
#define IMUCAL_STORE_NO_ORIGIN 0u
typedef struct imucal_store_origin {
  uint8_t noted;    /* as given to write; IMUCAL_STORE_NO_ORIGIN: not noted, or written before origins were */
  bool is_restored; /* a rollback went back to it */
} imucal_store_origin_t;

/* Work memory: aligned to 4 by its type; the longest table, its origin, filled up to a program unit. */
typedef struct imucal_store_work {
  uint32_t words[(IMUCAL_TABLE_MAX_BYTES + IMUCAL_STORE_MAX_PROGRAM) / 4];
} imucal_store_work_t;

/* Can tables be kept in flash of these sizes?  IMUCAL_ERR_GEOMETRY: no; every function below says so too and touches nothing.
 * Ask before hours of learning. */
IMUCAL_MUST_USE imucal_status imucal_store_check(const imucal_flash_t* flash);

/* Find the ruling table for the device `serial` (IMUCAL_SERIAL_LEN characters, 0-padded; null: any) with n_channels
 * (0: any).  IMUCAL_OK: *table is it; IMUCAL_ERR_NO_TABLE: none, see report; IMUCAL_ERR_GEOMETRY: so are both slots in the
 * report.  report may not be null.  At most 80 reads; writes nothing. */
IMUCAL_MUST_USE imucal_status imucal_store_load(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                                imucal_store_work_t* work, imucal_table_t* table,
                                                imucal_store_report_t* report);

/* Write `table` into the slot that does not rule, with the next sequence number (set in *table), and commit.  On
 * IMUCAL_OK it rules and the report says so.  origin: any number of the application's from 1 on (IMUCAL_ORIGIN_* of link.h),
 * kept beside the table; IMUCAL_STORE_NO_ORIGIN: none.  A slot that six channels fill to its marks (1 KB with units of 16
 * or 32 bytes) has no room for it: not noted.  Errors that leave the flash untouched: IMUCAL_ERR_SERIAL,
 * IMUCAL_ERR_CHANNELS (table of another device), the status of table_validate, IMUCAL_ERR_SEQUENCE.  After
 * IMUCAL_ERR_FLASH and IMUCAL_ERR_VERIFY the old table rules, or the new one where only the last mark's read-back
 * failed: load tells.  work must not overlap table.
 * IMUCAL_ERR_SLOTS: the slots are not apart (erase_bytes or the callbacks are wrong).  The new table rules, the old one is
 * lost, and a power cut in the next write would lose both; of slots that share an address none rules.
 * IMUCAL_ERR_SEQUENCE: the newest number is 2^32 - 256.  Numbers grow by 1 a write (by at most 13 after writes cut again and
 * again); flash that stands 100,000 erases a slot is worn out after 200,000 writes, long before.  imucal_store_erase starts
 * the numbers anew. */
IMUCAL_MUST_USE imucal_status imucal_store_write(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                                 uint8_t origin, imucal_store_work_t* work, imucal_table_t* table,
                                                 imucal_store_report_t* report);

/* Where the ruling table of n_channels (those of *table) comes from, by a report of load, write or rollback; nothing rules:
 * not noted.  At most 13 reads. */
imucal_store_origin_t imucal_store_origin(const imucal_flash_t* flash, const imucal_store_report_t* report,
                                          uint32_t n_channels);

/* Revoke the ruling table; the other valid one rules (loaded into *table).  IMUCAL_ERR_NO_OTHER: nothing to go back
 * to, nothing changed; IMUCAL_ERR_NO_TABLE; IMUCAL_ERR_NO_MARK: no mark is left to note it with, nothing changed: flash the
 * older table again instead.  So after 7 rollbacks to the same table (1 in the smallest slot; fewer where writes were cut
 * and each took a mark), and where a cut rollback or bits flipped at rest left the mark of this pair begun.
 * IMUCAL_ERR_FLASH, IMUCAL_ERR_VERIFY: it did not take, load tells which rules. */
IMUCAL_MUST_USE imucal_status imucal_store_rollback(const imucal_flash_t* flash, const char* serial,
                                                    uint32_t n_channels, imucal_store_work_t* work,
                                                    imucal_table_t* table, imucal_store_report_t* report);

/* Erase both slots, the ruling one last, and check it. */
IMUCAL_MUST_USE imucal_status imucal_store_erase(const imucal_flash_t* flash, imucal_store_work_t* work,
                                                 imucal_store_report_t* report);

#if defined(__cplusplus)
}
#endif
#endif
