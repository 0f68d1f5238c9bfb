// SPDX-License-Identifier: MIT
/* The STM32F405 board as it is built for the chip (board_chip.c, spi.c, flash.c, the ICM-42688-P's driver, the app) over
 * register models of SPI1, flash controller, supply monitor and sensor.  Each kind of bad input must be counted, be told by
 * an event and by SENSOR, and no second may show a wrong value without a mark. */
#include "board_bench.h"
#include "emu/icm42688p.h"
/* The board's own sources, with their registers in the model. */
#include "port/stm32f405/board_chip.c"
#include "port/stm32f405/board_icm42688p.c"
#include "port/stm32f405/board_store_chip.c"
#include "port/stm32f405/flash.c"
#include "port/stm32f405/spi.c"

static emu_icm_t icm;
static const board_truth_t truth = {
    .temp_degc = 31.0, .within_dph = 60.0, .within_mg = 1.0, .n_least = 2950, .n_most = 3050};

/* ---- the sensor behind SPI1 ---- */

static uint8_t slave(uint8_t out, uint32_t n) {
  static uint8_t address;
  static bool is_read;
  uint8_t in = 0xFF;
  emu_icm_advance(&icm, (double)stm32.now_us - icm.bus.now_us);
  if (n == 0) {
    address = out & 0x7F;
    is_read = out & 0x80;
    icm.bus.n_transfers++;
  } else {
    const bool is_deaf = icm.bus.now_us < icm.reset_until_us;
    if (is_read)
      in = is_deaf ? 0 : emu_icm_read(&icm, address);
    else if (icm.bus.fault == EMU_BUS_GOOD && !is_deaf)
      emu_icm_write(&icm, address, out);
    if (!(icm.bank == 0 && address == 0x30)) address = (uint8_t)((address + 1) & 0x7F);
  }
  (void)emu_bus_answer(&icm.bus, &in, 1);
  return in;
}

/* ---- the device ---- */

static void power_on_sensor(void) {
  emu_icm_power_on(&icm);
  board_sensor_feels(&icm.bus, &truth);
}

static void board_on(void) {
  bench_start(&bench);
  emu_stm32_power_on();
  stm32.now_us = 1000000;
  stm32.slave = slave;
  power_on_sensor();
}

static void start_device(void) {
  board_start();
  board_watch(&truth);
}

/* ---- tests ---- */

static void test_healthy_board_counts_nothing_and_tells_its_sensor(void** state) {
  (void)state;
  board_on();
  start_device();
  board_run(5.0);
  assert_board_healthy("icm42688p", 0x47);
  assert_int_equal(stm32.n_spi_violations + icm.bus.n_violations, 0);
}

static void test_another_chip_is_named_and_the_right_one_taken_when_it_comes(void** state) {
  (void)state;
  board_on();
  icm.who_am_i = 0x12;
  icm.reg[0][0x75] = 0x12;
  start_device();
  board_run(3.0);
  assert_board_refuses_identity(0x12);
  power_on_sensor();
  board_run(2.0);
  assert_board_works_again();
}

static void test_stuck_bus_is_counted_and_hands_out_nothing(void** state) {
  (void)state;
  for (int fault = EMU_BUS_ZEROS; fault <= EMU_BUS_ONES; fault++) {
    board_on();
    start_device();
    board_run(2.5);
    icm.bus.fault = fault;
    assert_board_hands_out_nothing();
    icm.bus.fault = EMU_BUS_GOOD;
    board_run(2.0);
    assert_board_works_again();
    assert_in_range(board_sensor_now().lost, 3000, 5500); /* some 4 s of silence at 1 kHz */
    assert_true(seen.event_bits & IMUCAL_SENSOR_LOST);
  }
}

static void test_dead_spi_is_a_bus_error(void** state) {
  (void)state;
  board_on();
  start_device();
  board_run(1.5);
  stm32.is_silent = true;
  board_run(2.0);
  assert_true(board_sensor_now().bus_errors >= 2);
  assert_true(seen.event_bits & IMUCAL_SENSOR_BUS_ERRORS);
  stm32.is_silent = false;
  board_run(2.0);
  assert_board_works_again();
}

static void test_sensor_that_resets_in_the_middle_is_set_up_again(void** state) {
  (void)state;
  board_on();
  start_device();
  board_run(2.3);
  emu_icm_brown_out(&icm);
  icm.reg[0][0x2D] |= 0x10;
  board_run(2.0);
  const imucal_link_sensor_reply_t now = board_sensor_now();
  assert_int_equal(now.resets, 1);
  assert_in_range(now.lost, 40, 200);
  assert_int_equal(seen.event_bits, IMUCAL_SENSOR_RESETS | IMUCAL_SENSOR_LOST);
  assert_board_works_again();
}

