// SPDX-License-Identifier: MIT
#include "store.h"

#include <string.h>

#include "num.h"

#define ERASED 0xFFFFFFFFu
#define NONE (-1)

/* ---- where things are ---- */

static uint32_t round_up(uint32_t n, uint32_t unit) {
  return (n + unit - 1) & ~(unit - 1);
} /* unit: a power of two */

/* Marks of a slot, counted from its end: commits, revoke, endorsements.  As many as there is room for behind the longest
 * table: 8 + 1 + 8, or in a small slot 3 + 1 + at least 1. */
static uint32_t n_marks(const imucal_flash_t* flash) {
  const uint32_t room = flash->slot_bytes - round_up(IMUCAL_TABLE_MAX_BYTES, flash->program_bytes);
  const uint32_t n = room / IMUCAL_STORE_MARK_BYTES(flash->program_bytes);
  return n < IMUCAL_STORE_MAX_MARKS ? n : IMUCAL_STORE_MAX_MARKS;
}
static uint32_t n_commits(const imucal_flash_t* flash) {
  return n_marks(flash) == IMUCAL_STORE_MAX_MARKS ? IMUCAL_STORE_MAX_COMMITS : IMUCAL_STORE_MIN_COMMITS;
}
static uint32_t revoke_mark(const imucal_flash_t* flash) {
  return n_commits(flash);
}
static uint32_t n_endorse(const imucal_flash_t* flash) {
  return n_marks(flash) - n_commits(flash) - 1;
}

static uint32_t mark_offset(const imucal_flash_t* flash, uint32_t mark) {
  return flash->slot_bytes - (mark + 1) * IMUCAL_STORE_MARK_BYTES(flash->program_bytes);
}

imucal_status imucal_store_check(const imucal_flash_t* flash) {
  const uint32_t unit = flash->program_bytes, page = flash->erase_bytes;
  const bool is_unit = unit >= 1 && unit <= IMUCAL_STORE_MAX_PROGRAM && (unit & (unit - 1)) == 0;
  const bool is_usable = is_unit && page >= 8 && page % 8 == 0 && page % unit == 0 && flash->slot_bytes % page == 0 &&
                         flash->slot_bytes >= IMUCAL_STORE_MIN_SLOT_BYTES(unit);
  return is_usable ? IMUCAL_OK : IMUCAL_ERR_GEOMETRY;
}

/* ---- marks ---- */

typedef enum mark_state { MARK_ERASED, MARK_BEGUN, MARK_EXACT } mark_state_t;

/* A mark that cannot be read (ECC) was begun.  *noted: the sequence number in it (in a mark
 * caught by a cut less, in one programmed over such a mark possibly more). */
static mark_state_t read_mark(const imucal_flash_t* flash, uint32_t slot, uint32_t mark, uint32_t* noted) {
  uint32_t words[IMUCAL_STORE_MAX_PROGRAM / 4];
  const uint32_t len = IMUCAL_STORE_MARK_BYTES(flash->program_bytes);
  if (noted != NULL) *noted = 0;
  if (flash->read(flash->ctx, slot, mark_offset(flash, mark), (uint8_t*)words, len) != IMUCAL_OK) return MARK_BEGUN;
  const uint32_t number = ~imucal_get_u32((const uint8_t*)(words + 1));
  if (imucal_get_u32((const uint8_t*)words) == IMUCAL_STORE_COMMIT && number != UINT32_MAX) {
    if (noted != NULL) *noted = number;
    return MARK_EXACT;
  }
  uint32_t all = ERASED;
  for (uint32_t i = 0; i < len / 4; i++) all &= words[i];
  return all == ERASED ? MARK_ERASED : MARK_BEGUN;
}

static bool is_begun(const imucal_flash_t* flash, uint32_t slot, uint32_t mark) {
  return read_mark(flash, slot, mark, NULL) != MARK_ERASED;
}

/* Does a mark revoke?  Four bits do, so that up to three that flipped at rest do not. */
static bool is_revoking(const imucal_flash_t* flash, uint32_t slot, uint32_t mark) {
  uint32_t words[2], n_zeros = 0;
  if (flash->read(flash->ctx, slot, mark_offset(flash, mark), (uint8_t*)words, sizeof words) != IMUCAL_OK) return true;
  for (uint32_t bits = ~words[0], i = 0; i < 32; i++) n_zeros += bits >> i & 1u;
  return n_zeros >= 4;
}

