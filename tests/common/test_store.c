// SPDX-License-Identifier: MIT
// store: what each operation does, to the byte; foreign and damaged slots; sizes of flash; what the marks of a slot say;
// drivers that fail in silence.  Power cuts: test_store_torn.c.
#include "unit.h"

#include "num.h"
#include "store.h"
#include "table_example.h"

#include "emu/torn_nor.h"

#define SLOT_BYTES 1024u
static const torn_nor_geometry_t small_pages = {SLOT_BYTES, SLOT_BYTES, 4};

static imucal_store_work_t work;
static imucal_store_report_t report;

/* The ruling table's mark, or -1. */
static int ruling_mark(torn_nor_t* nor) {
  imucal_flash_t flash = torn_nor_flash(nor);
  imucal_table_t table;
  imucal_status status = imucal_store_load(&flash, "SN-17", 3, &work, &table, &report);
  if (status == IMUCAL_ERR_NO_TABLE) return -1;
  assert_int_equal(status, IMUCAL_OK);
  imucal_table_t expected = example_table(3, (int)(table.created_s - 1767225600u));
  expected.sequence = table.sequence;
  assert_memory_equal(&table, &expected, sizeof table); /* whole, never a mixture */
  return (int)(table.created_s - 1767225600u);
}

static imucal_status write_mark(torn_nor_t* nor, int mark) {
  imucal_flash_t flash = torn_nor_flash(nor);
  imucal_table_t table = example_table(3, mark);
  return imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report);
}

static imucal_status roll_back(torn_nor_t* nor) {
  imucal_flash_t flash = torn_nor_flash(nor);
  imucal_table_t table;
  return imucal_store_rollback(&flash, "SN-17", 3, &work, &table, &report);
}

static imucal_status erase_all(torn_nor_t* nor) {
  imucal_flash_t flash = torn_nor_flash(nor);
  return imucal_store_erase(&flash, &work, &report);
}

static void test_empty_flash_has_no_table(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  assert_int_equal(ruling_mark(&nor), -1);
  assert_int_equal(report.slot_status[0], IMUCAL_SLOT_EMPTY);
  assert_int_equal(report.slot_status[1], IMUCAL_SLOT_EMPTY);
  assert_int_equal(report.ruling, -1);
  assert_int_equal(roll_back(&nor), IMUCAL_ERR_NO_TABLE);
}

static void test_write_alternates_slots_and_counts_up(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  for (int mark = 1; mark <= 20; mark++) {
    assert_int_equal(write_mark(&nor, mark), IMUCAL_OK);
    assert_int_equal(report.ruling, (mark + 1) % 2);
    assert_int_equal(ruling_mark(&nor), mark);
    assert_int_equal(report.sequence[report.ruling], mark);
  }
  assert_int_equal(nor.n_erase[0], 10);
  assert_int_equal(nor.n_erase[1], 11); /* wear is shared; the first write erases both */
  assert_int_equal(nor.n_violations, 0);
}

static void test_rollback_goes_back_once_and_a_new_write_rules_again(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  assert_int_equal(write_mark(&nor, 1), IMUCAL_OK);
  assert_int_equal(roll_back(&nor), IMUCAL_ERR_NO_OTHER);
  assert_int_equal(ruling_mark(&nor), 1);
  assert_int_equal(write_mark(&nor, 2), IMUCAL_OK);
  assert_int_equal(roll_back(&nor), IMUCAL_OK);
  assert_int_equal(ruling_mark(&nor), 1);
  assert_int_equal(report.slot_status[1], IMUCAL_SLOT_REVOKED);
  assert_int_equal(roll_back(&nor), IMUCAL_ERR_NO_OTHER);
  assert_int_equal(write_mark(&nor, 3), IMUCAL_OK);
  assert_int_equal(ruling_mark(&nor), 3);
  assert_int_equal(report.sequence[1], 3); /* above the revoked one's */
  assert_int_equal(nor.n_violations, 0);
}

static void test_erase_leaves_nothing(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  assert_int_equal(write_mark(&nor, 1), IMUCAL_OK);
  assert_int_equal(write_mark(&nor, 2), IMUCAL_OK);
  assert_int_equal(erase_all(&nor), IMUCAL_OK);
  assert_int_equal(ruling_mark(&nor), -1);
  assert_int_equal(report.slot_status[0], IMUCAL_SLOT_EMPTY);
  assert_int_equal(report.slot_status[1], IMUCAL_SLOT_EMPTY);
}

/* Marks 1 and 2 written: 2 rules in slot 1. */
static void prepare(torn_nor_t* nor) {
  torn_nor_init(nor, small_pages);
  assert_int_equal(write_mark(nor, 1), IMUCAL_OK);
  assert_int_equal(write_mark(nor, 2), IMUCAL_OK);
}

/* Slots that are not apart: as many bytes from the other slot's start as this are erased with a slot. */
static uint32_t erased_too;
static imucal_status erase_more(void* ctx, uint32_t slot) {
  torn_nor_t* nor = (torn_nor_t*)ctx;
  memset(nor->bytes[1 - slot], 0xFF, erased_too);
  memset(nor->is_used[1 - slot], 0, erased_too);
  return torn_nor_erase(ctx, slot);
}
static imucal_status erase_first(void* ctx, uint32_t slot) {
  (void)slot;
  return torn_nor_erase(ctx, 0);
}
static imucal_status program_first(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  (void)slot;
  return torn_nor_program(ctx, 0, offset, data, len);
}
static imucal_status read_first(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  (void)slot;
  return torn_nor_read(ctx, 0, offset, data, len);
}

static imucal_status write_to(const imucal_flash_t* flash, int mark) {
  imucal_table_t table = example_table(3, mark);
  return imucal_store_write(flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report);
}

/* The whole other slot, or its start alone (sectors of 1.5 slots): told by the write that finds it, and the new table rules. */
static void test_write_tells_that_an_erase_takes_the_other_slot(void** state) {
  (void)state;
  static const uint32_t reach[] = {SLOT_BYTES, SLOT_BYTES / 2, 4};
  for (int i = 0; i < 3; i++) {
    torn_nor_t nor;
    torn_nor_init(&nor, small_pages);
    imucal_flash_t flash = torn_nor_flash(&nor);
    flash.erase = erase_more;
    erased_too = reach[i];
    assert_int_equal(write_to(&flash, 1), IMUCAL_OK); /* nothing to lose yet */
    for (int mark = 2; mark <= 5; mark++) {
      assert_int_equal(write_to(&flash, mark), IMUCAL_ERR_SLOTS);
      assert_int_not_equal(report.slot_status[1 - report.ruling], IMUCAL_OK);
      assert_int_equal(ruling_mark(&nor), mark);
    }
  }
}

