// SPDX-License-Identifier: MIT
/* The STM32F405 board with the MPU-6050 as it is built for the chip (board_chip.c, board_mpu6050.c, i2c.c, flash.c, the driver, the
 * app) over register models of I2C1, port B, flash controller, supply monitor and sensor.  Each kind of bad input must be
 * counted, be told by an event and by SENSOR, and no second may show a wrong value without a mark. */
#include "bench.h"
#include "emu/mpu6050.h"
#include "emu/stm32f405.h"
#include "emu/stm32f405_i2c.h"
/* The board's own sources, with their registers in the model. */
#include "port/stm32f405/board_chip.c"
#include "port/stm32f405/board_mpu6050.c"
#include "port/stm32f405/board_store_chip.c"
#include "port/stm32f405/flash.c"
#include "port/stm32f405/i2c.c"

static bench_t bench;
static emu_mpu_t mpu;
static uint8_t mpu_at;
static uint32_t n_seconds, n_wrong, n_marked; /* seconds seen; without a mark and off; with one */
static uint32_t n_looked;                     /* seconds of the bench already looked at */
static uint32_t event_bits;                   /* of all events SENSOR_COUNTED */

/* What the board takes from system.c. */
void stm32_delay_us(uint32_t us) {
  stm32.now_us += us + 1;
}
uint32_t stm32_random(void) {
  return 1;
}
bool stm32_was_fault(void) {
  return false;
}
const stm32_record_t* stm32_record(void) {
  static const stm32_record_t record;
  return &record;
}

/* ---- the sensor behind I2C1 ---- */

static bool put_mpu(uint8_t byte, bool is_first) {
  emu_mpu_advance(&mpu, (double)stm32.now_us - mpu.bus.now_us);
  const bool is_awake = mpu.bus.now_us >= mpu.reset_until_us;
  mpu.bus.n_transfers += is_first;
  if (is_first)
    mpu_at = byte & 0x7F;
  else if (is_awake && mpu.bus.fault == EMU_BUS_GOOD)
    emu_mpu_write(&mpu, mpu_at++, byte);
  return is_awake;
}

static uint8_t get_mpu(void) {
  if (mpu.bus.fault == EMU_BUS_ZEROS) return 0x00;
  if (mpu.bus.fault == EMU_BUS_ONES) return 0xFF;
  const uint8_t byte = emu_mpu_read(&mpu, mpu_at);
  if (mpu_at != 0x74) mpu_at = (uint8_t)((mpu_at + 1) & 0x7F);
  return byte;
}

static uint32_t read_port_b(uint32_t address) {
  return address == GPIO(1) + GPIO_IDR ? emu_i2c_idr() : 0;
}

static void write_port_b(uint32_t address, uint32_t value) {
  if (address == GPIO(1) + GPIO_BSRR) emu_i2c_bsrr(value);
}

static void world(void* ctx, uint64_t k, double t_us, emu_world_t* w) {
  (void)ctx, (void)t_us;
  w->temp_degc = 30.0;
  w->rate_dps[0] = 10.0 + 0.06 * emu_noise(k, 1);
  w->accel_g[2] = 1.0 + 0.002 * emu_noise(k, 2);
}

/* ---- the device ---- */

static uint64_t time_us(void* ctx) {
  (void)ctx;
  return stm32.now_us;
}

static void power_on_sensor(void) {
  emu_mpu_power_on(&mpu, false);
  mpu.bus.feel = world;
  mpu.bus.now_us = (double)stm32.now_us;
}

static int board_on(void** state) {
  (void)state;
  bench_start(&bench);
  emu_stm32_power_on();
  emu_i2c_power_on();
  peripherals[0] = (emu_peripheral_t){I2C1, I2C1 + 0x20, emu_i2c_read, emu_i2c_write};
  peripherals[1] = (emu_peripheral_t){GPIO(1), GPIO(1) + 0x24, read_port_b, write_port_b};
  i2c.put = put_mpu;
  i2c.get = get_mpu;
  stm32.now_us = 1000000;
  power_on_sensor();
  return 0;
}

static void take_events(uint32_t from) {
  for (uint32_t i = from; i < bench.n_event; i++)
    if (bench.event[i % 32].code == IMUCAL_EVENT_SENSOR_COUNTED) event_bits |= bench.event[i % 32].detail;
}