/* Program a mark and read it back. */
static imucal_status set_mark(const imucal_flash_t* flash, uint32_t slot, uint32_t mark, uint32_t number) {
  uint32_t unit[IMUCAL_STORE_MAX_PROGRAM / 4], noted = 0;
  memset(unit, 0xFF, sizeof unit);
  imucal_put_u32((uint8_t*)unit, IMUCAL_STORE_COMMIT);
  imucal_put_u32((uint8_t*)(unit + 1), ~number);
  const imucal_status status = flash->program(flash->ctx, slot, mark_offset(flash, mark), (const uint8_t*)unit,
                                              IMUCAL_STORE_MARK_BYTES(flash->program_bytes));
  if (status != IMUCAL_OK) return status;
  return read_mark(flash, slot, mark, &noted) == MARK_EXACT && noted >= number ? IMUCAL_OK : IMUCAL_ERR_VERIFY;
}

/* One more commit mark for the slot that must stand while the other is erased (store.h, 3); it notes the newest number,
 * which is lost with the other slot.  IMUCAL_ERR_NO_MARK: all are begun. */
static imucal_status add_commit(const imucal_flash_t* flash, uint32_t slot, uint32_t newest) {
  imucal_status status = IMUCAL_ERR_NO_MARK;
  for (uint32_t mark = 0; mark < n_commits(flash); mark++) {
    if (is_begun(flash, slot, mark)) continue;
    const imucal_status set = set_mark(flash, slot, mark, newest);
    if (set == IMUCAL_OK) return IMUCAL_OK;
    if (!is_begun(flash, slot, mark)) status = set;
  }
  return status;
}

/* ---- the origin ---- */

/* One word directly behind the table, programmed with it: 0x4F52, NOT origin, origin. */
#define ORIGIN_TAG 0x4F520000u
enum { ORIGIN_BYTES = 4 };

static uint32_t origin_word(uint8_t origin) {
  return ORIGIN_TAG | (uint32_t)(uint8_t)~origin << 8 | origin;
}

static bool has_room_for_origin(const imucal_flash_t* flash, uint32_t table_bytes) {
  return round_up(table_bytes + ORIGIN_BYTES, flash->program_bytes) <= mark_offset(flash, n_marks(flash) - 1);
}

imucal_store_origin_t imucal_store_origin(const imucal_flash_t* flash, const imucal_store_report_t* report,
                                          uint32_t n_channels) {
  imucal_store_origin_t origin = {IMUCAL_STORE_NO_ORIGIN, false};
  if (report->ruling == NONE || n_channels > IMUCAL_MAX_CHANNELS) return origin;
  const uint32_t slot = (uint32_t)report->ruling, at = IMUCAL_TABLE_BYTES(n_channels);
  for (uint32_t i = 0; i < n_endorse(flash) && !origin.is_restored; i++)
    origin.is_restored = is_revoking(flash, slot, revoke_mark(flash) + 1 + i);
  uint32_t word = 0;
  if (!has_room_for_origin(flash, at) || flash->read(flash->ctx, slot, at, (uint8_t*)&word, sizeof word) != IMUCAL_OK)
    return origin;
  word = imucal_get_u32((const uint8_t*)&word);
  if (word == origin_word((uint8_t)word)) origin.noted = (uint8_t)word;
  return origin;
}

/* ---- judging ---- */

/* Whose device is the table for? */
static imucal_status check_owner(const char* table_serial, uint32_t table_channels, const char* serial,
                                 uint32_t n_channels) {
  if (serial != NULL && !imucal_text_equal(table_serial, serial, IMUCAL_SERIAL_LEN)) return IMUCAL_ERR_SERIAL;
  if (n_channels != 0 && table_channels != n_channels) return IMUCAL_ERR_CHANNELS;
  return IMUCAL_OK;
}

/* Is it committed?  IMUCAL_SLOT_EMPTY: no commit mark begun.  *noted: the largest number in any of its marks. */
static imucal_status check_commit(const imucal_flash_t* flash, uint32_t slot, uint32_t* noted) {
  imucal_status status = IMUCAL_SLOT_EMPTY;
  *noted = 0;
  for (uint32_t mark = 0; mark < n_marks(flash); mark++) {
    uint32_t number = 0;
    const mark_state_t state = read_mark(flash, slot, mark, &number);
    if (number > *noted) *noted = number;
    if (mark >= n_commits(flash)) continue;
    if (state == MARK_EXACT) status = IMUCAL_OK;
    if (state == MARK_BEGUN && status == IMUCAL_SLOT_EMPTY) status = IMUCAL_ERR_COMMIT;
  }
  return status;
}