static void test_first_write_tells_that_slots_share_an_address(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  imucal_flash_t flash = torn_nor_flash(&nor);
  flash.erase = erase_first, flash.program = program_first, flash.read = read_first;
  assert_int_equal(write_to(&flash, 1), IMUCAL_ERR_SLOTS);
  assert_int_equal(ruling_mark(&nor), -1);
}

static void test_load_tells_why_slots_are_refused(void** state) {
  (void)state;
  torn_nor_t nor;
  imucal_table_t table;
  prepare(&nor);
  imucal_flash_t flash = torn_nor_flash(&nor);
  assert_int_equal(imucal_store_load(&flash, "SN-18", 3, &work, &table, &report), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(report.slot_status[0], IMUCAL_ERR_SERIAL);
  assert_int_equal(imucal_store_load(&flash, "SN-17", 6, &work, &table, &report), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(report.slot_status[1], IMUCAL_ERR_CHANNELS);
  assert_int_equal(imucal_store_load(&flash, NULL, 0, &work, &table, &report), IMUCAL_OK);
  for (int n_bits = 1; n_bits <= 8; n_bits++) { /* four bits of a revoke mark revoke, three that flipped do not */
    torn_nor_t torn = nor;
    torn.bytes[1][SLOT_BYTES - 9 * 8] = (uint8_t)(0xFF << n_bits);
    assert_int_equal(ruling_mark(&torn), n_bits < 4 ? 2 : 1);
    assert_int_equal(report.slot_status[1], n_bits < 4 ? IMUCAL_OK : IMUCAL_SLOT_REVOKED);
  }
  for (int n_bits = 1; n_bits <= 8; n_bits++) { /* and of the endorse mark in the older slot */
    torn_nor_t torn = nor;
    torn.bytes[0][SLOT_BYTES - 10 * 8] = (uint8_t)(0xFF << n_bits);
    assert_int_equal(ruling_mark(&torn), n_bits < 4 ? 2 : 1);
    assert_int_equal(report.slot_status[1], n_bits < 4 ? IMUCAL_OK : IMUCAL_SLOT_REVOKED);
  }
  nor.bytes[1][200] ^= 4; /* the newer one rots: the older rules */
  assert_int_equal(ruling_mark(&nor), 1);
  assert_int_equal(report.slot_status[1], IMUCAL_ERR_CRC);
  nor.bytes[1][SLOT_BYTES - 8] ^= 1;
  assert_int_equal(ruling_mark(&nor), 1);
  assert_int_equal(report.slot_status[1], IMUCAL_ERR_COMMIT);
  nor.bytes[0][4] = 7;
  assert_int_equal(ruling_mark(&nor), -1);
  assert_int_equal(report.slot_status[0], IMUCAL_ERR_VERSION);
}

static void test_write_refuses_bad_tables_and_leaves_flash_alone(void** state) {
  (void)state;
  torn_nor_t nor, before;
  prepare(&nor);
  before = nor;
  imucal_flash_t flash = torn_nor_flash(&nor);
  imucal_table_t table = example_table(3, 9);
  strcpy(table.serial, "OTHER");
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report),
                   IMUCAL_ERR_SERIAL);
  table = example_table(2, 9);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report),
                   IMUCAL_ERR_CHANNELS);
  table = example_table(3, 9);
  table.channel[1].coeff[0] = (float)NAN;
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report),
                   IMUCAL_ERR_COEFFICIENT);
  assert_memory_equal(nor.bytes, before.bytes, sizeof nor.bytes);
}

