// SPDX-License-Identifier: MIT
/* The driver of the external W25Q flash over the model of the chip, every fault injected; and the table store on top, power cut
 * at every byte of a program and inside every erase. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/table_example.h"
#include "emu/w25q.h"

#define BASE 0x4000u

static emu_w25q_t chip;
static imucal_w25q_t driver;
static imucal_w25q_bus_t bus;
static uint8_t pattern[4096];

static int power_on(void** state) {
  (void)state;
  emu_w25q_init(&chip, BASE);
  bus = emu_w25q_bus(&chip);
  for (uint32_t i = 0; i < sizeof pattern; i++) pattern[i] = (uint8_t)(i * 7 + i / 251);
  return 0;
}

static int started(void** state) {
  (void)power_on(state);
  return imucal_w25q_start(&driver, &bus, BASE) != IMUCAL_OK || driver.state != IMUCAL_W25Q_READY;
}

static imucal_status read_word(uint8_t word[4]) {
  return imucal_w25q_read(&driver, 0, 0, word, 4);
}

static void assert_works(void) {
  uint8_t back[8];
  assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_OK);
  assert_int_equal(imucal_w25q_program(&driver, 0, 252, pattern, 8), IMUCAL_OK);
  assert_int_equal(imucal_w25q_read(&driver, 0, 252, back, 8), IMUCAL_OK);
  assert_memory_equal(back, pattern, 8);
  assert_int_equal(driver.state, IMUCAL_W25Q_READY);
}

/* Nothing of the array has moved. */
static void assert_untouched(void) {
  assert_int_equal(chip.n_erases + chip.n_programs, 0);
  for (uint32_t i = 0; i < EMU_W25Q_BYTES; i++) assert_int_equal(chip.bytes[i], 0xFF);
  assert_int_equal(chip.n_violations, 0);
}

/* ---- identity ---- */

static void test_start_wakes_the_chip_and_takes_the_sizes_with_three_address_bytes(void** state) {
  (void)state;
  for (int power = 0x10; power <= 0x1B; power++) {
    (void)power_on(NULL);
    chip.id[2] = (uint8_t)power;
    chip.is_down = true;
    const bool is_known = power >= 0x13 && power <= 0x18;
    assert_int_equal(imucal_w25q_start(&driver, &bus, BASE), is_known ? IMUCAL_OK : IMUCAL_ERR_FLASH);
    assert_int_equal(driver.state, is_known ? IMUCAL_W25Q_READY : IMUCAL_W25Q_FOREIGN);
    assert_int_equal(driver.capacity_bytes, is_known ? 1u << power : 0);
    assert_memory_equal(driver.id, chip.id, 3);
    assert_int_equal(chip.n_violations, 0);
  }
}

static void test_start_refuses_other_makers_and_places_outside(void** state) {
  (void)state;
  chip.id[0] = 0xC2;
  assert_int_equal(imucal_w25q_start(&driver, &bus, BASE), IMUCAL_ERR_FLASH);
  assert_int_equal(driver.state, IMUCAL_W25Q_FOREIGN);
  chip.id[0] = 0xEF, chip.id[2] = 0x13;
  assert_int_equal(imucal_w25q_start(&driver, &bus, 0x80000u - 2 * 4096), IMUCAL_OK);
  assert_int_equal(imucal_w25q_start(&driver, &bus, 0x80000u - 4096), IMUCAL_ERR_FLASH);
  assert_int_equal(imucal_w25q_start(&driver, &bus, UINT32_MAX - 4095), IMUCAL_ERR_FLASH);
  assert_int_equal(imucal_w25q_start(&driver, &bus, BASE + 256), IMUCAL_ERR_ARGUMENT);
  assert_untouched();
}

/* The processor was reset while the chip erased: it is waited for, not disturbed. */
static void test_start_waits_for_an_erase_from_before_the_reset(void** state) {
  (void)state;
  chip.busy_until_us = chip.now_us + 390000;
  assert_int_equal(imucal_w25q_start(&driver, &bus, BASE), IMUCAL_OK);
  assert_true(chip.now_us >= 390000);
  assert_untouched();
}

/* ---- writing ---- */

