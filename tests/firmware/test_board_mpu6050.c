// SPDX-License-Identifier: MIT
/* The STM32F405 board with the MPU-6050 as it is built for the chip (board_chip.c, board_mpu6050.c, i2c.c, flash.c, the driver, the
 * app) over register models of I2C1, port B, flash controller, supply monitor and sensor.  Each kind of bad input must be
 * counted, be told by an event and by SENSOR, and no second may show a wrong value without a mark. */
#include "board_bench.h"
#include "emu/mpu6050_i2c.h"
/* The board's own sources, with their registers in the model. */
#include "port/stm32f405/board_chip.c"
#include "port/stm32f405/board_mpu6050.c"
#include "port/stm32f405/board_store_chip.c"
#include "port/stm32f405/flash.c"
#include "port/stm32f405/i2c.c"

static const board_truth_t truth = {
    .temp_degc = 30.0, .within_dph = 120.0, .within_mg = 2.0, .n_least = 590, .n_most = 610};

/* ---- the device ---- */

static void power_on_sensor(void) {
  emu_mpu_power_on(&emu_mpu, false);
  board_sensor_feels(&emu_mpu.bus, &truth);
}

static int board_on(void** state) {
  (void)state;
  bench_start(&bench);
  emu_stm32_power_on();
  emu_i2c_power_on();
  emu_mpu_i2c_connect();
  stm32.now_us = 1000000;
  power_on_sensor();
  return 0;
}

static void start_device(void) {
  board_start();
  board_watch(&truth);
}

/* ---- tests ---- */

static void test_healthy_board_counts_nothing_and_tells_its_sensor(void** state) {
  (void)state;
  start_device();
  board_run(5.0);
  assert_board_healthy("mpu6050", 0x68);
  assert_int_equal(i2c.n_violations + i2c.n_acked_too_many + emu_mpu.bus.n_violations, 0);
}

/* What the README's list has after the start; 500 dps and 4 g as the channels say. */
static void test_settings_are_those_of_the_bring_up_list(void** state) {
  (void)state;
  start_device();
  static const struct {
    uint8_t address, value;
  } list[] = {{0x6B, 0x01}, {0x19, 0x04}, {0x1A, 0x03}, {0x1B, 0x08},
              {0x1C, 0x08}, {0x38, 0x10}, {0x23, 0xF8}, {0x6A, 0x40}};
  board_run(0.5);
  for (size_t i = 0; i < sizeof list / sizeof list[0]; i++)
    assert_int_equal(emu_mpu.reg[list[i].address], list[i].value);
  assert_int_equal(bench.board.rate_hz, 200);
  assert_true(fabs((double)bench.board.channel[0].unit_per_count - 500.0 / 32768.0 * 3600.0) < 1e-3);
  assert_true(fabs((double)bench.board.channel[5].unit_per_count - 1000.0 / 8192.0) < 1e-6);
  assert_string_equal(bench.port.device, "stm32f405");
}

static void test_another_chip_is_named_and_the_right_one_taken_when_it_comes(void** state) {
  (void)state;
  emu_mpu.who_am_i = emu_mpu.reg[0x75] = 0x71; /* an MPU-9250 */
  start_device();
  board_run(3.0);
  assert_board_refuses_identity(0x71);
  power_on_sensor();
  board_run(2.0);
  assert_board_works_again();
}

/* Nobody there; the data line held low for good; answers of zeros, of ones. */
static void test_stuck_bus_is_counted_and_hands_out_nothing(void** state) {
  for (int fault = 0; fault < 4; fault++) {
    (void)board_on(state);
    start_device();
    board_run(2.5);
    i2c.is_absent = fault == 0;
    i2c.is_clock_held = fault == 1;
    emu_mpu.bus.fault = fault == 2 ? EMU_BUS_ZEROS : fault == 3 ? EMU_BUS_ONES : EMU_BUS_GOOD;
    assert_board_hands_out_nothing();
    i2c.is_absent = i2c.is_clock_held = false;
    emu_mpu.bus.fault = EMU_BUS_GOOD;
    board_run(2.0);
    assert_board_works_again();
    assert_in_range(board_sensor_now().lost, 550, 1100); /* 3 to 5 s of silence at 200 Hz */
  }
}