static imucal_status load_with(torn_nor_t* nor, uint32_t slot_bytes, uint32_t erase_bytes, uint32_t program_bytes) {
  imucal_flash_t flash = torn_nor_flash(nor);
  flash.slot_bytes = slot_bytes, flash.erase_bytes = erase_bytes, flash.program_bytes = program_bytes;
  imucal_table_t table;
  report.ruling = 1;
  const imucal_status status = imucal_store_load(&flash, "SN-17", 3, &work, &table, &report);
  assert_int_equal(imucal_store_check(&flash), status == IMUCAL_ERR_NO_TABLE ? IMUCAL_OK : status);
  if (status != IMUCAL_ERR_GEOMETRY) return status;
  assert_true(report.slot_status[0] == status && report.slot_status[1] == status && report.ruling == -1);
  table = example_table(3, 1);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report), status);
  assert_int_equal(imucal_store_rollback(&flash, "SN-17", 3, &work, &table, &report), status);
  assert_int_equal(imucal_store_erase(&flash, &work, &report), status);
  return status;
}
static void test_sizes_of_flash_out_of_range_are_refused(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  assert_int_equal(load_with(&nor, 904, 8, 8), IMUCAL_ERR_NO_TABLE); /* 864 + 5 marks of 8 */
  assert_int_equal(load_with(&nor, 896, 8, 8), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(load_with(&nor, 1024, 1024, 32), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(load_with(&nor, 992, 32, 32), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(load_with(&nor, 1024, 1024, 1), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(load_with(&nor, 1024, 1024, 64), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(load_with(&nor, 904, 4, 4), IMUCAL_ERR_GEOMETRY); /* pages of multiples of 8 */
  assert_int_equal(load_with(&nor, 912, 12, 4), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(load_with(&nor, 1000, 16, 8), IMUCAL_ERR_GEOMETRY); /* slots of whole pages */
  assert_int_equal(load_with(&nor, 1024, 1024, 3), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(load_with(&nor, 1024, 1024, 0), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(load_with(&nor, 1024, 0, 4), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(load_with(&nor, 1024, 300, 4), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(load_with(&nor, 1024, 16, 32), IMUCAL_ERR_GEOMETRY);
}

/* The newest number there is any trace of is used up: refused, flash untouched; erasing starts anew. */
static void test_sequence_numbers_used_up_are_refused(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  imucal_table_t table = example_table(3, 5);
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES] = {0};
  size_t len = 0;
  table.sequence = IMUCAL_STORE_MAX_SEQUENCE - 1;
  assert_int_equal(imucal_table_encode(&table, bytes, sizeof bytes, &len), IMUCAL_OK);
  memcpy(nor.bytes[0], bytes, len);
  imucal_put_u32(nor.bytes[0] + SLOT_BYTES - 8, IMUCAL_STORE_COMMIT);
  imucal_put_u32(nor.bytes[0] + SLOT_BYTES - 4, ~table.sequence);
  assert_int_equal(write_mark(&nor, 6), IMUCAL_OK); /* the last one */
  assert_int_equal(report.sequence[1], IMUCAL_STORE_MAX_SEQUENCE);
  assert_int_equal(write_mark(&nor, 7), IMUCAL_ERR_SEQUENCE);
  assert_int_equal(ruling_mark(&nor), 6);
  assert_int_equal(erase_all(&nor), IMUCAL_OK);
  assert_int_equal(write_mark(&nor, 7), IMUCAL_OK);
  assert_int_equal(report.sequence[report.ruling], 1);
}

/* Each rollback to the same table takes a mark of its slot; then it is refused and says so. */
static void test_rollback_without_a_mark_left_is_refused(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  for (int round = 0; round < 7; round++) {
    assert_int_equal(roll_back(&nor), IMUCAL_OK);
    assert_int_equal(ruling_mark(&nor), 1);
    assert_int_equal(write_mark(&nor, 3 + round), IMUCAL_OK);
    assert_int_equal(ruling_mark(&nor), 3 + round);
  }
  assert_int_equal(roll_back(&nor), IMUCAL_ERR_NO_MARK);
  assert_int_equal(ruling_mark(&nor), 9);
  assert_int_equal(write_mark(&nor, 11), IMUCAL_OK); /* goes over table 1: the marks are fresh again */
  assert_int_equal(roll_back(&nor), IMUCAL_OK);
  assert_int_equal(ruling_mark(&nor), 9);
  assert_int_equal(nor.n_violations, 0);
}

/* A mark that a cut left begun (or where bits flipped) is not programmed again: units with ECC would refuse it at every try. */
static void test_rollback_over_a_begun_mark_is_refused(void** state) {
  (void)state;
  static const struct {
    uint32_t slot, mark;
  } begun[] = {{0, 9}, {1, 8}}; /* the endorse mark of this pair in the older slot, the revoke mark in the newer */
  for (int i = 0; i < 2; i++)
    for (int n_bits = 1; n_bits <= 3; n_bits++) { /* four revoke */
      torn_nor_t nor;
      prepare(&nor);
      nor.bytes[begun[i].slot][SLOT_BYTES - (begun[i].mark + 1) * 8] = (uint8_t)(0xFF << n_bits);
      for (int start = 0; start < 3; start++) {
        assert_int_equal(roll_back(&nor), IMUCAL_ERR_NO_MARK);
        assert_int_equal(ruling_mark(&nor), 2);
        torn_nor_power_on(&nor);
      }
      assert_int_equal(nor.n_programs, 0);
      assert_int_equal(nor.n_violations, 0);
      assert_int_equal(write_mark(&nor, 1), IMUCAL_OK); /* flashed instead */
      assert_int_equal(ruling_mark(&nor), 1);
      assert_int_equal(nor.n_violations, 0);
    }
}

/* A revoke or endorse mark that does not take: rollback must not say done. */
static void test_rollback_that_did_not_take_says_so(void** state) {
  (void)state;
  for (int call = 1; call <= 2; call++) {
    torn_nor_t nor;
    prepare(&nor);
    nor.fail_how = TORN_NOR_DOES_NOTHING, nor.fail_at_call = call, nor.n_calls = 0;
    assert_int_equal(roll_back(&nor), IMUCAL_ERR_VERIFY);
    nor.fail_at_call = 0;
    assert_int_equal(ruling_mark(&nor), call == 1 ? 2 : 1);
  }
}

/* The slot to write does not take its erase: nothing is programmed over it. */
static void test_write_erase_that_did_nothing_is_found(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  nor.fail_how = TORN_NOR_DOES_NOTHING, nor.fail_at_call = 2, nor.n_calls = 0; /* mark, erase */
  assert_int_equal(write_mark(&nor, 3), IMUCAL_ERR_VERIFY);
  assert_int_equal(nor.n_violations, 0);
  assert_int_equal(ruling_mark(&nor), 2);
}

/* A commit mark that did not take: not done. */
static void test_write_commit_that_did_nothing_is_found(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  nor.fail_how = TORN_NOR_DOES_NOTHING, nor.fail_at_call = 4, nor.n_calls = 0; /* mark, erase, table, mark */
  assert_int_equal(write_mark(&nor, 3), IMUCAL_ERR_VERIFY);
  nor.fail_at_call = 0;
  assert_int_equal(ruling_mark(&nor), 2);
}

/* What was read to judge reads differently when loaded: the other table then. */
static int n_reads_left;
static imucal_status fading_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  const imucal_status status = torn_nor_read(ctx, slot, offset, data, len);
  if (slot == 1 && offset == 0 && len == IMUCAL_TABLE_MAX_BYTES && n_reads_left-- <= 0) data[100] ^= 1;
  return status;
}
static void test_load_falls_back_when_the_ruling_slot_fades(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  imucal_flash_t flash = torn_nor_flash(&nor);
  flash.read = fading_read;
  n_reads_left = 1;
  imucal_table_t table;
  assert_int_equal(imucal_store_load(&flash, "SN-17", 3, &work, &table, &report), IMUCAL_OK);
  assert_int_equal(table.sequence, 1);
  assert_int_equal(report.ruling, 0);
  assert_int_equal(report.slot_status[1], IMUCAL_ERR_CRC);
}

/* A worn cell that does not take the new value must not be committed. */
static imucal_status stuck_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  imucal_status status = torn_nor_program(ctx, slot, offset, data, len);
  ((torn_nor_t*)ctx)->bytes[0][60] |= 0x10;
  return status;
}
static void test_write_stuck_cell_is_found_and_old_table_rules(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  imucal_flash_t flash = torn_nor_flash(&nor);
  flash.program = stuck_program;
  imucal_table_t table = example_table(3, 9);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report),
                   IMUCAL_ERR_VERIFY);
  assert_int_equal(ruling_mark(&nor), 2);
}

/* ---- what the marks of a slot say, to the byte (store.h: Slot) ---- */

static uint32_t mark_bytes(const torn_nor_t* nor) {
  return nor->geometry.unit_bytes < 8 ? 8 : nor->geometry.unit_bytes;
}
static uint8_t* mark_at(torn_nor_t* nor, uint32_t slot, uint32_t mark) {
  return nor->bytes[slot] + nor->geometry.slot_bytes - (mark + 1) * mark_bytes(nor);
}
static void put_mark(torn_nor_t* nor, uint32_t slot, uint32_t mark, uint32_t number) {
  imucal_put_u32(mark_at(nor, slot, mark), IMUCAL_STORE_COMMIT);
  imucal_put_u32(mark_at(nor, slot, mark) + 4, ~number);
}
static void put_table(torn_nor_t* nor, uint32_t slot, int n_channels, uint32_t sequence) {
  imucal_table_t table = example_table(n_channels, (int)sequence);
  size_t len = 0;
  table.sequence = sequence;
  assert_int_equal(imucal_table_encode(&table, nor->bytes[slot], IMUCAL_TABLE_MAX_BYTES, &len), IMUCAL_OK);
}
/* Is the mark as it was programmed: both words, erased bytes behind them? */
static void assert_mark(torn_nor_t* nor, uint32_t slot, uint32_t mark, uint32_t number) {
  uint8_t expected[IMUCAL_STORE_MAX_PROGRAM];
  memset(expected, 0xFF, sizeof expected);
  imucal_put_u32(expected, IMUCAL_STORE_COMMIT);
  imucal_put_u32(expected + 4, ~number);
  assert_memory_equal(mark_at(nor, slot, mark), expected, mark_bytes(nor));
}
static void assert_erased(const uint8_t* from, const uint8_t* to) {
  for (; from < to; from++) assert_int_equal(*from, 0xFF);
}

/* Slots of the least size, one unit below room for 17 marks, and with it: sizes of erasing as small as they may be. */
static const struct {
  torn_nor_geometry_t geometry;
  uint32_t n_commits, n_endorse;
} slots[] = {{{904, 8, 1}, 3, 1},     {{904, 8, 4}, 3, 1},     {{904, 8, 8}, 3, 1},    {{944, 16, 16}, 3, 1},
             {{1024, 32, 32}, 3, 1},  {{912, 8, 4}, 3, 2},     {{992, 8, 1}, 3, 12},   {{992, 8, 8}, 3, 12},
             {{1120, 16, 16}, 3, 12}, {{1376, 32, 32}, 3, 12}, {{1000, 8, 1}, 8, 8},   {{1000, 8, 2}, 8, 8},
             {{1000, 8, 8}, 8, 8},    {{1136, 16, 16}, 8, 8},  {{1408, 32, 32}, 8, 8}, {{4096, 1024, 4}, 8, 8}};
enum { N_SLOTS = sizeof slots / sizeof slots[0] };

static void test_marks_stand_where_the_header_says(void** state) {
  (void)state;
  for (int i = 0; i < N_SLOTS; i++) {
    torn_nor_t nor;
    torn_nor_init(&nor, slots[i].geometry);
    const uint32_t commits = slots[i].n_commits, size = slots[i].geometry.slot_bytes;
    assert_int_equal(write_mark(&nor, 1), IMUCAL_OK);
    assert_int_equal(write_mark(&nor, 2), IMUCAL_OK);
    assert_mark(&nor, 0, 0, 1);
    assert_mark(&nor, 0, 1, 1); /* before the other slot was erased */
    assert_mark(&nor, 1, 0, 2);
    assert_erased(nor.bytes[0] + IMUCAL_TABLE_BYTES(3), mark_at(&nor, 0, 1));
    assert_erased(nor.bytes[1] + IMUCAL_TABLE_BYTES(3), mark_at(&nor, 1, 0));
    assert_int_equal(roll_back(&nor), IMUCAL_OK);
    assert_mark(&nor, 1, commits, 2);
    assert_mark(&nor, 0, commits + 1, 2); /* endorse 0: numbers 1 apart */
    assert_erased(nor.bytes[0] + IMUCAL_TABLE_BYTES(3), mark_at(&nor, 0, commits + 1));
    assert_erased(mark_at(&nor, 0, commits), mark_at(&nor, 0, 1));
    assert_erased(nor.bytes[1] + IMUCAL_TABLE_BYTES(3), mark_at(&nor, 1, commits));
    assert_erased(nor.bytes[1] + size, nor.bytes[1] + TORN_NOR_MAX_SLOT_BYTES); /* nothing beyond the slot */
    assert_int_equal(nor.n_violations, 0);
  }
}

/* What fills the last unit of a table is erased bytes, also where a longer table was read before, or the work memory held
 * anything behind the longest. */
static void test_last_unit_of_a_table_is_filled_with_ones(void** state) {
  (void)state;
  static const torn_nor_geometry_t wide = {1024, 1024, 32};
  torn_nor_t nor;
  torn_nor_init(&nor, wide);
  put_table(&nor, 0, 3, 1), put_mark(&nor, 0, 0, 1);
  put_table(&nor, 1, 6, 2), put_mark(&nor, 1, 0, 2);
  assert_int_equal(write_mark(&nor, 3), IMUCAL_OK);
  assert_int_equal(report.ruling, 1);
  assert_erased(nor.bytes[1] + IMUCAL_TABLE_BYTES(3), mark_at(&nor, 1, 0));
  torn_nor_init(&nor, (torn_nor_geometry_t){4096, 1024, 16});
  imucal_flash_t flash = torn_nor_flash(&nor);
  imucal_table_t table = example_table(6, 1);
  memset(&work, 0xA5, sizeof work);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 6, 2, &work, &table, &report), IMUCAL_OK);
  for (uint32_t at = IMUCAL_TABLE_MAX_BYTES + 4; at < 896; at++) assert_int_equal(nor.bytes[0][at], 0xFF);
}

/* Each write takes a commit mark of the slot that stands, each rollback an endorse mark; with the commit marks used up the
 * number is the first that no endorse mark stands for. */
static void test_marks_used_up_number_goes_beyond_endorse_marks(void** state) {
  (void)state;
  for (int i = 0; i < N_SLOTS; i++) {
    torn_nor_t nor;
    torn_nor_init(&nor, slots[i].geometry);
    const uint32_t beyond = 1 + slots[i].n_endorse + 1;
    assert_int_equal(write_mark(&nor, 1), IMUCAL_OK);
    uint32_t number = 2;
    for (; number <= slots[i].n_commits && number < beyond; number++) {
      assert_int_equal(write_mark(&nor, (int)number), IMUCAL_OK);
      assert_int_equal(report.sequence[1], number);
      assert_int_equal(roll_back(&nor), IMUCAL_OK);
      assert_int_equal(report.ruling, 0);
    }
    assert_int_equal(write_mark(&nor, 50), IMUCAL_OK);
    assert_int_equal(report.sequence[1], beyond);
    assert_int_equal(roll_back(&nor), IMUCAL_ERR_NO_MARK);
    assert_int_equal(ruling_mark(&nor), 50);
    assert_int_equal(nor.n_violations, 0);
  }
}

/* One bit of a commit mark makes the slot "begun"; one of another mark does not. */
static void test_any_bit_of_a_commit_mark_is_a_sign_of_it(void** state) {
  (void)state;
  for (int i = 0; i < N_SLOTS; i++)
    for (uint32_t mark = 0; mark <= slots[i].n_commits + slots[i].n_endorse; mark++) {
      torn_nor_t nor;
      torn_nor_init(&nor, slots[i].geometry);
      for (uint32_t at = 0; at < mark_bytes(&nor); at++) {
        mark_at(&nor, 0, mark)[at] = (uint8_t) ~(1u << at % 8);
        assert_int_equal(ruling_mark(&nor), -1);
        assert_int_equal(report.slot_status[0], mark < slots[i].n_commits ? IMUCAL_ERR_COMMIT : IMUCAL_SLOT_EMPTY);
        mark_at(&nor, 0, mark)[at] = 0xFF;
      }
    }
}

static void test_one_exact_commit_mark_of_many_is_enough(void** state) {
  (void)state;
  for (uint32_t mark = 0; mark < IMUCAL_STORE_MAX_COMMITS; mark++) {
    torn_nor_t nor;
    torn_nor_init(&nor, small_pages);
    put_table(&nor, 0, 3, 5);
    put_mark(&nor, 0, mark, 5);
    assert_int_equal(ruling_mark(&nor), 5);
    if (mark + 1 < IMUCAL_STORE_MAX_COMMITS) mark_at(&nor, 0, mark + 1)[2] = 0x3F; /* begun, behind it or before it */
    if (mark > 0) mark_at(&nor, 0, mark - 1)[2] = 0x3F;
    assert_int_equal(ruling_mark(&nor), 5);
    mark_at(&nor, 0, mark)[0] ^= 1;
    assert_int_equal(ruling_mark(&nor), -1);
    assert_int_equal(report.slot_status[0], IMUCAL_ERR_COMMIT);
  }
}

/* An exact first word with the number erased is a mark caught by a cut. */
static void test_commit_mark_without_number_is_none(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  put_table(&nor, 0, 3, 5);
  put_mark(&nor, 0, 0, 0);
  assert_int_equal(ruling_mark(&nor), 5); /* number 0: a mark all the same */
  torn_nor_init(&nor, small_pages);
  put_table(&nor, 0, 3, 5);
  imucal_put_u32(mark_at(&nor, 0, 0), IMUCAL_STORE_COMMIT);
  memset(mark_at(&nor, 0, 0) + 4, 0, 4); /* NOT 2^32 - 1 */
  assert_int_equal(ruling_mark(&nor), -1);
  assert_int_equal(report.slot_status[0], IMUCAL_ERR_COMMIT);
}

/* The last of the bits counts as the first does. */
static void test_revoke_mark_counts_all_bits_of_its_first_word(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  imucal_put_u32(mark_at(&nor, 1, 8), ~0xE0000000u);
  assert_int_equal(ruling_mark(&nor), 2);
  imucal_put_u32(mark_at(&nor, 1, 8), ~0xE0000001u);
  assert_int_equal(ruling_mark(&nor), 1);
}

/* The bytes in front of the last endorse mark are the table's: whatever they are, they revoke nothing. */
static void test_table_reaching_up_to_the_marks_revokes_nothing(void** state) {
  (void)state;
  static const torn_nor_geometry_t tight = {1000, 8, 8};
  torn_nor_t nor;
  torn_nor_init(&nor, tight);
  put_table(&nor, 0, 6, 1), put_mark(&nor, 0, 0, 1);
  put_table(&nor, 1, 6, 1 + 8 + 1), put_mark(&nor, 1, 0, 1 + 8 + 1);
  memset(&report, 0, sizeof report);
  imucal_flash_t flash = torn_nor_flash(&nor);
  imucal_table_t table;
  assert_int_equal(imucal_store_load(&flash, "SN-17", 6, &work, &table, &report), IMUCAL_OK);
  assert_int_equal(table.sequence, 10);
}

static void test_equal_numbers_the_first_slot_rules(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  for (uint32_t slot = 0; slot < 2; slot++) put_table(&nor, slot, 3, 7), put_mark(&nor, slot, 0, 7);
  assert_int_equal(ruling_mark(&nor), 7);
  assert_int_equal(report.ruling, 0);
}

/* ---- the number of the next table ---- */

static uint32_t next_number(torn_nor_t* nor) {
  assert_int_equal(write_mark(nor, 50), IMUCAL_OK);
  assert_int_equal(ruling_mark(nor), 50);
  return report.sequence[report.ruling];
}

static void test_next_number_follows_what_a_commit_mark_noted(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  put_table(&nor, 0, 3, 5);
  put_mark(&nor, 0, 3, 9), put_mark(&nor, 0, 4, 6); /* slot 1, which had number 9, is erased */
  put_mark(&nor, 0, IMUCAL_STORE_MAX_MARKS, 100);   /* is no mark: one place too far */
  assert_int_equal(next_number(&nor), 10);
  assert_mark(&nor, 0, 0, 9); /* the first one that is not begun, though a later one is */
}

static void test_next_number_follows_a_table_that_was_revoked(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  put_table(&nor, 0, 3, 5), put_mark(&nor, 0, 0, 5);
  put_table(&nor, 1, 3, 9), put_mark(&nor, 1, 0, 9), put_mark(&nor, 1, 8, 9);
  assert_int_equal(next_number(&nor), 10);
  assert_mark(&nor, 0, 1, 9);
}

/* What a slot that is not valid noted is not believed. */
static void test_next_number_ignores_marks_of_a_damaged_slot(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  put_table(&nor, 0, 3, 5), put_mark(&nor, 0, 0, 5);
  put_table(&nor, 1, 3, 6), put_mark(&nor, 1, 0, 1000);
  nor.bytes[1][100] ^= 1;
  assert_int_equal(next_number(&nor), 6);
}

static void test_next_number_is_none_that_an_endorse_mark_stands_for(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  put_table(&nor, 0, 3, 1), put_mark(&nor, 0, 0, 1);
  for (uint32_t step = 0; step < 3; step++) mark_at(&nor, 0, 9 + step)[0] = 0; /* caught by a cut: they note nothing */
  assert_int_equal(next_number(&nor), 5);
}

/* ---- what is done, in which order; drivers that fail ---- */

static char done[32]; /* p: program of a mark, t: of a table, e: erase; and the slot */
static imucal_status listed_erase(void* ctx, uint32_t slot) {
  snprintf(done + strlen(done), sizeof done - strlen(done), "e%u ", (unsigned)slot);
  return torn_nor_erase(ctx, slot);
}
static imucal_status listed_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  snprintf(done + strlen(done), sizeof done - strlen(done), "%c%u ", offset == 0 ? 't' : 'p', (unsigned)slot);
  return torn_nor_program(ctx, slot, offset, data, len);
}
/* Marks fail: nothing of them takes. */
static imucal_status markless_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  return offset == 0 ? listed_program(ctx, slot, offset, data, len) : IMUCAL_OK;
}
/* Marks of slot 1 fail: a bit of them stays. */
static imucal_status smeared_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  const imucal_status status = listed_program(ctx, slot, offset, data, len);
  if (offset != 0 && slot == 1) ((torn_nor_t*)ctx)->bytes[slot][offset] |= 0x80;
  return status;
}
static imucal_flash_t listed_flash(torn_nor_t* nor) {
  imucal_flash_t flash = torn_nor_flash(nor);
  flash.erase = listed_erase, flash.program = listed_program;
  done[0] = 0;
  return flash;
}