static void start_device(void) {
  static const stm32_clocks_t clocks = {
      .core_hz = 168000000, .apb1_hz = 42000000, .apb2_hz = 84000000, .tim_hz = 84000000, .is_crystal = true};
  bench.port.time_us = time_us;
  bench.port.sample_enable = NULL;
  bench.port.sample_out = NULL;
  bench.port.is_replay = false;
  memset(&bench.board, 0, sizeof bench.board);
  board_init(&bench.port, &bench.board, &clocks);
  bench_power_cycle(&bench);
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND | IMUCAL_STREAM_EVENT), IMUCAL_OK);
  event_bits = n_seconds = n_wrong = n_marked = 0;
  n_looked = bench.n_second;
  take_events(0);
}

static void look_at_second(void) {
  if (bench.n_second == n_looked) return;
  n_looked = bench.n_second;
  const imucal_link_second_t* second = &bench.second;
  const bool is_right = fabs((double)second->raw[0] - 36000.0) < 120.0 && fabs((double)second->raw[5] - 1000.0) < 2.0 &&
                        fabs((double)second->temp_degc - 30.0) < 0.1;
  const bool is_marked = second->is_gap || second->flags[0] != 0;
  n_seconds++;
  n_marked += is_marked;
  if (!is_right && !is_marked)
    print_message("t %u n %u raw %g %g temp %g\n", second->t_s, second->n_samples, (double)second->raw[0],
                  (double)second->raw[5], (double)second->temp_degc);
  n_wrong += !is_right && !(second->is_gap || second->flags[0] & (IMUCAL_FLAG_FAULT | IMUCAL_FLAG_SATURATED));
}

static void run(double seconds) {
  const uint64_t end_us = stm32.now_us + (uint64_t)(seconds * 1e6);
  while (stm32.now_us < end_us) {
    const uint32_t n_event = bench.n_event;
    if (!imucal_app_step(&bench.app)) stm32.now_us += 500;
    look_at_second();
    take_events(n_event);
  }
}

static imucal_link_sensor_reply_t sensor_now(void) {
  const imucal_link_sensor_t request = {0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_SENSOR, &request), IMUCAL_LINK_ID_SENSOR_REPLY);
  return bench.reply.sensor_reply;
}

static void assert_works_again(void) {
  const uint32_t before = bench.app.n_samples;
  run(3.0);
  assert_in_range(bench.app.n_samples - before, 590, 610);
  assert_int_equal(sensor_now().status, IMUCAL_OK);
  assert_int_equal(n_wrong, 0);
}

/* ---- tests ---- */

static void test_healthy_board_counts_nothing_and_tells_its_sensor(void** state) {
  (void)state;
  start_device();
  run(5.0);
  const imucal_link_sensor_reply_t now = sensor_now();
  assert_int_equal(now.is_counted, 1);
  assert_string_equal(now.name, "mpu6050");
  assert_int_equal(now.identity, 0x68);
  assert_int_equal(now.starts, 1);
  assert_int_equal(now.wrong_identity + now.bus_errors + now.overruns + now.lost + now.invalid + now.resets, 0);
  assert_int_equal(now.stuck_temp + now.stuck_data + now.supply_refused + now.saturated + now.is_supply_low, 0);
  assert_int_equal(event_bits, 0);
  assert_true(n_seconds >= 4);
  assert_int_equal(n_wrong, 0);
  assert_int_equal(i2c.n_violations + i2c.n_acked_too_many + mpu.bus.n_violations, 0);
}

/* What the README's list has after the start; 500 dps and 4 g as the channels say. */
static void test_settings_are_those_of_the_bring_up_list(void** state) {
  (void)state;
  start_device();
  static const struct {
    uint8_t address, value;
  } list[] = {{0x6B, 0x01}, {0x19, 0x04}, {0x1A, 0x03}, {0x1B, 0x08},
              {0x1C, 0x08}, {0x38, 0x10}, {0x23, 0xF8}, {0x6A, 0x40}};
  run(0.5);
  for (size_t i = 0; i < sizeof list / sizeof list[0]; i++) assert_int_equal(mpu.reg[list[i].address], list[i].value);
  assert_int_equal(bench.board.rate_hz, 200);
  assert_true(fabs((double)bench.board.channel[0].unit_per_count - 500.0 / 32768.0 * 3600.0) < 1e-3);
  assert_true(fabs((double)bench.board.channel[5].unit_per_count - 1000.0 / 8192.0) < 1e-6);
  assert_string_equal(bench.port.device, "stm32f405");
}

