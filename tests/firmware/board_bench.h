// SPDX-License-Identifier: MIT
/* A board of the STM32F405 on the bench: its own sources (board_chip.c and what a test includes beside it, after this file) over
 * the register model, the app and the host's end of its line.  board_start: power on; board_watch: from then on each second
 * that the board streams is held against what its sensor feels. */
#ifndef IMUCAL_TESTS_BOARD_BENCH_H
#define IMUCAL_TESTS_BOARD_BENCH_H
#include "bench.h"
#include "emu/sensor_bus.h"
#include "emu/stm32f405.h"
#include "port/stm32f405/board.h"

static bench_t bench;

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

static inline uint64_t board_time_us(void* ctx) {
  (void)ctx;
  return stm32.now_us;
}

static inline void board_start(void) {
  static const stm32_clocks_t clocks = {
      .core_hz = 168000000, .apb1_hz = 42000000, .apb2_hz = 84000000, .tim_hz = 84000000, .is_crystal = true};
  bench.port.time_us = board_time_us;
  bench.port.sample_enable = NULL;
  bench.port.sample_out = NULL;
  bench.port.is_replay = false;
  memset(&bench.board, 0, sizeof bench.board);
  board_init(&bench.port, &bench.board, &clocks);
  bench_power_cycle(&bench);
}

static inline imucal_link_sensor_reply_t board_sensor_now(void) {
  const imucal_link_sensor_t request = {0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_SENSOR, &request), IMUCAL_LINK_ID_SENSOR_REPLY);
  return bench.reply.sensor_reply;
}

/* ---- with a sensor ---- */

/* What the sensor feels is 36000 dph on channel 0, 1000 mg on channel 5 and this temperature, with a little noise; a second is
 * right within these, and so many samples come in 3 s. */
typedef struct board_truth {
  double temp_degc, within_dph, within_mg;
  uint32_t n_least, n_most;
} board_truth_t;

static struct {
  const board_truth_t* truth;
  uint32_t n_seconds, n_wrong, n_marked; /* seconds seen; without a mark and off; with one */
  uint32_t n_looked;                     /* seconds of the bench already looked at */
  uint32_t event_bits;                   /* of all events SENSOR_COUNTED */
} seen;

/* For emu_bus_t; ctx: the board_truth_t. */
static inline void board_world(void* ctx, uint64_t k, double t_us, emu_world_t* w) {
  (void)t_us;
  w->temp_degc = ((const board_truth_t*)ctx)->temp_degc;
  w->rate_dps[0] = 10.0 + 0.06 * emu_noise(k, 1);
  w->accel_g[2] = 1.0 + 0.002 * emu_noise(k, 2);
}

/* The sensor's bus, right after the sensor's power came on. */
static inline void board_sensor_feels(emu_bus_t* bus, const board_truth_t* truth) {
  static board_truth_t felt;
  felt = *truth;
  bus->feel = board_world;
  bus->feel_ctx = &felt;
  bus->now_us = (double)stm32.now_us;
}

static inline void board_take_events(uint32_t from) {
  for (uint32_t i = from; i < bench.n_event; i++)
    if (bench.event[i % 32].code == IMUCAL_EVENT_SENSOR_COUNTED) seen.event_bits |= bench.event[i % 32].detail;
}

static inline void board_watch(const board_truth_t* truth) {
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND | IMUCAL_STREAM_EVENT), IMUCAL_OK);
  memset(&seen, 0, sizeof seen);
  seen.truth = truth;
  seen.n_looked = bench.n_second;
  board_take_events(0);
}

static inline void board_look_at_second(void) {
  if (bench.n_second == seen.n_looked) return;
  seen.n_looked = bench.n_second;
  const imucal_link_second_t* second = &bench.second;
  const bool is_right = fabs((double)second->raw[0] - 36000.0) < seen.truth->within_dph &&
                        fabs((double)second->raw[5] - 1000.0) < seen.truth->within_mg &&
                        fabs((double)second->temp_degc - seen.truth->temp_degc) < 0.1;
  const bool is_marked = second->is_gap || second->flags[0] != 0;
  seen.n_seconds++;
  seen.n_marked += is_marked;
  if (!is_right && !is_marked)
    print_message("t %u n %u raw %g %g temp %g\n", second->t_s, second->n_samples, (double)second->raw[0],
                  (double)second->raw[5], (double)second->temp_degc);
  seen.n_wrong += !is_right && !(second->is_gap || second->flags[0] & (IMUCAL_FLAG_FAULT | IMUCAL_FLAG_SATURATED));
}

static inline void board_run(double seconds) {
  const uint64_t end_us = stm32.now_us + (uint64_t)(seconds * 1e6);
  while (stm32.now_us < end_us) {
    const uint32_t n_event = bench.n_event;
    if (!imucal_app_step(&bench.app)) stm32.now_us += 500;
    board_look_at_second();
    board_take_events(n_event);
  }
}

/* ---- what holds for every sensor ---- */

/* Five seconds after the start. */
static inline void assert_board_healthy(const char* name, uint32_t identity) {
  const imucal_link_sensor_reply_t now = board_sensor_now();
  assert_int_equal(now.is_counted, 1);
  assert_string_equal(now.name, name);
  assert_int_equal(now.identity, identity);
  assert_int_equal(now.starts, 1);
  assert_int_equal(now.wrong_identity + now.bus_errors + now.overruns + now.lost + now.invalid + now.resets, 0);
  assert_int_equal(now.stuck_temp + now.stuck_data + now.supply_refused + now.saturated + now.is_supply_low, 0);
  assert_int_equal(seen.event_bits, 0);
  assert_true(seen.n_seconds >= 4);
  assert_int_equal(seen.n_wrong, 0);
}

/* Three seconds after a start with a chip of this identity in the sensor's place. */
static inline void assert_board_refuses_identity(uint32_t identity) {
  const imucal_link_sensor_reply_t now = board_sensor_now();
  assert_int_equal(now.status, IMUCAL_ERR_SENSOR);
  assert_int_equal(now.identity, identity);
  assert_true(now.wrong_identity >= 2 && now.starts >= 2);
  assert_int_equal(seen.event_bits, IMUCAL_SENSOR_WRONG_IDENTITY);
  assert_int_equal(bench.app.n_samples, 0);
  assert_true(bench.app.n_bad_samples >= 2);
}

/* On a bus that has just been broken: three seconds without a sample, counted and told. */
static inline void assert_board_hands_out_nothing(void) {
  board_run(0.2); /* what had been read before */
  const uint32_t before = bench.app.n_samples;
  board_run(3.0);
  assert_int_equal(bench.app.n_samples, before);
  const imucal_link_sensor_reply_t now = board_sensor_now();
  assert_int_equal(now.status, IMUCAL_ERR_SENSOR);
  assert_true(now.bus_errors >= 2);
  assert_true(seen.event_bits & IMUCAL_SENSOR_BUS_ERRORS);
}

static inline void assert_board_works_again(void) {
  const uint32_t before = bench.app.n_samples;
  board_run(3.0);
  assert_in_range(bench.app.n_samples - before, seen.truth->n_least, seen.truth->n_most);
  assert_int_equal(board_sensor_now().status, IMUCAL_OK);
  assert_int_equal(seen.n_wrong, 0);
}
#endif
