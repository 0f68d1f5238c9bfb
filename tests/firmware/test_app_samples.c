// SPDX-License-Identifier: MIT
/* Samples in: gating, back-pressure, seconds, what spoils a measurement, a table that changes under way. */
#include <stdlib.h>

#include "bench.h"

static bench_t bench;

static int start(void** state) {
  (void)state;
  bench_start(&bench);
  return 0;
}

static void constant(uint64_t t_us, imucal_sample_t* sample) {
  (void)t_us;
  sample->temp_counts = 500; /* 30 degC */
  for (int i = 0; i < 3; i++) sample->counts[i] = 100 * (i + 1);
}

static const imucal_link_counters_reply_t* counters(void) {
  const imucal_link_counters_t request = {0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_COUNTERS, &request), IMUCAL_LINK_ID_COUNTERS_REPLY);
  return &bench.reply.counters_reply;
}

static const imucal_link_cal_state_reply_t* filter(uint8_t channel) {
  const imucal_link_cal_state_t request = {.channel = channel};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_CAL_STATE, &request), IMUCAL_LINK_ID_CAL_STATE_REPLY);
  return &bench.reply.cal_state_reply;
}

/* ---- replay or live ---- */

static void test_replay_waits_for_the_host(void** state) {
  (void)state;
  bench_feed(&bench, 5);
  assert_int_equal(bench.n_read, 0);
  assert_int_equal(bench_cal_start(&bench, 0, 3), IMUCAL_OK); /* the other channels follow: nothing is read yet */
  assert_int_equal(bench.n_read, 0);
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_EVENT), IMUCAL_OK);
  assert_int_equal(bench.n_read, 0);
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  assert_int_equal(bench.n_read, 500);
  assert_int_equal(bench_stream(&bench, 0), IMUCAL_OK);
  bench_feed(&bench, 5);
  assert_int_equal(bench.n_read, 500);
}

static void test_live_sensor_is_always_read(void** state) {
  (void)state;
  bench.port.is_replay = false;
  bench.shape = constant;
  bench_feed(&bench, 5);
  assert_int_equal(bench.n_read, 500);
  assert_int_equal(bench.last_out[2], 300 << bench.last_frac_bits[2]); /* no table: passed through */
}

static void test_replay_full_line_loses_nothing(void** state) {
  (void)state;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench.n_left = 100 * 100;
  for (int k = 0; k < 4000 && bench.n_second < 99; k++) { /* 7 bytes at a time */
    bench.line_room = 7;
    bench_run(&bench);
  }
  bench.line_room = UINT32_MAX;
  assert_int_equal(bench.n_second, 99);
  assert_int_equal(bench.n_counter_jumps, 0);
  assert_int_equal(counters()->tx_dropped, 0);
}

/* One sample per second, then a gap: the first sample behind it is doubted until the second one.  Every channel reports a
 * fault of its own. */
static void sparse(uint64_t t_us, imucal_sample_t* sample) {
  static const uint8_t stamps_s[] = {10, 11, 12, 20, 21};
  const uint64_t i = t_us / 1000000u;
  sample->t_us = stamps_s[i] * 1000000u;
  sample->n_channels = IMUCAL_MAX_CHANNELS;
  sample->fault = (uint8_t)(1u << i);
}

/* Another of the sensor's counts grows at each look: an event each time. */
static void two_troubles(void* ctx, imucal_link_sensor_reply_t* report) {
  static uint32_t n_looks;
  (void)ctx;
  n_looks++;
  report->overruns = (n_looks + 1) / 2;
  report->bus_errors = n_looks / 2;
}