static void test_overrun_is_counted_with_what_it_cost(void** state) {
  (void)state;
  board_on();
  start_device();
  board_run(2.3);
  stm32.now_us += 400000; /* the main loop was held up: the FIFO holds 102 ms */
  board_run(2.0);
  const imucal_link_sensor_reply_t now = board_sensor_now();
  /* A sample that comes while the first burst is read raises the flag again and puts that burst out of step: it is refused
   * and the FIFO begun anew. */
  assert_in_range(now.overruns, 1, 2);
  assert_true(now.invalid < 60);
  assert_in_range(now.lost, 280, 320);
  assert_int_equal(seen.event_bits & ~(uint32_t)IMUCAL_SENSOR_INVALID, IMUCAL_SENSOR_OVERRUNS | IMUCAL_SENSOR_LOST);
  assert_true(seen.n_marked >= 1);
  assert_board_works_again();
}

static void test_temperature_that_never_changes_marks_every_second(void** state) {
  (void)state;
  board_on();
  icm.is_temp_frozen = true;
  icm.frozen_degc = 31.0;
  start_device();
  board_run(70.0);
  assert_int_equal(board_sensor_now().stuck_temp, 1);
  assert_int_equal(seen.event_bits, IMUCAL_SENSOR_STUCK_TEMP);
  assert_true(seen.n_marked >= 8);
  assert_true(bench.second.flags[0] & IMUCAL_FLAG_FAULT);
  icm.is_temp_frozen = false;
  board_run(2.0);
  seen.n_marked = 0;
  assert_board_works_again();
  assert_int_equal(seen.n_marked, 0);
}

static void test_low_supply_refuses_a_table_and_says_so(void** state) {
  (void)state;
  board_on();
  start_device();
  board_run(1.5);
  uint8_t table[IMUCAL_TABLE_MAX_BYTES];
  const size_t n = bench_table(&bench, 100.0f, table);
  assert_int_equal(bench_upload(&bench, table, n), IMUCAL_OK);
  stm32.is_supply_low = true;
  const uint32_t n_erases = stm32.n_erases, n_words = stm32.n_words;
  const size_t m = bench_table(&bench, 200.0f, table);
  assert_int_equal(bench_upload(&bench, table, m), IMUCAL_ERR_SUPPLY);
  assert_int_equal(stm32.n_erases + stm32.n_words, n_erases + n_words);
  board_run(2.0);
  imucal_link_sensor_reply_t now = board_sensor_now();
  assert_int_equal(now.is_supply_low, 1);
  assert_true(now.supply_refused >= 1);
  assert_int_equal(seen.event_bits & IMUCAL_SENSOR_SUPPLY, IMUCAL_SENSOR_SUPPLY);
  assert_true(bench_ruling_b0(&bench) == 100.0f);
  stm32.is_supply_low = false;
  assert_int_equal(bench_upload(&bench, table, m), IMUCAL_OK);
  assert_true(bench_ruling_b0(&bench) == 200.0f);
  assert_int_equal(board_sensor_now().is_supply_low, 0);
}

static void test_events_come_when_a_trouble_begins_and_not_every_second(void** state) {
  (void)state;
  board_on();
  start_device();
  board_run(1.5);
  icm.bus.fault = EMU_BUS_ZEROS;
  board_run(8.0);
  const uint32_t n = bench_events(&bench, IMUCAL_EVENT_SENSOR_COUNTED);
  assert_in_range(n, 1, 2);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_healthy_board_counts_nothing_and_tells_its_sensor),
      cmocka_unit_test(test_another_chip_is_named_and_the_right_one_taken_when_it_comes),
      cmocka_unit_test(test_stuck_bus_is_counted_and_hands_out_nothing),
      cmocka_unit_test(test_dead_spi_is_a_bus_error),
      cmocka_unit_test(test_sensor_that_resets_in_the_middle_is_set_up_again),
      cmocka_unit_test(test_overrun_is_counted_with_what_it_cost),
      cmocka_unit_test(test_temperature_that_never_changes_marks_every_second),
      cmocka_unit_test(test_low_supply_refuses_a_table_and_says_so),
      cmocka_unit_test(test_events_come_when_a_trouble_begins_and_not_every_second),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