static void test_program_splits_at_pages_and_touches_nothing_else(void** state) {
  (void)state;
  static const struct {
    uint32_t offset, len;
  } pieces[] = {{0, 4}, {252, 4}, {252, 8}, {4, 252}, {8, 868}, {1020, 260}, {4032, 64}, {0, 4096}};
  for (size_t i = 0; i < sizeof pieces / sizeof pieces[0]; i++) {
    (void)started(NULL);
    for (uint32_t slot = 0; slot < 2; slot++) {
      const uint32_t at = BASE + 4096 * slot + pieces[i].offset;
      assert_int_equal(imucal_w25q_program(&driver, slot, pieces[i].offset, pattern, pieces[i].len), IMUCAL_OK);
      assert_memory_equal(chip.bytes + at, pattern, pieces[i].len);
      assert_int_equal(chip.bytes[at - 1],
                       slot == 1 && pieces[i].offset == 0 && pieces[i].len == 4096 ? pattern[4095] : 0xFF);
      assert_int_equal(chip.bytes[at + pieces[i].len], 0xFF);
    }
    assert_int_equal(chip.n_pages_wrapped + chip.n_violations, 0);
  }
}

static void test_erase_takes_its_own_sector_alone(void** state) {
  (void)state;
  memset(chip.bytes, 0, sizeof chip.bytes);
  assert_int_equal(imucal_w25q_erase(&driver, 1), IMUCAL_OK);
  for (uint32_t i = 0; i < EMU_W25Q_BYTES; i++)
    assert_int_equal(chip.bytes[i], i >= BASE + 4096 && i < BASE + 8192 ? 0xFF : 0);
  assert_false(emu_w25q_is_busy(&chip));
  assert_int_equal(chip.n_violations, 0);
}

static void test_what_is_outside_the_slots_is_refused(void** state) {
  (void)state;
  uint8_t word[8];
  assert_int_equal(imucal_w25q_erase(&driver, 2), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_w25q_program(&driver, 0, 4092, pattern, 8), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_w25q_program(&driver, 0, 4, pattern, UINT32_MAX), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_w25q_program(&driver, 2, 0, pattern, 4), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_w25q_read(&driver, 1, 4092, word, 8), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_w25q_read(&driver, 1, UINT32_MAX, word, 8), IMUCAL_ERR_ARGUMENT);
  assert_untouched();
}

/* ---- faults ---- */

static void test_latch_that_does_not_set_is_seen_before_anything_is_sent(void** state) {
  (void)state;
  chip.is_latch_stuck = true;
  assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_ERR_FLASH);
  assert_int_equal(imucal_w25q_program(&driver, 0, 0, pattern, 300), IMUCAL_ERR_FLASH);
  assert_int_equal(driver.n_not_enabled, 2);
  assert_untouched();
  chip.is_latch_stuck = false;
  assert_works();
}

static void test_each_protection_bit_is_seen_and_reading_goes_on(void** state) {
  (void)state;
  static const uint8_t bits[][3] = {{0x04, 0, 0}, {0x08, 0, 0}, {0x10, 0, 0}, {0, 0x40, 0}, {0, 0x80, 0}, {0, 0, 0x04}};
  for (size_t i = 0; i < sizeof bits / sizeof bits[0]; i++)
    for (int before_start = 0; before_start <= 1; before_start++) {
      uint8_t word[4];
      (void)power_on(NULL);
      if (!before_start) assert_int_equal(imucal_w25q_start(&driver, &bus, BASE), IMUCAL_OK);
      chip.sr1 |= bits[i][0], chip.sr2 |= bits[i][1], chip.sr3 |= bits[i][2];
      if (before_start) assert_int_equal(imucal_w25q_start(&driver, &bus, BASE), IMUCAL_OK);
      assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_ERR_FLASH);
      assert_int_equal(imucal_w25q_program(&driver, 0, 0, pattern, 8), IMUCAL_ERR_FLASH);
      assert_int_equal(driver.state, IMUCAL_W25Q_PROTECTED);
      assert_int_equal(driver.n_protected, 2);
      assert_int_equal(read_word(word), IMUCAL_OK);
      assert_untouched();
      chip.sr1 = 0, chip.sr2 = 0x02, chip.sr3 = 0x60;
      assert_works();
    }
}

/* What protects nothing: QE, drive strength, the lock of the status register, top or bottom, sector or block. */
static void test_other_status_bits_protect_nothing(void** state) {
  (void)state;
  chip.sr1 = 0xE0, chip.sr2 = 0x3B, chip.sr3 = 0xE0;
  assert_works();
}

static void test_busy_for_ever_costs_its_limit_once(void** state) {
  (void)state;
  uint8_t word[4];
  chip.stays_busy = true;
  uint64_t before_us = chip.now_us;
  assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_ERR_FLASH);
  assert_true(chip.now_us - before_us >= 500000 && chip.now_us - before_us < 600000);
  assert_int_equal(driver.state, IMUCAL_W25Q_BUSY);
  before_us = chip.now_us;
  for (int i = 0; i < 100; i++) assert_int_equal(read_word(word), IMUCAL_ERR_FLASH);
  assert_true(chip.now_us - before_us < 20000);
  assert_untouched();
  chip.stays_busy = false;
  assert_works();
}