static void test_erase_gives_the_ruling_slot_a_mark_and_goes_last_to_it(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  imucal_flash_t flash = listed_flash(&nor);
  assert_int_equal(imucal_store_erase(&flash, &work, &report), IMUCAL_OK);
  assert_true(strcmp(done, "e0 e1 ") == 0 || strcmp(done, "e1 e0 ") == 0); /* nothing to keep */
  assert_int_equal(write_mark(&nor, 1), IMUCAL_OK);
  flash = listed_flash(&nor);
  assert_int_equal(imucal_store_erase(&flash, &work, &report), IMUCAL_OK);
  assert_string_equal(done, "p0 e1 e0 ");
  prepare(&nor);
  flash = listed_flash(&nor);
  assert_int_equal(imucal_store_erase(&flash, &work, &report), IMUCAL_OK);
  assert_string_equal(done, "p1 e0 e1 ");
  assert_int_equal(report.slot_status[0], IMUCAL_SLOT_EMPTY);
}

static void test_erase_that_fails_tells_what_is_left(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  imucal_flash_t flash = listed_flash(&nor);
  flash.program = markless_program; /* slot 1 gets no mark: slot 0 must stay */
  assert_int_equal(imucal_store_erase(&flash, &work, &report), IMUCAL_ERR_VERIFY);
  assert_string_equal(done, "");
  assert_int_equal(report.ruling, 1);
  assert_int_equal(report.slot_status[0], IMUCAL_OK);
  assert_int_equal(report.slot_status[1], IMUCAL_OK);
  flash.program = smeared_program; /* every mark of slot 1 is begun: there is none to wait for */
  assert_int_equal(imucal_store_erase(&flash, &work, &report), IMUCAL_OK);
  assert_string_equal(done, "p1 p1 p1 p1 p1 p1 p1 e0 e1 ");
  assert_int_equal(report.ruling, -1);
}