/* Judge one slot by itself; its bytes stay in work.  *sequence: as stored when the bytes are intact, whether it may
 * rule or not.  *noted: the largest number in its marks. */
static imucal_status load_slot(const imucal_flash_t* flash, uint32_t slot, const char* serial, uint32_t n_channels,
                               imucal_store_work_t* work, uint32_t* sequence, uint32_t* noted) {
  const uint8_t* bytes = (const uint8_t*)work->words;
  *sequence = 0;
  const imucal_status commit = check_commit(flash, slot, noted);
  imucal_status status = flash->read(flash->ctx, slot, 0, (uint8_t*)work->words, IMUCAL_TABLE_MAX_BYTES);
  if (status != IMUCAL_OK) return status;
  status = imucal_table_decode(bytes, IMUCAL_TABLE_MAX_BYTES, NULL, NULL);
  if (status == IMUCAL_OK) *sequence = imucal_get_u32(bytes + IMUCAL_TABLE_AT_SEQUENCE);
  if (commit == IMUCAL_SLOT_EMPTY && imucal_get_u32(bytes + IMUCAL_TABLE_AT_MAGIC) != ERASED) return IMUCAL_ERR_COMMIT;
  if (commit != IMUCAL_OK) return commit;
  if (status != IMUCAL_OK) return status;
  if (is_revoking(flash, slot, revoke_mark(flash))) return IMUCAL_SLOT_REVOKED;
  return check_owner((const char*)bytes + IMUCAL_TABLE_AT_SERIAL, bytes[IMUCAL_TABLE_AT_CHANNELS], serial, n_channels);
}

/* The endorse mark in slot `older` by which it outranks a table of number `newer` in the other; n_marks: there is none. */
static uint32_t endorse_mark(const imucal_flash_t* flash, const imucal_store_report_t* report, uint32_t older,
                             uint32_t newer) {
  const uint32_t step = newer - report->sequence[older] - 1;
  return step < n_endorse(flash) ? revoke_mark(flash) + 1 + step : n_marks(flash);
}
static bool is_outranked(const imucal_flash_t* flash, const imucal_store_report_t* report, uint32_t older,
                         uint32_t newer) {
  const uint32_t mark = endorse_mark(flash, report, older, newer);
  return mark < n_marks(flash) && is_revoking(flash, older, mark);
}

/* Name the ruling slot of the valid ones. */
static void name_ruling(const imucal_flash_t* flash, imucal_store_report_t* report) {
  const bool is_ok[] = {report->slot_status[0] == IMUCAL_OK, report->slot_status[1] == IMUCAL_OK};
  report->ruling = is_ok[0] ? 0 : is_ok[1] ? 1 : NONE;
  if (!is_ok[0] || !is_ok[1]) return;
  const uint32_t newer = report->sequence[1] > report->sequence[0] ? 1u : 0u, older = 1 - newer;
  const bool is_revoked = is_outranked(flash, report, older, report->sequence[newer]);
  if (is_revoked) report->slot_status[newer] = IMUCAL_SLOT_REVOKED;
  report->ruling = (int8_t)(is_revoked ? older : newer);
}

/* Judge both slots and name the ruling one; work holds nothing certain afterwards.  Returns the newest sequence number
 * there is any trace of. */
static uint32_t survey(const imucal_flash_t* flash, const char* serial, uint32_t n_channels, imucal_store_work_t* work,
                       imucal_store_report_t* report) {
  uint32_t newest = 0;
  for (uint32_t slot = 0; slot < IMUCAL_STORE_SLOTS; slot++) {
    uint32_t noted = 0;
    report->slot_status[slot] = load_slot(flash, slot, serial, n_channels, work, &report->sequence[slot], &noted);
    if (report->sequence[slot] > newest) newest = report->sequence[slot];
    if (noted > newest && report->slot_status[slot] == IMUCAL_OK) newest = noted;
  }
  name_ruling(flash, report);
  return newest;
}

