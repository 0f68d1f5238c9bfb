// SPDX-License-Identifier: MIT
// store: power cut at every byte of every operation of write, rollback and erase, then again from the cut state, twice;
// a driver that fails at any call; foreign, torn and damaged slots.  Always the old or the new table rules.
#include "unit.h"

#include "num.h"
#include "store.h"
#include "table_example.h"

#include "emu/nor.h"

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
  nor_init(&nor);
  assert_int_equal(ruling_mark(&nor), -1);
  assert_int_equal(report.slot_status[0], IMUCAL_SLOT_EMPTY);
  assert_int_equal(report.slot_status[1], IMUCAL_SLOT_EMPTY);
  assert_int_equal(report.ruling, -1);
  assert_int_equal(roll_back(&nor), IMUCAL_ERR_NO_TABLE);
}

static void test_write_alternates_slots_and_counts_up(void** state) {
  (void)state;
  nor_t nor;
  nor_init(&nor);
  for (int mark = 1; mark <= 20; mark++) {
    assert_int_equal(write_mark(&nor, mark), IMUCAL_OK);
    assert_int_equal(report.ruling, (mark + 1) % 2);
    assert_int_equal(ruling_mark(&nor), mark);
    assert_int_equal(report.sequence[report.ruling], mark);
  }
  assert_int_equal(nor.n_erase[0], 10);
  assert_int_equal(nor.n_erase[1], 10); /* wear is shared */
  assert_int_equal(nor.n_violations, 0);
}

static void test_rollback_goes_back_once_and_a_new_write_rules_again(void** state) {
  (void)state;
  nor_t nor;
  nor_init(&nor);
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
  nor_init(&nor);
  assert_int_equal(write_mark(&nor, 1), IMUCAL_OK);
  assert_int_equal(write_mark(&nor, 2), IMUCAL_OK);
  assert_int_equal(erase_all(&nor), IMUCAL_OK);
  assert_int_equal(ruling_mark(&nor), -1);
  assert_int_equal(report.slot_status[0], IMUCAL_SLOT_EMPTY);
  assert_int_equal(report.slot_status[1], IMUCAL_SLOT_EMPTY);
}

/* GIVEN: marks 1 and 2 written, 2 rules; or 2 rolled back (1 rules); or nothing. */
static void prepare(nor_t* nor, int given) {
  nor_init(nor);
  if (given == 0) return;
  assert_int_equal(write_mark(nor, 1), IMUCAL_OK);
  assert_int_equal(write_mark(nor, 2), IMUCAL_OK);
  if (given == 2) assert_int_equal(roll_back(nor), IMUCAL_OK);
}

static imucal_status act(nor_t* nor, int action, int mark) {
  return action == 0 ? write_mark(nor, mark) : action == 1 ? roll_back(nor) : erase_all(nor);
}

/* Rules after a cut: what ruled before, or what the finished action leaves. */
static void expect_old_or_new(nor_t* nor, int old, int new, const char* what, long step) {
  nor_power_on(nor);
  int mark = ruling_mark(nor);
  if (mark != old && mark != new)
    fail_msg("%s cut at byte %ld (order %d, torn 0x%02x): table %d rules, not %d or %d", what, step, nor->order,
             nor->torn_bits, mark, old, new);
}

static void test_power_cut_at_every_byte_old_or_new_table_rules(void** state) {
  (void)state;
  static const char* const names[] = {"write", "rollback", "erase"};
  const uint8_t torn[] = {0x00, 0x5A, 0xFF};
  for (int given = 0; given <= 2; given++)
    for (int action = 0; action <= 2; action++) {
      if (action == 1 && given != 1) continue; /* nothing to go back to */
      nor_t whole, nor;
      prepare(&whole, given);
      int old = ruling_mark(&whole);
      nor_power_on(&whole);
      assert_int_equal(act(&whole, action, 9), IMUCAL_OK);
      long n_steps = whole.steps_used;
      int new = ruling_mark(&whole);
      assert_int_equal(new, action == 0 ? 9 : action == 1 ? 1 : -1);
      for (int order = 0; order <= 2; order++)
        for (int k = 0; k < 3; k++)
          for (long step = 0; step < n_steps; step++) {
            prepare(&nor, given);
            nor.order = order;
            nor.torn_bits = torn[k];
            nor_power_on(&nor);
            nor.steps_left = step;
            assert_int_not_equal(act(&nor, action, 9), IMUCAL_OK);
            /* erasing the ruling slot is the one action that may leave neither */
            expect_old_or_new(&nor, old, new, names[action], step);
            /* and a write from the cut state succeeds */
            if (step % 37 == 0) {
              assert_int_equal(write_mark(&nor, 7), IMUCAL_OK);
              assert_int_equal(ruling_mark(&nor), 7);
            }
            if (nor.n_violations) fail_msg("%s at %ld: %s", names[action], step, nor.violation);
          }
    }
}