static void test_write_without_a_mark_that_holds_leaves_the_other_slot(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  imucal_flash_t flash = listed_flash(&nor);
  flash.program = markless_program;
  imucal_table_t table = example_table(3, 3);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report),
                   IMUCAL_ERR_VERIFY);
  assert_string_equal(done, "");
  assert_int_equal(ruling_mark(&nor), 2);
  assert_int_equal(report.slot_status[0], IMUCAL_OK);
  flash.program = smeared_program; /* begun, all of them: goes on, beyond the endorse marks */
  table = example_table(3, 3);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report), IMUCAL_OK);
  assert_int_equal(table.sequence, 2 + 8 + 1);
  assert_int_equal(ruling_mark(&nor), 3);
}

/* The number of a mark may read back larger (programmed over one that was caught), not smaller. */
static uint8_t stuck_one, stuck_zero;
static imucal_status stuck_number_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data,
                                          uint32_t len) {
  const imucal_status status = torn_nor_program(ctx, slot, offset, data, len);
  uint8_t* number = ((torn_nor_t*)ctx)->bytes[slot] + offset + 4;
  if (offset != 0 && slot == 0) *number = (uint8_t)((*number | stuck_one) & ~stuck_zero);
  return status;
}
static void test_mark_with_another_number_read_back_is_found(void** state) {
  (void)state;
  for (int is_larger = 0; is_larger <= 1; is_larger++) {
    torn_nor_t nor;
    prepare(&nor);
    imucal_flash_t flash = torn_nor_flash(&nor);
    flash.program = stuck_number_program;
    stuck_one = is_larger ? 0 : 1, stuck_zero = is_larger ? 4 : 0; /* of 3, stored as its complement: 2, or 7 */
    imucal_table_t table = example_table(3, 3);
    assert_int_equal(imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report),
                     is_larger ? IMUCAL_OK : IMUCAL_ERR_VERIFY);
  }
}

