// SPDX-License-Identifier: MIT
// store: what each operation does; foreign and damaged slots; sizes of flash; and the short form of `make torn`: power cut
// at every unit of every operation, a driver that fails at any call.  Always the old or the new table rules.
#include "unit.h"

#include "num.h"
#include "store.h"
#include "table_example.h"

#include "emu/nor.h"
#include "torn/torn.h"

#define SLOT_BYTES 1024u
static const nor_geometry_t small_pages = {SLOT_BYTES, SLOT_BYTES, 4};

static imucal_store_work_t work;
static imucal_store_report_t report;

/* The ruling table's mark, or -1. */
static int ruling_mark(nor_t* nor) {
  imucal_flash_t flash = nor_flash(nor);
  imucal_table_t table;
  imucal_status status = imucal_store_load(&flash, "SN-17", 3, &work, &table, &report);
  if (status == IMUCAL_ERR_NO_TABLE) return -1;
  assert_int_equal(status, IMUCAL_OK);
  imucal_table_t expected = example_table(3, (int)(table.created_s - 1767225600u));
  expected.sequence = table.sequence;
  assert_memory_equal(&table, &expected, sizeof table); /* whole, never a mixture */
  return (int)(table.created_s - 1767225600u);
}

static imucal_status write_mark(nor_t* nor, int mark) {
  imucal_flash_t flash = nor_flash(nor);
  imucal_table_t table = example_table(3, mark);
  return imucal_store_write(&flash, "SN-17", 3, &work, &table, &report);
}

static imucal_status roll_back(nor_t* nor) {
  imucal_flash_t flash = nor_flash(nor);
  imucal_table_t table;
  return imucal_store_rollback(&flash, "SN-17", 3, &work, &table, &report);
}

static imucal_status erase_all(nor_t* nor) {
  imucal_flash_t flash = nor_flash(nor);
  return imucal_store_erase(&flash, &work, &report);
}

static void test_empty_flash_has_no_table(void** state) {
  (void)state;
  nor_t nor;
  nor_init(&nor, small_pages);
  assert_int_equal(ruling_mark(&nor), -1);
  assert_int_equal(report.slot_status[0], IMUCAL_SLOT_EMPTY);
  assert_int_equal(report.slot_status[1], IMUCAL_SLOT_EMPTY);
  assert_int_equal(report.ruling, -1);
  assert_int_equal(roll_back(&nor), IMUCAL_ERR_NO_TABLE);
}

static void test_write_alternates_slots_and_counts_up(void** state) {
  (void)state;
  nor_t nor;
  nor_init(&nor, small_pages);
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
  nor_t nor;
  nor_init(&nor, small_pages);
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
  nor_t nor;
  nor_init(&nor, small_pages);
  assert_int_equal(write_mark(&nor, 1), IMUCAL_OK);
  assert_int_equal(write_mark(&nor, 2), IMUCAL_OK);
  assert_int_equal(erase_all(&nor), IMUCAL_OK);
  assert_int_equal(ruling_mark(&nor), -1);
  assert_int_equal(report.slot_status[0], IMUCAL_SLOT_EMPTY);
  assert_int_equal(report.slot_status[1], IMUCAL_SLOT_EMPTY);
}

/* Marks 1 and 2 written: 2 rules in slot 1. */
static void prepare(nor_t* nor) {
  nor_init(nor, small_pages);
  assert_int_equal(write_mark(nor, 1), IMUCAL_OK);
  assert_int_equal(write_mark(nor, 2), IMUCAL_OK);
}

static void test_load_tells_why_slots_are_refused(void** state) {
  (void)state;
  nor_t nor;
  imucal_table_t table;
  prepare(&nor);
  imucal_flash_t flash = nor_flash(&nor);
  assert_int_equal(imucal_store_load(&flash, "SN-18", 3, &work, &table, &report), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(report.slot_status[0], IMUCAL_ERR_SERIAL);
  assert_int_equal(imucal_store_load(&flash, "SN-17", 6, &work, &table, &report), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(report.slot_status[1], IMUCAL_ERR_CHANNELS);
  assert_int_equal(imucal_store_load(&flash, NULL, 0, &work, &table, &report), IMUCAL_OK);
  for (int n_bits = 1; n_bits <= 8; n_bits++) { /* four bits of a revoke mark revoke, three that flipped do not */
    nor_t torn = nor;
    torn.bytes[1][SLOT_BYTES - 9 * 8] = (uint8_t)(0xFF << n_bits);
    assert_int_equal(ruling_mark(&torn), n_bits < 4 ? 2 : 1);
    assert_int_equal(report.slot_status[1], n_bits < 4 ? IMUCAL_OK : IMUCAL_SLOT_REVOKED);
  }
  for (int n_bits = 1; n_bits <= 8; n_bits++) { /* and of the endorse mark in the older slot */
    nor_t torn = nor;
    torn.bytes[0][SLOT_BYTES - 10 * 8] = (uint8_t)(0xFF << n_bits);
    assert_int_equal(ruling_mark(&torn), n_bits < 4 ? 2 : 1);
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
  nor_t nor, before;
  prepare(&nor);
  before = nor;
  imucal_flash_t flash = nor_flash(&nor);
  imucal_table_t table = example_table(3, 9);
  strcpy(table.serial, "OTHER");
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, &work, &table, &report), IMUCAL_ERR_SERIAL);
  table = example_table(2, 9);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, &work, &table, &report), IMUCAL_ERR_CHANNELS);
  table = example_table(3, 9);
  table.channel[1].coeff[0] = (float)NAN;
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, &work, &table, &report), IMUCAL_ERR_COEFFICIENT);
  assert_memory_equal(nor.bytes, before.bytes, sizeof nor.bytes);
}