/* What was read to judge may read differently when it is loaded (cells caught by a cut): then the other slot. */
imucal_status imucal_store_load(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                imucal_store_work_t* work, imucal_table_t* table, imucal_store_report_t* report) {
  const imucal_status usable = imucal_store_check(flash);
  if (usable != IMUCAL_OK) {
    report->slot_status[0] = report->slot_status[1] = usable;
    report->ruling = NONE;
    return usable;
  }
  (void)survey(flash, serial, n_channels, work, report);
  for (uint32_t attempt = 0; attempt < IMUCAL_STORE_SLOTS && report->ruling != NONE; attempt++) {
    const uint32_t slot = (uint32_t)report->ruling;
    uint32_t noted = 0;
    imucal_status status = load_slot(flash, slot, serial, n_channels, work, &report->sequence[slot], &noted);
    if (status == IMUCAL_OK)
      status = imucal_table_decode((const uint8_t*)work->words, IMUCAL_TABLE_MAX_BYTES, table, NULL);
    if (status == IMUCAL_OK) return IMUCAL_OK;
    report->slot_status[slot] = status;
    name_ruling(flash, report);
  }
  return IMUCAL_ERR_NO_TABLE;
}

/* ---- writing ---- */

/* Compare the slot's first len bytes with what was to be there (null: erased), a few words at a time. */
static imucal_status verify_slot(const imucal_flash_t* flash, uint32_t slot, const uint8_t* bytes, uint32_t len) {
  uint32_t back[8], erased[8];
  memset(erased, 0xFF, sizeof erased);
  for (uint32_t at = 0; at < len; at += sizeof back) {
    const uint32_t n = len - at < sizeof back ? len - at : (uint32_t)sizeof back;
    const imucal_status status = flash->read(flash->ctx, slot, at, (uint8_t*)back, n);
    if (status != IMUCAL_OK) return status;
    if (memcmp(back, bytes != NULL ? bytes + at : (const uint8_t*)erased, n) != 0) return IMUCAL_ERR_VERIFY;
  }
  return IMUCAL_OK;
}

static imucal_status erase_slot(const imucal_flash_t* flash, uint32_t slot) {
  const imucal_status status = flash->erase(flash->ctx, slot);
  return status == IMUCAL_OK ? verify_slot(flash, slot, NULL, flash->slot_bytes) : status;
}

/* Erase the slot that does not rule.  IMUCAL_ERR_SLOTS: the erase took the ruling table too. */
static imucal_status erase_loser(const imucal_flash_t* flash, uint32_t loser, imucal_store_work_t* work,
                                 imucal_store_report_t* report) {
  const imucal_status status = erase_slot(flash, loser);
  if (status != IMUCAL_OK || report->ruling == NONE) return status;
  const uint32_t winner = 1 - loser;
  uint32_t noted = 0;
  const imucal_status still = load_slot(flash, winner, NULL, 0, work, &report->sequence[winner], &noted);
  report->slot_status[winner] = still;
  return still == IMUCAL_OK || still == IMUCAL_ERR_FLASH ? still : IMUCAL_ERR_SLOTS;
}

/* Into an erased slot: program, read back, commit.  len: whole units.  is_first: the other slot is erased too, and stays so. */
static imucal_status write_slot(const imucal_flash_t* flash, uint32_t slot, const uint8_t* bytes, uint32_t len,
                                uint32_t sequence, bool is_first) {
  imucal_status status = flash->program(flash->ctx, slot, 0, bytes, len);
  if (status == IMUCAL_OK) status = verify_slot(flash, slot, bytes, len);
  if (status == IMUCAL_OK && is_first) {
    status = verify_slot(flash, 1 - slot, NULL, flash->slot_bytes);
    if (status == IMUCAL_ERR_VERIFY) status = IMUCAL_ERR_SLOTS;
  }
  return status == IMUCAL_OK ? set_mark(flash, slot, 0, sequence) : status;
}

/* Make ready to overwrite slot `loser`: what must not be lost with it stands in the other slot.  *sequence: the number of
 * the next table, in: the newest one. */
static imucal_status secure(const imucal_flash_t* flash, const imucal_store_report_t* report, uint32_t loser,
                            uint32_t* sequence) {
  const uint32_t newest = *sequence, winner = 1 - loser;
  *sequence = newest + 1;
  if (report->ruling == NONE) return erase_slot(flash, winner);
  for (uint32_t i = 0; i < IMUCAL_STORE_MAX_MARKS && is_outranked(flash, report, winner, *sequence); i++) ++*sequence;
  const imucal_status status = add_commit(flash, winner, newest);
  if (status != IMUCAL_ERR_NO_MARK) return status;
  /* No mark left to note the number: one that no endorse mark stands for. */
  const uint32_t beyond = report->sequence[winner] + n_endorse(flash) + 1;
  if (beyond > *sequence) *sequence = beyond;
  return IMUCAL_OK;
}