/* The most that one sample can bring finds room where a replay reads one: two seconds with all their records and events. */
static void test_replay_doubted_sample_ends_two_seconds_and_loses_nothing(void** state) {
  (void)state;
  bench.board.n_channels = IMUCAL_MAX_CHANNELS;
  bench.board.rate_hz = 1;
  for (int i = 3; i < IMUCAL_MAX_CHANNELS; i++) {
    bench.board.channel[i] = bench.board.channel[0];
    bench.board.channel[i].name[1] = (char)('a' + i);
  }
  bench.port.sensor_report = two_troubles;
  bench.shape = sparse;
  bench.step_us = 1000000;
  bench_power_cycle(&bench);
  for (uint8_t i = 0; i < IMUCAL_MAX_CHANNELS; i++) assert_int_equal(bench_cal_start(&bench, i, 3), IMUCAL_OK);
  const imucal_link_stream_t all = {.what = 15, .channels = 63, .period_s = 1};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_STREAM, &all), IMUCAL_OK);
  bench.n_left = 3;
  bench_run(&bench);
  assert_int_equal(bench.n_second, 2);
  const uint32_t n_faults = bench_events(&bench, IMUCAL_EVENT_SENSOR_FAULT);
  bench.line_room = 0; /* what waits is as much as lets a replay go on */
  memset(bench.app.tx, 0, sizeof bench.app.tx);
  bench.app.tx_at = 0, bench.app.tx_end = sizeof bench.app.tx - IMUCAL_APP_BURST_BYTES;
  bench.time_us += 2000000;
  bench.n_left = 2;
  for (int i = 0; i < 5; i++) (void)imucal_app_step(&bench.app);
  assert_int_equal(bench.n_left, 0);
  bench.line_room = UINT32_MAX;
  bench_run(&bench);
  assert_int_equal(bench.n_second, 4);
  assert_int_equal(bench.n_innovation, 4 * IMUCAL_MAX_CHANNELS - 4); /* faulty: not measured */
  assert_int_equal(bench.n_progress, 4);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_SENSOR_FAULT), n_faults + 2);
  assert_int_equal(counters()->tx_dropped, 0);
}

static void test_live_full_line_drops_and_counts(void** state) {
  (void)state;
  bench.port.is_replay = false;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench.line_room = 0;
  bench_feed(&bench, 101);
  assert_int_equal(bench.n_read, 10100);
  bench.line_room = UINT32_MAX;
  bench_run(&bench);
  const uint32_t came = bench.n_second, dropped = counters()->tx_dropped;
  assert_true(came > 0 && dropped > 50);
  assert_int_equal(came + dropped, 100);
  bench_feed(&bench, 2);
  assert_int_equal(bench.n_counter_jumps, 1); /* the host sees by the counter that some are lost */
}

static void test_sensor_end_is_told_and_a_new_stream_starts_anew(void** state) {
  (void)state;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND | IMUCAL_STREAM_EVENT), IMUCAL_OK);
  bench.ends = true;
  bench_feed(&bench, 3);
  assert_int_equal(bench.n_second, 3); /* the running second is finished too */
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_SENSOR_ENDED), 1);
  assert_int_equal(bench.n_enabled, 1);
  bench.t_us = 0; /* the replay begins again: its time stamps run back */
  bench.n_left = 200;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND | IMUCAL_STREAM_EVENT), IMUCAL_OK);
  bench_run(&bench);
  assert_int_equal(bench.n_enabled, 2);
  assert_int_equal(bench.n_second, 5);
  assert_int_equal(bench.second.t_s, 2);
  assert_int_equal(counters()->backward, 0);
}

/* ---- what spoils a second ---- */

static void spoil_one_channel(uint64_t t_us, imucal_sample_t* sample) {
  constant(t_us, sample);
  const uint64_t second = t_us / 1000000;
  if (second == 10 && t_us % 1000000 == 500000) sample->saturated = 1;        /* the sensor says so */
  if (second == 12 && t_us % 1000000 == 500000) sample->counts[0] = -1000000; /* the rail itself */
  if (second == 14 && t_us % 1000000 == 500000) sample->fault = 2;
}

static void test_spoilt_seconds_are_bridged_channel_by_channel(void** state) {
  (void)state;
  for (uint8_t i = 0; i < 3; i++) assert_int_equal(bench_cal_start(&bench, i, 1), IMUCAL_OK);
  bench.shape = spoil_one_channel;
  assert_int_equal(bench_stream(&bench, 15), IMUCAL_OK);
  bench_feed(&bench, 20);
  bench.t_us += 5000000; /* five seconds without a sample */
  bench_feed(&bench, 5);
  assert_int_equal(filter(0)->n, 22); /* of 24 finished seconds, two spoilt */
  assert_int_equal(bench.reply.cal_state_reply.n_missed, 2 + 5);
  assert_int_equal(filter(1)->n, 23);
  assert_int_equal(filter(2)->n, 24);
  assert_int_equal(bench.reply.cal_state_reply.n_missed, 5);
  assert_int_equal(counters()->jumps, 1);
  assert_int_equal(bench_events(&bench, IMUCAL_EVENT_SENSOR_FAULT), 1);
}