static imucal_status load_with(nor_t* nor, uint32_t slot_bytes, uint32_t erase_bytes, uint32_t program_bytes) {
  imucal_flash_t flash = nor_flash(nor);
  flash.slot_bytes = slot_bytes, flash.erase_bytes = erase_bytes, flash.program_bytes = program_bytes;
  imucal_table_t table;
  const imucal_status status = imucal_store_load(&flash, "SN-17", 3, &work, &table, &report);
  if (status != IMUCAL_ERR_ARGUMENT) return status;
  table = example_table(3, 1);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, &work, &table, &report), status);
  assert_int_equal(imucal_store_rollback(&flash, "SN-17", 3, &work, &table, &report), status);
  assert_int_equal(imucal_store_erase(&flash, &work, &report), status);
  return status;
}
static void test_sizes_of_flash_out_of_range_are_refused(void** state) {
  (void)state;
  nor_t nor;
  nor_init(&nor, small_pages);
  assert_int_equal(load_with(&nor, 904, 8, 8), IMUCAL_ERR_NO_TABLE); /* 864 + 5 marks of 8 */
  assert_int_equal(load_with(&nor, 896, 8, 8), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(load_with(&nor, 1024, 1024, 32), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(load_with(&nor, 992, 32, 32), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(load_with(&nor, 1024, 1024, 64), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(load_with(&nor, 1024, 1024, 3), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(load_with(&nor, 1024, 1024, 0), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(load_with(&nor, 1024, 0, 4), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(load_with(&nor, 1024, 300, 4), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(load_with(&nor, 1024, 16, 32), IMUCAL_ERR_ARGUMENT);
}

/* The newest number there is any trace of is used up: refused, flash untouched; erasing starts anew. */
static void test_sequence_numbers_used_up_are_refused(void** state) {
  (void)state;
  nor_t nor;
  nor_init(&nor, small_pages);
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
  nor_t nor;
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

/* A revoke or endorse mark that does not take: rollback must not say done. */
static void test_rollback_that_did_not_take_says_so(void** state) {
  (void)state;
  for (int call = 1; call <= 2; call++) {
    nor_t nor;
    prepare(&nor);
    nor.fail_how = NOR_DOES_NOTHING, nor.fail_at_call = call, nor.n_calls = 0;
    assert_int_equal(roll_back(&nor), IMUCAL_ERR_VERIFY);
    nor.fail_at_call = 0;
    assert_int_equal(ruling_mark(&nor), call == 1 ? 2 : 1);
  }
}

/* The slot to write does not take its erase: nothing is programmed over it. */
static void test_write_erase_that_did_nothing_is_found(void** state) {
  (void)state;
  nor_t nor;
  prepare(&nor);
  nor.fail_how = NOR_DOES_NOTHING, nor.fail_at_call = 2, nor.n_calls = 0; /* mark, erase */
  assert_int_equal(write_mark(&nor, 3), IMUCAL_ERR_VERIFY);
  assert_int_equal(nor.n_violations, 0);
  assert_int_equal(ruling_mark(&nor), 2);
}

/* A commit mark that did not take: not done. */
static void test_write_commit_that_did_nothing_is_found(void** state) {
  (void)state;
  nor_t nor;
  prepare(&nor);
  nor.fail_how = NOR_DOES_NOTHING, nor.fail_at_call = 4, nor.n_calls = 0; /* mark, erase, table, mark */
  assert_int_equal(write_mark(&nor, 3), IMUCAL_ERR_VERIFY);
  nor.fail_at_call = 0;
  assert_int_equal(ruling_mark(&nor), 2);
}

/* What was read to judge reads differently when loaded: the other table then. */
static int n_reads_left;
static imucal_status fading_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  const imucal_status status = nor_read(ctx, slot, offset, data, len);
  if (slot == 1 && offset == 0 && len == IMUCAL_TABLE_MAX_BYTES && n_reads_left-- <= 0) data[100] ^= 1;
  return status;
}
static void test_load_falls_back_when_the_ruling_slot_fades(void** state) {
  (void)state;
  nor_t nor;
  prepare(&nor);
  imucal_flash_t flash = nor_flash(&nor);
  flash.read = fading_read;
  n_reads_left = 1;
  imucal_table_t table;
  assert_int_equal(imucal_store_load(&flash, "SN-17", 3, &work, &table, &report), IMUCAL_OK);
  assert_int_equal(table.sequence, 1);
  assert_int_equal(report.ruling, 0);
  assert_int_equal(report.slot_status[1], IMUCAL_ERR_CRC);
}

/* ---- the short form of make torn; not where IMUCAL_NO_TORN=1 asks for the unit tests alone (make mutate) ---- */

static void skip_without_torn(void) {
  const char* asked = getenv("IMUCAL_NO_TORN");
  if (asked != NULL && strcmp(asked, "1") == 0) skip();
}

static void test_cut_at_every_unit_old_or_new_table_rules(void** state) {
  (void)state;
  skip_without_torn();
  static torn_state_t start;
  static const int patterns[] = {NOR_ALL_WAVER, NOR_MIXED};
  torn_counts_t counts = {0};
  for (int g = 0; g < TORN_GEOMETRIES; g++)
    for (int mode = 0; mode < NOR_MODES; mode++)
      for (int s = 0; s < TORN_STARTS; s++) {
        torn_path_t path = {.seed = unit_seed(), .geometry = g, .mode = mode, .channels = 1, .start = s};
        torn_start(&start, &path);
        torn_everywhere(&start, &path, 1, patterns, 2, &counts);
      }
  assert_true(torn_n_cuts(&counts, 0) > 10000);
  assert_int_equal(torn_n_failures(&counts), 0);
}

static void test_cut_three_times_in_a_row_old_or_new_table_rules(void** state) {
  (void)state;
  skip_without_torn();
  torn_counts_t counts = {0};
  const int n_cuts = unit_repeats(3000);
  torn_sample(unit_seed(), (uint64_t)n_cuts, 1, &counts);
  assert_int_equal(torn_n_cuts(&counts, 2), n_cuts);
  assert_int_equal(torn_n_failures(&counts), 0);
}

static void test_bits_flipped_at_rest_never_make_a_table(void** state) {
  (void)state;
  skip_without_torn();
  torn_counts_t counts = {0};
  torn_flips(unit_seed(), 2, &counts);
  assert_int_equal(torn_n_failures(&counts), 0);
}

static void test_driver_fails_at_any_call_done_only_where_it_is(void** state) {
  (void)state;
  skip_without_torn();
  torn_counts_t counts = {0};
  uint64_t n_failed_calls = 0;
  torn_failures(unit_seed(), &counts, &n_failed_calls);
  assert_true(n_failed_calls > 5000);
  assert_int_equal(torn_n_failures(&counts), 0);
}

/* A worn cell that does not take the new value must not be committed. */
static imucal_status stuck_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  imucal_status status = nor_program(ctx, slot, offset, data, len);
  ((nor_t*)ctx)->bytes[0][60] |= 0x10;
  return status;
}
static void test_write_stuck_cell_is_found_and_old_table_rules(void** state) {
  (void)state;
  nor_t nor;
  prepare(&nor);
  imucal_flash_t flash = nor_flash(&nor);
  flash.program = stuck_program;
  imucal_table_t table = example_table(3, 9);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, &work, &table, &report), IMUCAL_ERR_VERIFY);
  assert_int_equal(ruling_mark(&nor), 2);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_empty_flash_has_no_table),
      cmocka_unit_test(test_write_alternates_slots_and_counts_up),
      cmocka_unit_test(test_rollback_goes_back_once_and_a_new_write_rules_again),
      cmocka_unit_test(test_erase_leaves_nothing),
      cmocka_unit_test(test_load_tells_why_slots_are_refused),
      cmocka_unit_test(test_write_refuses_bad_tables_and_leaves_flash_alone),
      cmocka_unit_test(test_write_stuck_cell_is_found_and_old_table_rules),
      cmocka_unit_test(test_sizes_of_flash_out_of_range_are_refused),
      cmocka_unit_test(test_sequence_numbers_used_up_are_refused),
      cmocka_unit_test(test_rollback_without_a_mark_left_is_refused),
      cmocka_unit_test(test_rollback_that_did_not_take_says_so),
      cmocka_unit_test(test_write_erase_that_did_nothing_is_found),
      cmocka_unit_test(test_write_commit_that_did_nothing_is_found),
      cmocka_unit_test(test_load_falls_back_when_the_ruling_slot_fades),
      cmocka_unit_test(test_cut_at_every_unit_old_or_new_table_rules),
      cmocka_unit_test(test_cut_three_times_in_a_row_old_or_new_table_rules),
      cmocka_unit_test(test_bits_flipped_at_rest_never_make_a_table),
      cmocka_unit_test(test_driver_fails_at_any_call_done_only_where_it_is),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