static void test_data_line_held_once_is_clocked_free(void** state) {
  (void)state;
  start_device();
  board_run(2.0);
  i2c.n_clocks = 0;
  i2c.is_line_held = true;
  board_run(2.0);
  assert_false(i2c.is_line_held);
  assert_true(i2c.n_clocks >= 9);
  assert_board_works_again();
}

static void test_sensor_that_resets_in_the_middle_is_set_up_again(void** state) {
  (void)state;
  start_device();
  board_run(2.3);
  emu_mpu_brown_out(&emu_mpu);
  board_run(2.5);
  const imucal_link_sensor_reply_t now = board_sensor_now();
  assert_true(now.resets >= 1 || now.bus_errors >= 1); /* deaf for 50 ms: no acknowledge is what comes first */
  assert_int_equal(now.resets, 1);
  assert_true(now.lost >= 8);
  assert_true(seen.event_bits & IMUCAL_SENSOR_RESETS);
  assert_board_works_again();
}

static void test_overrun_is_counted_with_what_it_cost(void** state) {
  (void)state;
  start_device();
  board_run(2.3);
  stm32.now_us += 800000; /* the main loop was held up: 1024 bytes hold 73 samples, 0.37 s */
  board_run(2.0);
  const imucal_link_sensor_reply_t now = board_sensor_now();
  assert_int_equal(now.overruns, 1);
  assert_in_range(now.lost, 80, 170);
  assert_true(seen.event_bits & IMUCAL_SENSOR_OVERRUNS);
  assert_true(seen.n_marked >= 1);
  assert_board_works_again();
}

static void test_temperature_that_never_changes_marks_every_second(void** state) {
  (void)state;
  emu_mpu.is_temp_frozen = true;
  start_device();
  board_run(70.0);
  assert_int_equal(board_sensor_now().stuck_temp, 1);
  assert_int_equal(seen.event_bits, IMUCAL_SENSOR_STUCK_TEMP);
  assert_true(bench.second.flags[0] & IMUCAL_FLAG_FAULT);
}

static void test_low_supply_refuses_a_table_and_says_so(void** state) {
  (void)state;
  start_device();
  board_run(1.5);
  uint8_t table[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(bench_upload(&bench, table, bench_table(&bench, 100.0f, table)), IMUCAL_OK);
  stm32.is_supply_low = true;
  assert_int_equal(bench_upload(&bench, table, bench_table(&bench, 200.0f, table)), IMUCAL_ERR_SUPPLY);
  board_run(2.0);
  assert_int_equal(board_sensor_now().is_supply_low, 1);
  assert_true(board_sensor_now().supply_refused >= 1);
  assert_true(seen.event_bits & IMUCAL_SENSOR_SUPPLY);
  assert_true(bench_ruling_b0(&bench) == 100.0f);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_healthy_board_counts_nothing_and_tells_its_sensor, board_on),
      cmocka_unit_test_setup(test_settings_are_those_of_the_bring_up_list, board_on),
      cmocka_unit_test_setup(test_another_chip_is_named_and_the_right_one_taken_when_it_comes, board_on),
      cmocka_unit_test_setup(test_stuck_bus_is_counted_and_hands_out_nothing, board_on),
      cmocka_unit_test_setup(test_data_line_held_once_is_clocked_free, board_on),
      cmocka_unit_test_setup(test_sensor_that_resets_in_the_middle_is_set_up_again, board_on),
      cmocka_unit_test_setup(test_overrun_is_counted_with_what_it_cost, board_on),
      cmocka_unit_test_setup(test_temperature_that_never_changes_marks_every_second, board_on),
      cmocka_unit_test_setup(test_low_supply_refuses_a_table_and_says_so, board_on),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