static void test_erase_that_does_not_end_is_reported(void** state) {
  (void)state;
  chip.erase_us = UINT32_MAX;
  assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_ERR_FLASH);
  assert_int_equal(driver.n_timeouts, 1);
  chip.erase_us = 400000; /* the longest of the data sheet */
  chip.busy_until_us = 0;
  assert_works();
}

/* A bus that went dead must not look like erased flash, nor like a table of zeros. */
static void test_dead_bus_is_an_error_of_every_call_and_heals(void** state) {
  (void)state;
  for (int fault = EMU_W25Q_ZEROS; fault <= EMU_W25Q_ERRORS; fault++) {
    uint8_t word[4];
    (void)started(NULL);
    chip.bus_fault = fault;
    const uint64_t before_us = chip.now_us;
    for (int i = 0; i < 3; i++) {
      assert_int_equal(read_word(word), IMUCAL_ERR_FLASH);
      assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_ERR_FLASH);
      assert_int_equal(imucal_w25q_program(&driver, 0, 0, pattern, 8), IMUCAL_ERR_FLASH);
      assert_int_equal(driver.state, IMUCAL_W25Q_ABSENT);
    }
    assert_int_equal(imucal_w25q_start(&driver, &bus, BASE), IMUCAL_ERR_FLASH);
    assert_true(chip.now_us - before_us < 20000);
    assert_untouched();
    chip.bus_fault = EMU_W25Q_GOOD;
    assert_works();
  }
}

static void test_transfer_that_fails_anywhere_is_never_done(void** state) {
  (void)state;
  uint32_t n_failed = 0;
  for (uint32_t at = 1;; at++, n_failed++) {
    uint8_t back[120];
    (void)started(NULL);
    chip.fail_at = chip.n_transfers + at;
    imucal_status status = imucal_w25q_erase(&driver, 1);
    if (status == IMUCAL_OK) status = imucal_w25q_program(&driver, 1, 200, pattern, sizeof back);
    if (status == IMUCAL_OK) status = imucal_w25q_read(&driver, 1, 200, back, sizeof back);
    if (chip.n_transfers < chip.fail_at) break;
    assert_int_equal(status, IMUCAL_ERR_FLASH);
    assert_int_equal(driver.n_bus_errors, 1);
    assert_int_equal(driver.state, IMUCAL_W25Q_ABSENT);
    assert_works();
  }
  assert_true(n_failed > 20);
}

/* Somebody else has sent it to sleep: found at the first call, woken by the next. */
static void test_chip_in_power_down_is_woken(void** state) {
  (void)state;
  uint8_t word[4];
  chip.is_down = true;
  assert_int_equal(read_word(word), IMUCAL_ERR_FLASH);
  assert_int_equal(read_word(word), IMUCAL_OK);
  assert_works();
}

static void test_another_chip_in_its_place_is_not_written(void** state) {
  (void)state;
  chip.id[0] = 0x20;
  assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_ERR_FLASH);
  assert_int_equal(driver.state, IMUCAL_W25Q_FOREIGN);
  assert_untouched();
}

static void test_low_supply_touches_nothing(void** state) {
  (void)state;
  uint8_t word[4];
  chip.is_supply_low = true;
  assert_int_equal(imucal_w25q_erase(&driver, 0), IMUCAL_ERR_SUPPLY);
  assert_int_equal(imucal_w25q_program(&driver, 0, 0, pattern, 8), IMUCAL_ERR_SUPPLY);
  assert_int_equal(driver.n_supply_refused, 2);
  assert_int_equal(read_word(word), IMUCAL_OK);
  assert_untouched();
  chip.is_supply_low = false;
  assert_works();
  bus.is_supply_good = NULL;
  assert_works();
}

/* ---- the store on it ---- */

static imucal_store_work_t work;
static imucal_store_report_t report;

static imucal_status act(int what, int mark) {
  const imucal_flash_t flash = imucal_w25q_flash(&driver);
  imucal_table_t table = example_table(1, mark);
  if (what == 'w') return imucal_store_write(&flash, "SN-17", 1, (uint8_t)mark, &work, &table, &report);
  if (what == 'r') return imucal_store_rollback(&flash, "SN-17", 1, &work, &table, &report);
  return imucal_store_erase(&flash, &work, &report);
}

/* Power on, start, load: the ruling table's mark, 0: none; every byte and its origin are as they were written. */
static int ruling_after_start(void) {
  emu_w25q_power_on(&chip);
  assert_int_equal(imucal_w25q_start(&driver, &bus, BASE), IMUCAL_OK);
  const imucal_flash_t flash = imucal_w25q_flash(&driver);
  imucal_table_t table;
  const imucal_status status = imucal_store_load(&flash, "SN-17", 1, &work, &table, &report);
  if (status == IMUCAL_ERR_NO_TABLE) return 0;
  assert_int_equal(status, IMUCAL_OK);
  const int mark = (int)(table.created_s - 1767225600u);
  imucal_table_t expected = example_table(1, mark);
  expected.sequence = table.sequence;
  assert_memory_equal(&table, &expected, sizeof table);
  assert_int_equal(imucal_store_origin(&flash, &report, 1).noted, mark);
  return mark;
}