/* Cut, try again and cut again, and once more: still old or new; then a write to the end succeeds. */
static void test_power_cut_three_times_in_a_row_old_or_new_table_rules(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (int run = 0; run < 4000; run++) {
    nor_t nor;
    int given = (int)unit_integer(&rng, 0, 2);
    prepare(&nor, given);
    int rules = ruling_mark(&nor);
    for (int cut = 0; cut < 3; cut++) {
      nor_power_on(&nor);
      nor.order = (int)unit_integer(&rng, 0, 2);
      nor.torn_bits = (uint8_t)unit_bits(&rng);
      nor.steps_left = unit_integer(&rng, 0, 2600);
      int is_rollback = rules > 0 && unit_integer(&rng, 0, 3) == 0;
      int mark = 10 + cut;
      imucal_status status = is_rollback ? roll_back(&nor) : write_mark(&nor, mark);
      int before = rules;
      nor_power_on(&nor);
      rules = ruling_mark(&nor);
      if (is_rollback) {
        if (status == IMUCAL_ERR_NO_OTHER) assert_int_equal(rules, before);
        assert_true(rules > 0); /* never a rollback into nothing */
      } else if (rules != before && rules != mark) {
        fail_msg("run %d cut %d: %d rules after %d, writing %d", run, cut, rules, before, mark);
      }
      if (!is_rollback && status == IMUCAL_OK) assert_int_equal(rules, mark);
    }
    nor_power_on(&nor);
    assert_int_equal(write_mark(&nor, 99), IMUCAL_OK);
    assert_int_equal(ruling_mark(&nor), 99);
    if (nor.n_violations) fail_msg("%s", nor.violation);
  }
}

static void test_driver_fails_at_any_call_old_or_new_table_rules(void** state) {
  (void)state;
  for (int action = 0; action <= 2; action++)
    for (int call = 1; call < 100; call++) {
      nor_t nor;
      prepare(&nor, 1);
      nor.n_calls = 0;
      nor.fail_at_call = call;
      imucal_status status = act(&nor, action, 9);
      int was_reached = nor.n_calls >= call;
      nor.fail_at_call = 0;
      int mark = ruling_mark(&nor);
      if (status == IMUCAL_OK) assert_int_equal(mark, action == 0 ? 9 : action == 1 ? 1 : -1);
      else if (action != 2) assert_true(mark == 2 || mark == (action == 0 ? 9 : 1));
      if (!was_reached) break;
    }
}

static void test_load_tells_why_slots_are_refused(void** state) {
  (void)state;
  nor_t nor;
  imucal_table_t table;
  prepare(&nor, 1);
  imucal_flash_t flash = nor_flash(&nor);
  assert_int_equal(imucal_store_load(&flash, "SN-18", 3, &work, &table, &report), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(report.slot_status[0], IMUCAL_ERR_SERIAL);
  assert_int_equal(imucal_store_load(&flash, "SN-17", 6, &work, &table, &report), IMUCAL_ERR_NO_TABLE);
  assert_int_equal(report.slot_status[1], IMUCAL_ERR_CHANNELS);
  assert_int_equal(imucal_store_load(&flash, NULL, 0, &work, &table, &report), IMUCAL_OK);
  for (int bit = 0; bit < 32; bit++) { /* a revoke word cut after its first bit revokes, and stays so */
    nor_t torn = nor;
    torn.bytes[1][NOR_SLOT_BYTES - 4 + bit / 8] &= (uint8_t)~(1 << bit % 8);
    assert_int_equal(ruling_mark(&torn), 1);
    assert_int_equal(report.slot_status[1], IMUCAL_SLOT_REVOKED);
  }
  nor.bytes[1][200] ^= 4; /* the newer one rots: the older rules */
  assert_int_equal(ruling_mark(&nor), 1);
  assert_int_equal(report.slot_status[1], IMUCAL_ERR_CRC);
  nor.bytes[1][NOR_SLOT_BYTES - 8] ^= 1;
  assert_int_equal(ruling_mark(&nor), 1);
  assert_int_equal(report.slot_status[1], IMUCAL_ERR_COMMIT);
  nor.bytes[0][4] = 7;
  assert_int_equal(ruling_mark(&nor), -1);
  assert_int_equal(report.slot_status[0], IMUCAL_ERR_VERSION);
}

static void test_write_refuses_bad_tables_and_leaves_flash_alone(void** state) {
  (void)state;
  nor_t nor, before;
  prepare(&nor, 1);
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
  flash.slot_bytes = IMUCAL_STORE_MIN_SLOT_BYTES - 4;
  table = example_table(3, 9);
  assert_int_equal(imucal_store_write(&flash, "SN-17", 3, &work, &table, &report), IMUCAL_ERR_ARGUMENT);
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
  prepare(&nor, 1);
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
      cmocka_unit_test(test_power_cut_at_every_byte_old_or_new_table_rules),
      cmocka_unit_test(test_power_cut_three_times_in_a_row_old_or_new_table_rules),
      cmocka_unit_test(test_driver_fails_at_any_call_old_or_new_table_rules),
      cmocka_unit_test(test_load_tells_why_slots_are_refused),
      cmocka_unit_test(test_write_refuses_bad_tables_and_leaves_flash_alone),
      cmocka_unit_test(test_write_stuck_cell_is_found_and_old_table_rules),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
