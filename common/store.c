// SPDX-License-Identifier: MIT
#include "store.h"

#include <string.h>

#include "num.h"

#define ERASED 0xFFFFFFFFu
#define NONE (-1)

static uint32_t commit_offset(const imucal_flash_t* flash) { return flash->slot_bytes - 8; }
static uint32_t revoke_offset(const imucal_flash_t* flash) { return flash->slot_bytes - 4; }

static bool is_usable(const imucal_flash_t* flash) {
  return flash->slot_bytes >= IMUCAL_STORE_MIN_SLOT_BYTES && flash->slot_bytes % 4 == 0;
}

/* One word through an aligned buffer, little-endian like everything in flash. */
static imucal_status read_word(const imucal_flash_t* flash, uint32_t slot, uint32_t offset, uint32_t* word) {
  uint32_t buffer = 0;
  imucal_status status = flash->read(flash->ctx, slot, offset, (uint8_t*)&buffer, 4);
  *word = imucal_get_u32((const uint8_t*)&buffer);
  return status;
}
static imucal_status program_word(const imucal_flash_t* flash, uint32_t slot, uint32_t offset, uint32_t word) {
  uint32_t buffer = 0;
  imucal_put_u32((uint8_t*)&buffer, word);
  return flash->program(flash->ctx, slot, offset, (const uint8_t*)&buffer, 4);
}

/* Whose device is the table for? */
static imucal_status check_owner(const char* table_serial, uint32_t table_channels, const char* serial,
                                 uint32_t n_channels) {
  if (serial != NULL && !imucal_text_equal(table_serial, serial, IMUCAL_SERIAL_LEN)) return IMUCAL_ERR_SERIAL;
  if (n_channels != 0 && table_channels != n_channels) return IMUCAL_ERR_CHANNELS;
  return IMUCAL_OK;
}

/* Judge one slot; its bytes stay in work.  *sequence: as stored when the bytes are intact, whether it may rule or
 * not. */
static imucal_status load_slot(const imucal_flash_t* flash, uint32_t slot, const char* serial, uint32_t n_channels,
                               imucal_store_work_t* work, uint32_t* sequence) {
  *sequence = 0;
  uint32_t commit = 0, revoke = 0;
  imucal_status status = read_word(flash, slot, commit_offset(flash), &commit);
  if (status == IMUCAL_OK) status = read_word(flash, slot, revoke_offset(flash), &revoke);
  if (status == IMUCAL_OK)
    status = flash->read(flash->ctx, slot, 0, (uint8_t*)work->words, IMUCAL_TABLE_MAX_BYTES);
  if (status != IMUCAL_OK) return status;
  const uint8_t* bytes = (const uint8_t*)work->words;
  if (commit == ERASED && revoke == ERASED && imucal_get_u32(bytes) == ERASED) return IMUCAL_SLOT_EMPTY;
  if (commit != IMUCAL_STORE_COMMIT) return IMUCAL_ERR_COMMIT;
  status = imucal_table_decode(bytes, IMUCAL_TABLE_MAX_BYTES, NULL, NULL);
  if (status != IMUCAL_OK) return status;
  *sequence = imucal_get_u32(bytes + 24);
  if (revoke != ERASED) return IMUCAL_SLOT_REVOKED;
  return check_owner((const char*)bytes + 8, bytes[32], serial, n_channels);
}

/* Judge both slots and name the ruling one; work holds nothing certain afterwards. */
static void survey(const imucal_flash_t* flash, const char* serial, uint32_t n_channels, imucal_store_work_t* work,
                   imucal_store_report_t* report) {
  report->ruling = NONE;
  for (uint32_t slot = 0; slot < IMUCAL_STORE_SLOTS; slot++) {
    report->slot_status[slot] = load_slot(flash, slot, serial, n_channels, work, &report->sequence[slot]);
    if (report->slot_status[slot] != IMUCAL_OK) continue;
    if (report->ruling == NONE || report->sequence[slot] > report->sequence[0]) report->ruling = (int8_t)slot;
  }
}

imucal_status imucal_store_load(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                imucal_store_work_t* work, imucal_table_t* table, imucal_store_report_t* report) {
  if (!is_usable(flash)) return IMUCAL_ERR_ARGUMENT;
  survey(flash, serial, n_channels, work, report);
  if (report->ruling == NONE) return IMUCAL_ERR_NO_TABLE;
  uint32_t sequence = 0;
  imucal_status status = load_slot(flash, (uint32_t)report->ruling, serial, n_channels, work, &sequence);
  if (status != IMUCAL_OK) return status;
  return imucal_table_decode((const uint8_t*)work->words, IMUCAL_TABLE_MAX_BYTES, table, NULL);
}

/* To 0 where it still has its valid value: so a word is written twice at most between erases, cut or not. */
static imucal_status clear_word(const imucal_flash_t* flash, uint32_t slot, uint32_t offset, uint32_t valid) {
  uint32_t word = 0;
  imucal_status status = read_word(flash, slot, offset, &word);
  return status == IMUCAL_OK && word == valid ? program_word(flash, slot, offset, 0) : status;
}

