// SPDX-License-Identifier: MIT
/* The STM32F405 board as it is built for the chip (board_chip.c, spi.c, flash.c, the ICM-42688-P's driver, the app) over
 * register models of SPI1, flash controller, supply monitor and sensor.  Each kind of bad input must be counted, be told by
 * an event and by SENSOR, and no second may show a wrong value without a mark. */
#include "bench.h"
#include "emu/icm42688p.h"
#include "emu/stm32f405.h"
/* The board's own sources, with their registers in the model. */
#include "port/stm32f405/board_chip.c"
#include "port/stm32f405/board_icm42688p.c"
#include "port/stm32f405/board_store_chip.c"
#include "port/stm32f405/flash.c"
#include "port/stm32f405/spi.c"

static bench_t bench;
static emu_icm_t icm;
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

static void world(void* ctx, uint64_t k, double t_us, emu_world_t* w) {
  (void)ctx, (void)t_us;
  w->temp_degc = 31.0;
  w->rate_dps[0] = 10.0 + 0.06 * emu_noise(k, 1);
  w->accel_g[2] = 1.0 + 0.002 * emu_noise(k, 2);
}

/* ---- the device ---- */

static uint64_t time_us(void* ctx) {
  (void)ctx;
  return stm32.now_us;
}

static void power_on_sensor(void) {
  emu_icm_power_on(&icm);
  icm.bus.feel = world;
  icm.bus.now_us = (double)stm32.now_us;
}

static void board_on(void) {
  bench_start(&bench);
  emu_stm32_power_on();
  stm32.now_us = 1000000;
  stm32.slave = slave;
  power_on_sensor();
}

static void take_events(uint32_t from) {
  for (uint32_t i = from; i < bench.n_event; i++)
    if (bench.event[i % 32].code == IMUCAL_EVENT_SENSOR_COUNTED) event_bits |= bench.event[i % 32].detail;
}

static void start_device(void) {
  const stm32_clocks_t clocks = {.core_hz = 168000000, .apb2_hz = 84000000, .tim_hz = 84000000, .is_crystal = true};
  bench.port.time_us = time_us;
  bench.port.sample_enable = NULL;
  bench.port.sample_out = NULL;
  bench.port.is_replay = false;
  memset(&bench.board, 0, sizeof bench.board);
  board_init(&bench.port, &bench.board, &clocks);
  bench_power_cycle(&bench);
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND | IMUCAL_STREAM_EVENT), IMUCAL_OK);
  n_looked = bench.n_second;
  n_seconds = n_wrong = n_marked = event_bits = 0;
  take_events(0);
}

static void look_at_second(void) {
  if (bench.n_second == n_looked) return;
  n_looked = bench.n_second;
  const imucal_link_second_t* second = &bench.second;
  const bool is_right = fabs((double)second->raw[0] - 36000.0) < 60.0 && fabs((double)second->raw[5] - 1000.0) < 1.0 &&
                        fabs((double)second->temp_degc - 31.0) < 0.1;
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
  assert_in_range(bench.app.n_samples - before, 2950, 3050);
  assert_int_equal(sensor_now().status, IMUCAL_OK);
  assert_int_equal(n_wrong, 0);
}

/* ---- tests ---- */

static void test_healthy_board_counts_nothing_and_tells_its_sensor(void** state) {
  (void)state;
  board_on();
  start_device();
  run(5.0);
  const imucal_link_sensor_reply_t now = sensor_now();
  assert_int_equal(now.is_counted, 1);
  assert_string_equal(now.name, "icm42688p");
  assert_int_equal(now.identity, 0x47);
  assert_int_equal(now.starts, 1);
  assert_int_equal(now.wrong_identity + now.bus_errors + now.overruns + now.lost + now.invalid + now.resets, 0);
  assert_int_equal(now.stuck_temp + now.stuck_data + now.supply_refused + now.saturated + now.is_supply_low, 0);
  assert_int_equal(event_bits, 0);
  assert_true(n_seconds >= 4);
  assert_int_equal(n_wrong, 0);
  assert_int_equal(stm32.n_spi_violations + icm.bus.n_violations, 0);
}

static void test_another_chip_is_named_and_the_right_one_taken_when_it_comes(void** state) {
  (void)state;
  board_on();
  icm.who_am_i = 0x12;
  icm.reg[0][0x75] = 0x12;
  start_device();
  run(3.0);
  const imucal_link_sensor_reply_t now = sensor_now();
  assert_int_equal(now.status, IMUCAL_ERR_SENSOR);
  assert_int_equal(now.identity, 0x12);
  assert_true(now.wrong_identity >= 2 && now.starts >= 2);
  assert_int_equal(event_bits, IMUCAL_SENSOR_WRONG_IDENTITY);
  assert_int_equal(bench.app.n_samples, 0);
  assert_true(bench.app.n_bad_samples >= 2);
  power_on_sensor();
  run(2.0);
  assert_works_again();
}