/* Runs the script with the power on; marks count from 1. */
static int prepare(const char* script) {
  int n_written = 0;
  (void)started(NULL);
  for (; *script; script++) {
    n_written += *script == 'w';
    assert_int_equal(act(*script, n_written), IMUCAL_OK);
  }
  return n_written;
}

static void test_store_breaks_no_rule_of_this_flash(void** state) {
  (void)state;
  for (int mark = 1; mark <= 20; mark++) {
    assert_int_equal(act('w', mark), IMUCAL_OK);
    assert_int_equal(ruling_after_start(), mark);
  }
  assert_int_equal(act('r', 0), IMUCAL_OK);
  assert_int_equal(ruling_after_start(), 19);
  assert_int_equal(act('e', 0), IMUCAL_OK);
  assert_int_equal(ruling_after_start(), 0);
  assert_int_equal(chip.n_violations + chip.n_pages_wrapped, 0);
}

/* One cut: old or new rules at every start, and the next write succeeds.  False: the action ended before. */
static bool cut(const char* script, int action, long step, uint64_t seed) {
  (void)act(action, prepare(script) + 1);
  const int new = ruling_after_start(); /* where nothing is cut */
  const int n_written = prepare(script), old = ruling_after_start();
  chip.random = seed;
  chip.steps_left = step;
  chip.steps_used = 0;
  const imucal_status status = act(action, n_written + 1);
  if (!chip.is_off) {
    assert_true(status == IMUCAL_OK || status == IMUCAL_ERR_NO_OTHER || status == IMUCAL_ERR_NO_TABLE);
    return false;
  }
  for (int start = 0; start < 3; start++) {
    const int now = ruling_after_start();
    if (now != old && now != new) fail_msg("%s, %c cut at step %ld: table %d rules", script, action, step, now);
  }
  assert_int_equal(act('w', 40), IMUCAL_OK);
  assert_int_equal(ruling_after_start(), 40);
  assert_int_equal(chip.n_violations, 0);
  return true;
}

static void test_store_cut_anywhere_leaves_old_or_new(void** state) {
  (void)state;
  static const char* const scripts[] = {"", "w", "ww", "wwr", "wwrw"};
  uint32_t n_cuts = 0;
  for (size_t i = 0; i < sizeof scripts / sizeof scripts[0]; i++)
    for (const char* action = "wre"; *action; action++)
      for (long step = 0; cut(scripts[i], *action, step, (uint64_t)step * 31 + i); step += step % 256 < 8 ? 1 : 3)
        n_cuts++;
  assert_true(n_cuts > 1000);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_start_wakes_the_chip_and_takes_the_sizes_with_three_address_bytes, power_on),
      cmocka_unit_test_setup(test_start_refuses_other_makers_and_places_outside, power_on),
      cmocka_unit_test_setup(test_start_waits_for_an_erase_from_before_the_reset, power_on),
      cmocka_unit_test_setup(test_program_splits_at_pages_and_touches_nothing_else, started),
      cmocka_unit_test_setup(test_erase_takes_its_own_sector_alone, started),
      cmocka_unit_test_setup(test_what_is_outside_the_slots_is_refused, started),
      cmocka_unit_test_setup(test_latch_that_does_not_set_is_seen_before_anything_is_sent, started),
      cmocka_unit_test_setup(test_each_protection_bit_is_seen_and_reading_goes_on, power_on),
      cmocka_unit_test_setup(test_other_status_bits_protect_nothing, started),
      cmocka_unit_test_setup(test_busy_for_ever_costs_its_limit_once, started),
      cmocka_unit_test_setup(test_erase_that_does_not_end_is_reported, started),
      cmocka_unit_test_setup(test_dead_bus_is_an_error_of_every_call_and_heals, started),
      cmocka_unit_test_setup(test_transfer_that_fails_anywhere_is_never_done, started),
      cmocka_unit_test_setup(test_chip_in_power_down_is_woken, started),
      cmocka_unit_test_setup(test_another_chip_in_its_place_is_not_written, started),
      cmocka_unit_test_setup(test_low_supply_touches_nothing, started),
      cmocka_unit_test_setup(test_store_breaks_no_rule_of_this_flash, started),
      cmocka_unit_test_setup(test_store_cut_anywhere_leaves_old_or_new, power_on),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