/* Make a slot worthless before its erase: an erase that is cut may bring back the erased state of the revoke word
 * while the table is still whole, and a revoked table must not return. */
static imucal_status clear_slot(const imucal_flash_t* flash, uint32_t slot) {
  imucal_status status = clear_word(flash, slot, commit_offset(flash), IMUCAL_STORE_COMMIT);
  if (status == IMUCAL_OK) status = clear_word(flash, slot, 0, IMUCAL_TABLE_MAGIC);
  if (status == IMUCAL_OK) status = flash->erase(flash->ctx, slot);
  return status;
}

/* Compare the slot's first len bytes with what was to be there, a few words at a time. */
static imucal_status verify_slot(const imucal_flash_t* flash, uint32_t slot, const uint8_t* bytes, uint32_t len) {
  uint32_t back[8];
  for (uint32_t at = 0; at < len; at += sizeof back) {
    uint32_t n = len - at < sizeof back ? len - at : (uint32_t)sizeof back;
    imucal_status status = flash->read(flash->ctx, slot, at, (uint8_t*)back, n);
    if (status != IMUCAL_OK) return status;
    if (memcmp(back, bytes + at, n) != 0) return IMUCAL_ERR_VERIFY;
  }
  return IMUCAL_OK;
}

/* Erase, program, read back, commit. */
static imucal_status write_slot(const imucal_flash_t* flash, uint32_t slot, const uint8_t* bytes, uint32_t len) {
  imucal_status status = clear_slot(flash, slot);
  if (status == IMUCAL_OK) status = flash->program(flash->ctx, slot, 0, bytes, len);
  if (status == IMUCAL_OK) status = verify_slot(flash, slot, bytes, len);
  uint32_t commit = 0, revoke = 0;
  if (status == IMUCAL_OK) status = read_word(flash, slot, commit_offset(flash), &commit);
  if (status == IMUCAL_OK) status = read_word(flash, slot, revoke_offset(flash), &revoke);
  if (status == IMUCAL_OK && (commit != ERASED || revoke != ERASED)) status = IMUCAL_ERR_VERIFY;
  if (status == IMUCAL_OK) status = program_word(flash, slot, commit_offset(flash), IMUCAL_STORE_COMMIT);
  if (status == IMUCAL_OK) status = read_word(flash, slot, commit_offset(flash), &commit);
  return status == IMUCAL_OK && commit != IMUCAL_STORE_COMMIT ? IMUCAL_ERR_VERIFY : status;
}

imucal_status imucal_store_write(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                 imucal_store_work_t* work, imucal_table_t* table, imucal_store_report_t* report) {
  if (!is_usable(flash)) return IMUCAL_ERR_ARGUMENT;
  imucal_status status = check_owner(table->serial, table->n_channels, serial, n_channels);
  if (status != IMUCAL_OK) return status;
  survey(flash, serial, n_channels, work, report);
  uint32_t newest = report->sequence[0] > report->sequence[1] ? report->sequence[0] : report->sequence[1];
  if (newest >= UINT32_MAX - 1) return IMUCAL_ERR_SEQUENCE;
  table->sequence = newest + 1;
  size_t len = 0;
  status = imucal_table_encode(table, (uint8_t*)work->words, sizeof work->words, &len);
  if (status != IMUCAL_OK) return status;
  uint32_t loser = report->ruling == 0 ? 1u : 0u;
  status = write_slot(flash, loser, (const uint8_t*)work->words, (uint32_t)len);
  report->slot_status[loser] = status;
  report->sequence[loser] = status == IMUCAL_OK ? table->sequence : 0;
  if (status == IMUCAL_OK) report->ruling = (int8_t)loser;
  return status;
}

imucal_status imucal_store_rollback(const imucal_flash_t* flash, const char* serial, uint32_t n_channels,
                                    imucal_store_work_t* work, imucal_table_t* table,
                                    imucal_store_report_t* report) {
  imucal_status status = imucal_store_load(flash, serial, n_channels, work, table, report);
  if (status != IMUCAL_OK) return status;
  if (report->slot_status[1 - report->ruling] != IMUCAL_OK) return IMUCAL_ERR_NO_OTHER;
  status = program_word(flash, (uint32_t)report->ruling, revoke_offset(flash), 0);
  if (status != IMUCAL_OK) return status;
  return imucal_store_load(flash, serial, n_channels, work, table, report);
}

imucal_status imucal_store_erase(const imucal_flash_t* flash, imucal_store_work_t* work,
                                 imucal_store_report_t* report) {
  if (!is_usable(flash)) return IMUCAL_ERR_ARGUMENT;
  survey(flash, NULL, 0, work, report);
  uint32_t first = report->ruling == 0 ? 1u : 0u;
  imucal_status status = clear_slot(flash, first);
  if (status == IMUCAL_OK) status = clear_slot(flash, 1u - first);
  survey(flash, NULL, 0, work, report);
  return status;
}