static void test_another_chip_is_named_and_the_right_one_taken_when_it_comes(void** state) {
  (void)state;
  mpu.who_am_i = mpu.reg[0x75] = 0x71; /* an MPU-9250 */
  start_device();
  run(3.0);
  const imucal_link_sensor_reply_t now = sensor_now();
  assert_int_equal(now.status, IMUCAL_ERR_SENSOR);
  assert_int_equal(now.identity, 0x71);
  assert_true(now.wrong_identity >= 2 && now.starts >= 2);
  assert_int_equal(event_bits, IMUCAL_SENSOR_WRONG_IDENTITY);
  assert_int_equal(bench.app.n_samples, 0);
  power_on_sensor();
  run(2.0);
  assert_works_again();
}

/* Nobody there; the data line held low for good; answers of zeros, of ones. */
static void test_stuck_bus_is_counted_and_hands_out_nothing(void** state) {
  for (int fault = 0; fault < 4; fault++) {
    (void)board_on(state);
    start_device();
    run(2.5);
    i2c.is_absent = fault == 0;
    i2c.is_clock_held = fault == 1;
    mpu.bus.fault = fault == 2 ? EMU_BUS_ZEROS : fault == 3 ? EMU_BUS_ONES : EMU_BUS_GOOD;
    run(0.2); /* what had been read before */
    const uint32_t before = bench.app.n_samples;
    run(3.0);
    assert_int_equal(bench.app.n_samples, before);
    const imucal_link_sensor_reply_t now = sensor_now();
    assert_int_equal(now.status, IMUCAL_ERR_SENSOR);
    assert_true(now.bus_errors >= 2);
    assert_true(event_bits & IMUCAL_SENSOR_BUS_ERRORS);
    i2c.is_absent = i2c.is_clock_held = false;
    mpu.bus.fault = EMU_BUS_GOOD;
    run(2.0);
    assert_works_again();
    assert_in_range(sensor_now().lost, 550, 1100); /* 3 to 5 s of silence at 200 Hz */
  }
}

static void test_data_line_held_once_is_clocked_free(void** state) {
  (void)state;
  start_device();
  run(2.0);
  i2c.n_clocks = 0;
  i2c.is_line_held = true;
  run(2.0);
  assert_false(i2c.is_line_held);
  assert_true(i2c.n_clocks >= 9);
  assert_works_again();
}

static void test_sensor_that_resets_in_the_middle_is_set_up_again(void** state) {
  (void)state;
  start_device();
  run(2.3);
  emu_mpu_brown_out(&mpu);
  run(2.5);
  const imucal_link_sensor_reply_t now = sensor_now();
  assert_true(now.resets >= 1 || now.bus_errors >= 1); /* deaf for 50 ms: no acknowledge is what comes first */
  assert_int_equal(now.resets, 1);
  assert_true(now.lost >= 8);
  assert_true(event_bits & IMUCAL_SENSOR_RESETS);
  assert_works_again();
}

static void test_overrun_is_counted_with_what_it_cost(void** state) {
  (void)state;
  start_device();
  run(2.3);
  stm32.now_us += 800000; /* the main loop was held up: 1024 bytes hold 73 samples, 0.37 s */
  run(2.0);
  const imucal_link_sensor_reply_t now = sensor_now();
  assert_int_equal(now.overruns, 1);
  assert_in_range(now.lost, 80, 170);
  assert_true(event_bits & IMUCAL_SENSOR_OVERRUNS);
  assert_true(n_marked >= 1);
  assert_works_again();
}

static void test_temperature_that_never_changes_marks_every_second(void** state) {
  (void)state;
  mpu.is_temp_frozen = true;
  start_device();
  run(70.0);
  assert_int_equal(sensor_now().stuck_temp, 1);
  assert_int_equal(event_bits, IMUCAL_SENSOR_STUCK_TEMP);
  assert_true(bench.second.flags[0] & IMUCAL_FLAG_FAULT);
}

static void test_low_supply_refuses_a_table_and_says_so(void** state) {
  (void)state;
  start_device();
  run(1.5);
  uint8_t table[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(bench_upload(&bench, table, bench_table(&bench, 100.0f, table)), IMUCAL_OK);
  stm32.is_supply_low = true;
  assert_int_equal(bench_upload(&bench, table, bench_table(&bench, 200.0f, table)), IMUCAL_ERR_SUPPLY);
  run(2.0);
  assert_int_equal(sensor_now().is_supply_low, 1);
  assert_true(sensor_now().supply_refused >= 1);
  assert_true(event_bits & IMUCAL_SENSOR_SUPPLY);
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