imucal_status imucal_store_write(const imucal_flash_t* flash, const char* serial, uint32_t n_channels, uint8_t origin,
                                 imucal_store_work_t* work, imucal_table_t* table, imucal_store_report_t* report) {
  imucal_status status = imucal_store_check(flash);
  if (status == IMUCAL_OK) status = check_owner(table->serial, table->n_channels, serial, n_channels);
  if (status != IMUCAL_OK) return status;
  table->sequence = 1; /* any that is valid */
  status = imucal_table_validate(table, NULL);
  if (status != IMUCAL_OK) return status;
  uint32_t sequence = survey(flash, serial, n_channels, work, report);
  if (sequence >= IMUCAL_STORE_MAX_SEQUENCE) return IMUCAL_ERR_SEQUENCE;
  const uint32_t loser = report->ruling == 0 ? 1u : 0u;
  status = secure(flash, report, loser, &sequence);
  if (status != IMUCAL_OK) return status;
  const imucal_status erased = erase_loser(flash, loser, work, report);
  const bool is_erased = erased == IMUCAL_OK || erased == IMUCAL_ERR_SLOTS;
  size_t len = 0;
  table->sequence = sequence;
  memset(work->words, 0xFF, sizeof work->words); /* what fills up the last unit */
  status = imucal_table_encode(table, (uint8_t*)work->words, sizeof work->words, &len);
  if (status != IMUCAL_OK) return status;
  if (origin != IMUCAL_STORE_NO_ORIGIN && has_room_for_origin(flash, (uint32_t)len)) {
    imucal_put_u32((uint8_t*)work->words + len, origin_word(origin));
    len += ORIGIN_BYTES;
  }
  const uint32_t unit = flash->program_bytes < 4 ? 4 : flash->program_bytes;
  status = !is_erased ? erased
                      : write_slot(flash, loser, (const uint8_t*)work->words, round_up((uint32_t)len, unit), sequence,
                                   report->ruling == NONE);
  report->slot_status[loser] = status;
  report->sequence[loser] = status == IMUCAL_OK ? sequence : 0;
  if (status == IMUCAL_OK) report->ruling = (int8_t)loser;
  return status == IMUCAL_OK ? erased : status;
}

imucal_status imucal_store_rollback(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                    imucal_store_work_t* work, imucal_table_t* table, imucal_store_report_t* report) {
  imucal_status status = imucal_store_load(flash, serial, n_channels, work, table, report);
  if (status != IMUCAL_OK) return status;
  const uint32_t newer = (uint32_t)report->ruling, older = 1 - newer;
  if (report->slot_status[older] != IMUCAL_OK) return IMUCAL_ERR_NO_OTHER;
  const uint32_t mark = endorse_mark(flash, report, older, report->sequence[newer]);
  if (mark == n_marks(flash)) return IMUCAL_ERR_NO_MARK;
  /* A mark that a cut left begun, without bits enough to revoke, is not programmed again: units with ECC refuse it. */
  if (is_begun(flash, older, mark) || is_begun(flash, newer, revoke_mark(flash))) return IMUCAL_ERR_NO_MARK;
  status = set_mark(flash, older, mark, report->sequence[newer]);
  if (status == IMUCAL_OK) status = set_mark(flash, newer, revoke_mark(flash), report->sequence[newer]);
  if (status != IMUCAL_OK) return status;
  status = imucal_store_load(flash, serial, n_channels, work, table, report);
  return status == IMUCAL_OK && report->ruling != (int8_t)older ? IMUCAL_ERR_VERIFY : status;
}

imucal_status imucal_store_erase(const imucal_flash_t* flash, imucal_store_work_t* work,
                                 imucal_store_report_t* report) {
  imucal_status status = imucal_store_check(flash);
  if (status != IMUCAL_OK) return status;
  const uint32_t newest = survey(flash, NULL, 0, work, report);
  const uint32_t first = report->ruling == 0 ? 1u : 0u;
  status = report->ruling == NONE ? IMUCAL_OK : add_commit(flash, 1 - first, newest);
  if (status == IMUCAL_OK || status == IMUCAL_ERR_NO_MARK) status = erase_slot(flash, first);
  if (status == IMUCAL_OK) status = erase_slot(flash, 1 - first);
  (void)survey(flash, NULL, 0, work, report);
  return status;
}