static void test_thin_second_is_a_gap(void** state) {
  (void)state;
  assert_int_equal(bench_cal_start(&bench, 0, 1), IMUCAL_OK);
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench_feed(&bench, 2);
  bench.n_left = 30; /* 30 of 100 samples, then the next second */
  bench_run(&bench);
  bench.t_us = 3000000;
  bench_feed(&bench, 1);
  assert_int_equal(bench.second.t_s, 3);
  assert_int_equal(bench.second.is_gap, 1);
  assert_int_equal(bench.second.n_samples, 30);
  assert_int_equal(filter(0)->n, 2);
  assert_int_equal(bench.reply.cal_state_reply.n_missed, 1);
  assert_int_equal(counters()->gaps, 1);
}

static void wrong_number_of_channels(uint64_t t_us, imucal_sample_t* sample) {
  constant(t_us, sample);
  sample->n_channels = 2;
}

static void test_samples_of_another_sensor_are_counted_and_left_out(void** state) {
  (void)state;
  bench.shape = wrong_number_of_channels;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench_feed(&bench, 3);
  assert_int_equal(bench.n_second, 0);
  assert_int_equal(counters()->feed_errors, 300);
}

static void test_backward_and_doubled_time_stamps_are_counted(void** state) {
  (void)state;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench_feed(&bench, 2);
  bench.t_us -= 10000; /* once more the newest */
  bench.n_left = 1;
  bench_run(&bench);
  bench.t_us = 500000; /* long ago */
  bench.n_left = 3;
  bench_run(&bench);
  assert_int_equal(counters()->duplicates, 1);
  assert_int_equal(bench.reply.counters_reply.backward, 3);
}

/* ---- compensation ---- */

static void test_table_changed_in_a_second_compensates_the_rest(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  bench.shape = constant;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench_feed(&bench, 2);
  bench.n_left = 50;
  bench_run(&bench);
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 40.0f, bytes)), IMUCAL_OK);
  bench.n_left = 50;
  bench_run(&bench);
  bench_feed(&bench, 1);
  assert_int_equal(bench.second.t_s, 3);
  assert_true(bench.second.raw[0] == 100.0f && bench.second.out[0] == 60.0f);
  assert_int_equal(bench.second.compensated, 7);
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 30.0f, bytes)), IMUCAL_OK);
  bench_feed(&bench, 1); /* the table changed with the second's last sample: nothing compensated is left of it */
  assert_int_equal(bench.second.t_s, 4);
  assert_int_equal(bench.second.compensated, 0);
  assert_true(bench.second.out[0] == 100.0f);
  bench_feed(&bench, 1);
  assert_true(bench.second.out[0] == 70.0f);
}

static void hot_in_the_middle(uint64_t t_us, imucal_sample_t* sample) {
  constant(t_us, sample);
  if (t_us == 2500000) sample->temp_counts = 4000; /* 65 degC, span 0..60 */
}

static void test_temperature_outside_the_span_is_flagged_for_its_second(void** state) {
  (void)state;
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  assert_int_equal(bench_upload(&bench, bytes, bench_table(&bench, 40.0f, bytes)), IMUCAL_OK);
  bench.shape = hot_in_the_middle;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  for (uint8_t expected_t_s = 1; expected_t_s <= 5; expected_t_s++) {
    bench.n_left = expected_t_s == 1 ? 101 : 100;
    bench_run(&bench);
    assert_int_equal(bench.second.t_s, expected_t_s);
    assert_int_equal(bench.second.temp_clamped, expected_t_s == 3 ? 7 : 0);
  }
}

#define CASE(test) cmocka_unit_test_setup(test, start)

int main(void) {
  const struct CMUnitTest tests[] = {
      CASE(test_replay_waits_for_the_host),
      CASE(test_live_sensor_is_always_read),
      CASE(test_replay_full_line_loses_nothing),
      CASE(test_replay_doubted_sample_ends_two_seconds_and_loses_nothing),
      CASE(test_live_full_line_drops_and_counts),
      CASE(test_sensor_end_is_told_and_a_new_stream_starts_anew),
      CASE(test_spoilt_seconds_are_bridged_channel_by_channel),
      CASE(test_thin_second_is_a_gap),
      CASE(test_samples_of_another_sensor_are_counted_and_left_out),
      CASE(test_backward_and_doubled_time_stamps_are_counted),
      CASE(test_table_changed_in_a_second_compensates_the_rest),
      CASE(test_temperature_outside_the_span_is_flagged_for_its_second),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