static void test_write_that_failed_says_which_slot_is_lost(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  nor.fail_how = TORN_NOR_REPORTS_FAILURE;
  imucal_flash_t flash = torn_nor_flash(&nor);
  flash.program = stuck_program;
  imucal_table_t table = example_table(3, 9);
  table.sequence = 0; /* is set by write */
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, IMUCAL_STORE_NO_ORIGIN, &work, &table, &report),
                   IMUCAL_ERR_VERIFY);
  assert_int_equal(report.slot_status[0], IMUCAL_ERR_VERIFY);
  assert_int_equal(report.sequence[0], 0);
  assert_int_equal(report.ruling, 1);
}

/* Marks that read back as they should and fade then: rollback must not say done. */
static int n_programs, n_reads_after;
static imucal_status counted_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  n_programs++, n_reads_after = 0;
  return torn_nor_program(ctx, slot, offset, data, len);
}
static imucal_status fading_mark_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  const imucal_status status = torn_nor_read(ctx, slot, offset, data, len);
  if (n_programs == 2 && n_reads_after++ > 0 && offset <= SLOT_BYTES - 9 * 8 && offset > IMUCAL_TABLE_MAX_BYTES)
    memset(data, 0xFF, len); /* revoke and endorse marks */
  return status;
}
static void test_rollback_whose_marks_fade_says_so(void** state) {
  (void)state;
  torn_nor_t nor;
  prepare(&nor);
  imucal_flash_t flash = torn_nor_flash(&nor);
  flash.program = counted_program, flash.read = fading_mark_read;
  n_programs = 0;
  imucal_table_t table;
  assert_int_equal(imucal_store_rollback(&flash, "SN-17", 3, &work, &table, &report), IMUCAL_ERR_VERIFY);
  assert_int_equal(report.ruling, 1);
}