static void test_stuck_bus_is_counted_and_hands_out_nothing(void** state) {
  (void)state;
  for (int fault = EMU_BUS_ZEROS; fault <= EMU_BUS_ONES; fault++) {
    board_on();
    start_device();
    run(2.5);
    icm.bus.fault = fault;
    run(0.2); /* what had been read before */
    const uint32_t before = bench.app.n_samples;
    run(3.0);
    assert_int_equal(bench.app.n_samples, before);
    const imucal_link_sensor_reply_t now = sensor_now();
    assert_int_equal(now.status, IMUCAL_ERR_SENSOR);
    assert_true(now.bus_errors >= 2);
    assert_true(event_bits & IMUCAL_SENSOR_BUS_ERRORS);
    icm.bus.fault = EMU_BUS_GOOD;
    run(2.0);
    assert_works_again();
    assert_in_range(sensor_now().lost, 3000, 5500); /* some 4 s of silence at 1 kHz */
    assert_true(event_bits & IMUCAL_SENSOR_LOST);
  }
}

static void test_dead_spi_is_a_bus_error(void** state) {
  (void)state;
  board_on();
  start_device();
  run(1.5);
  stm32.is_silent = true;
  run(2.0);
  assert_true(sensor_now().bus_errors >= 2);
  assert_true(event_bits & IMUCAL_SENSOR_BUS_ERRORS);
  stm32.is_silent = false;
  run(2.0);
  assert_works_again();
}

static void test_sensor_that_resets_in_the_middle_is_set_up_again(void** state) {
  (void)state;
  board_on();
  start_device();
  run(2.3);
  emu_icm_brown_out(&icm);
  icm.reg[0][0x2D] |= 0x10;
  run(2.0);
  const imucal_link_sensor_reply_t now = sensor_now();
  assert_int_equal(now.resets, 1);
  assert_in_range(now.lost, 40, 200);
  assert_int_equal(event_bits, IMUCAL_SENSOR_RESETS | IMUCAL_SENSOR_LOST);
  assert_works_again();
}

static void test_overrun_is_counted_with_what_it_cost(void** state) {
  (void)state;
  board_on();
  start_device();
  run(2.3);
  stm32.now_us += 400000; /* the main loop was held up: the FIFO holds 102 ms */
  run(2.0);
  const imucal_link_sensor_reply_t now = sensor_now();
  /* A sample that comes while the first burst is read raises the flag again and puts that burst out of step: it is refused
   * and the FIFO begun anew. */
  assert_in_range(now.overruns, 1, 2);
  assert_true(now.invalid < 60);
  assert_in_range(now.lost, 280, 320);
  assert_int_equal(event_bits & ~(uint32_t)IMUCAL_SENSOR_INVALID, IMUCAL_SENSOR_OVERRUNS | IMUCAL_SENSOR_LOST);
  assert_true(n_marked >= 1);
  assert_works_again();
}

static void test_temperature_that_never_changes_marks_every_second(void** state) {
  (void)state;
  board_on();
  icm.is_temp_frozen = true;
  icm.frozen_degc = 31.0;
  start_device();
  run(70.0);
  assert_int_equal(sensor_now().stuck_temp, 1);
  assert_int_equal(event_bits, IMUCAL_SENSOR_STUCK_TEMP);
  assert_true(n_marked >= 8);
  assert_true(bench.second.flags[0] & IMUCAL_FLAG_FAULT);
  icm.is_temp_frozen = false;
  run(2.0);
  n_marked = 0;
  assert_works_again();
  assert_int_equal(n_marked, 0);
}

static void test_low_supply_refuses_a_table_and_says_so(void** state) {
  (void)state;
  board_on();
  start_device();
  run(1.5);
  uint8_t table[IMUCAL_TABLE_MAX_BYTES];
  const size_t n = bench_table(&bench, 100.0f, table);
  assert_int_equal(bench_upload(&bench, table, n), IMUCAL_OK);
  stm32.is_supply_low = true;
  const uint32_t n_erases = stm32.n_erases, n_words = stm32.n_words;
  const size_t m = bench_table(&bench, 200.0f, table);
  assert_int_equal(bench_upload(&bench, table, m), IMUCAL_ERR_SUPPLY);
  assert_int_equal(stm32.n_erases + stm32.n_words, n_erases + n_words);
  run(2.0);
  imucal_link_sensor_reply_t now = sensor_now();
  assert_int_equal(now.is_supply_low, 1);
  assert_true(now.supply_refused >= 1);
  assert_int_equal(event_bits & IMUCAL_SENSOR_SUPPLY, IMUCAL_SENSOR_SUPPLY);
  assert_true(bench_ruling_b0(&bench) == 100.0f);
  stm32.is_supply_low = false;
  assert_int_equal(bench_upload(&bench, table, m), IMUCAL_OK);
  assert_true(bench_ruling_b0(&bench) == 200.0f);
  assert_int_equal(sensor_now().is_supply_low, 0);
}

static void test_events_come_when_a_trouble_begins_and_not_every_second(void** state) {
  (void)state;
  board_on();
  start_device();
  run(1.5);
  icm.bus.fault = EMU_BUS_ZEROS;
  run(8.0);
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