/* ---- the origin ---- */

static imucal_status write_from(torn_nor_t* nor, int n_channels, int mark, uint8_t origin) {
  const imucal_flash_t flash = torn_nor_flash(nor);
  imucal_table_t table = example_table(n_channels, mark);
  return imucal_store_write(&flash, "SN-17", (uint32_t)n_channels, origin, &work, &table, &report);
}

/* As after a start: from what flash holds. */
static imucal_store_origin_t origin_after_start(torn_nor_t* nor, int n_channels) {
  const imucal_flash_t flash = torn_nor_flash(nor);
  imucal_table_t table;
  torn_nor_power_on(nor);
  memset(&report, 0, sizeof report);
  const imucal_status status = imucal_store_load(&flash, "SN-17", (uint32_t)n_channels, &work, &table, &report);
  assert_true(status == IMUCAL_OK || status == IMUCAL_ERR_NO_TABLE);
  nor->n_reads = 0;
  const imucal_store_origin_t origin = imucal_store_origin(&flash, &report, (uint32_t)n_channels);
  assert_true(nor->n_reads <= 13);
  return origin;
}

static void test_origin_is_known_after_a_start_wherever_there_is_room(void** state) {
  (void)state;
  static const struct {
    torn_nor_geometry_t geometry;
    int n_channels, has_room;
  } cases[] = {{{1024, 1024, 4}, 6, 1},  {{1024, 512, 1}, 6, 1},   {{2048, 2048, 8}, 6, 1},  {{4096, 1024, 16}, 6, 1},
               {{1024, 1024, 32}, 3, 1}, {{1024, 1024, 32}, 6, 0}, {{1024, 1024, 16}, 6, 0}, {{904, 904, 4}, 6, 0},
               {{904, 904, 4}, 5, 1},    {{1000, 8, 8}, 6, 0},     {{1008, 8, 8}, 6, 1}};
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    torn_nor_t nor;
    torn_nor_init(&nor, cases[i].geometry);
    for (int mark = 1; mark <= 4; mark++) {
      const uint8_t origin = mark == 4 ? 255 : (uint8_t)mark;
      assert_int_equal(write_from(&nor, cases[i].n_channels, mark, origin), IMUCAL_OK);
      const imucal_store_origin_t found = origin_after_start(&nor, cases[i].n_channels);
      assert_int_equal(found.noted, cases[i].has_room ? origin : IMUCAL_STORE_NO_ORIGIN);
      assert_false(found.is_restored);
    }
    assert_int_equal(nor.n_violations, 0);
  }
}

static void test_origin_of_no_table_and_of_an_old_one_is_not_noted(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  assert_int_equal(origin_after_start(&nor, 3).noted, IMUCAL_STORE_NO_ORIGIN);
  put_table(&nor, 1, 3, 7), put_mark(&nor, 1, 0, 7); /* as it was written before origins were */
  assert_int_equal(origin_after_start(&nor, 3).noted, IMUCAL_STORE_NO_ORIGIN);
  assert_int_equal(report.ruling, 1);
  assert_int_equal(write_from(&nor, 3, 8, 2), IMUCAL_OK);
  assert_int_equal(origin_after_start(&nor, 3).noted, 2);
  assert_int_equal(roll_back(&nor), IMUCAL_OK);
  const imucal_store_origin_t old = origin_after_start(&nor, 3);
  assert_int_equal(old.noted, IMUCAL_STORE_NO_ORIGIN);
  assert_true(old.is_restored);
}

/* The word as table.md has it; any bit of it flipped at rest: not noted, and the table rules as before. */
static void test_origin_stands_behind_the_table_and_a_flipped_bit_makes_it_unknown(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  assert_int_equal(write_from(&nor, 3, 1, 3), IMUCAL_OK);
  uint8_t* word = nor.bytes[report.ruling] + IMUCAL_TABLE_BYTES(3);
  static const uint8_t expected[] = {3, 0xFC, 0x52, 0x4F, 0xFF};
  assert_memory_equal(word, expected, sizeof expected);
  for (int bit = 0; bit < 32; bit++) {
    word[bit / 8] ^= (uint8_t)(1 << bit % 8);
    assert_int_equal(origin_after_start(&nor, 3).noted, IMUCAL_STORE_NO_ORIGIN);
    assert_true(report.ruling >= 0);
    word[bit / 8] ^= (uint8_t)(1 << bit % 8);
  }
  assert_int_equal(origin_after_start(&nor, 3).noted, 3);
}

static imucal_status unreadable_word_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  return offset == IMUCAL_TABLE_BYTES(3) && len == 4 ? IMUCAL_ERR_FLASH : torn_nor_read(ctx, slot, offset, data, len);
}
static void test_origin_that_cannot_be_read_is_not_noted(void** state) {
  (void)state;
  torn_nor_t nor;
  torn_nor_init(&nor, small_pages);
  assert_int_equal(write_from(&nor, 3, 1, 3), IMUCAL_OK);
  imucal_flash_t flash = torn_nor_flash(&nor);
  assert_int_equal(imucal_store_origin(&flash, &report, 3).noted, 3);
  assert_int_equal(imucal_store_origin(&flash, &report, IMUCAL_MAX_CHANNELS + 1).noted, IMUCAL_STORE_NO_ORIGIN);
  flash.read = unreadable_word_read;
  assert_int_equal(imucal_store_origin(&flash, &report, 3).noted, IMUCAL_STORE_NO_ORIGIN);
}

/* Which endorse mark says it depends on the difference of the sequence numbers; any of them does. */
static void test_origin_restored_is_said_by_any_endorse_mark(void** state) {
  (void)state;
  for (uint32_t step = 1; step <= 8; step++) {
    torn_nor_t nor;
    torn_nor_init(&nor, small_pages);
    put_table(&nor, 0, 3, 1), put_mark(&nor, 0, 0, 1);
    put_table(&nor, 1, 3, 1 + step), put_mark(&nor, 1, 0, 1 + step);
    assert_false(origin_after_start(&nor, 3).is_restored);
    assert_int_equal(roll_back(&nor), IMUCAL_OK);
    assert_true(origin_after_start(&nor, 3).is_restored);
    assert_int_equal(report.ruling, 0);
  }
}

/* Gone back to, and a write over the revoked table cut at any step: restored still, or the new table and its origin. */
static void test_origin_restored_outlives_a_write_that_is_cut(void** state) {
  (void)state;
  static torn_nor_t start, nor;
  torn_nor_init(&start, small_pages);
  assert_int_equal(write_from(&start, 3, 1, 2), IMUCAL_OK);
  assert_int_equal(write_from(&start, 3, 2, 3), IMUCAL_OK);
  assert_int_equal(roll_back(&start), IMUCAL_OK);
  int n_old = 0, n_new = 0;
  for (long step = 0;; step++) {
    nor = start;
    nor.steps_left = step, nor.pattern = TORN_NOR_MIXED, nor.random = (uint64_t)step;
    const int was_cut = write_from(&nor, 3, 3, 3) != IMUCAL_OK;
    const imucal_store_origin_t origin = origin_after_start(&nor, 3);
    const int is_new = report.sequence[report.ruling] == 3;
    assert_int_equal(origin.noted, is_new ? 3 : 2);
    assert_int_equal(origin.is_restored, !is_new);
    n_old += !is_new, n_new += is_new;
    if (!was_cut) break;
  }
  assert_true(n_old > 100);
  assert_true(n_new >= 1);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_origin_is_known_after_a_start_wherever_there_is_room),
      cmocka_unit_test(test_origin_of_no_table_and_of_an_old_one_is_not_noted),
      cmocka_unit_test(test_origin_stands_behind_the_table_and_a_flipped_bit_makes_it_unknown),
      cmocka_unit_test(test_origin_restored_outlives_a_write_that_is_cut),
      cmocka_unit_test(test_origin_that_cannot_be_read_is_not_noted),
      cmocka_unit_test(test_origin_restored_is_said_by_any_endorse_mark),
      cmocka_unit_test(test_empty_flash_has_no_table),
      cmocka_unit_test(test_write_alternates_slots_and_counts_up),
      cmocka_unit_test(test_rollback_goes_back_once_and_a_new_write_rules_again),
      cmocka_unit_test(test_erase_leaves_nothing),
      cmocka_unit_test(test_write_tells_that_an_erase_takes_the_other_slot),
      cmocka_unit_test(test_first_write_tells_that_slots_share_an_address),
      cmocka_unit_test(test_load_tells_why_slots_are_refused),
      cmocka_unit_test(test_write_refuses_bad_tables_and_leaves_flash_alone),
      cmocka_unit_test(test_write_stuck_cell_is_found_and_old_table_rules),
      cmocka_unit_test(test_sizes_of_flash_out_of_range_are_refused),
      cmocka_unit_test(test_sequence_numbers_used_up_are_refused),
      cmocka_unit_test(test_rollback_without_a_mark_left_is_refused),
      cmocka_unit_test(test_rollback_over_a_begun_mark_is_refused),
      cmocka_unit_test(test_rollback_that_did_not_take_says_so),
      cmocka_unit_test(test_write_erase_that_did_nothing_is_found),
      cmocka_unit_test(test_write_commit_that_did_nothing_is_found),
      cmocka_unit_test(test_load_falls_back_when_the_ruling_slot_fades),
      cmocka_unit_test(test_marks_stand_where_the_header_says),
      cmocka_unit_test(test_last_unit_of_a_table_is_filled_with_ones),
      cmocka_unit_test(test_marks_used_up_number_goes_beyond_endorse_marks),
      cmocka_unit_test(test_any_bit_of_a_commit_mark_is_a_sign_of_it),
      cmocka_unit_test(test_one_exact_commit_mark_of_many_is_enough),
      cmocka_unit_test(test_commit_mark_without_number_is_none),
      cmocka_unit_test(test_revoke_mark_counts_all_bits_of_its_first_word),
      cmocka_unit_test(test_table_reaching_up_to_the_marks_revokes_nothing),
      cmocka_unit_test(test_equal_numbers_the_first_slot_rules),
      cmocka_unit_test(test_next_number_follows_what_a_commit_mark_noted),
      cmocka_unit_test(test_next_number_follows_a_table_that_was_revoked),
      cmocka_unit_test(test_next_number_ignores_marks_of_a_damaged_slot),
      cmocka_unit_test(test_next_number_is_none_that_an_endorse_mark_stands_for),
      cmocka_unit_test(test_erase_gives_the_ruling_slot_a_mark_and_goes_last_to_it),
      cmocka_unit_test(test_erase_that_fails_tells_what_is_left),
      cmocka_unit_test(test_write_without_a_mark_that_holds_leaves_the_other_slot),
      cmocka_unit_test(test_mark_with_another_number_read_back_is_found),
      cmocka_unit_test(test_write_that_failed_says_which_slot_is_lost),
      cmocka_unit_test(test_rollback_whose_marks_fade_says_so),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
