// SPDX-License-Identifier: MIT
/* Sick sensors on the device: what HEALTH says of each, what is left out; clocks with faults; counts that last. */
#include <math.h>

#include "bench.h"
#include "health.h"

static bench_t bench;

/* 100 samples a second of white noise (36 dph for a mean of 1 s), 5 min at 0 degC, 0.06 degC/s to 60 degC, 5 min. */
#define SOAK_S 300.0
#define TEST_S 1600u

static uint32_t noise_state;

static double normal(void) { /* of 12 uniform numbers */
  double sum = -6.0;
  for (int i = 0; i < 12; i++) sum += (noise_state = noise_state * 1664525u + 1013904223u) * 0x1p-32;
  return sum;
}

static double seconds(uint64_t t_us) {
  return (double)t_us * 1e-6;
}

static double temperature(double t_s) {
  const double temp = (t_s - SOAK_S) * 0.06;
  return temp < 0.0 ? 0.0 : temp > 60.0 ? 60.0 : temp;
}

static void healthy(uint64_t t_us, imucal_sample_t* sample) {
  const double temp = temperature(seconds(t_us));
  sample->temp_counts = (int32_t)lround((temp - 25.0) / 0.01);
  for (int i = 0; i < 3; i++) sample->counts[i] = (int32_t)lround(80.0 + 5.0 * temp + 360.0 * normal());
}

static void always_0(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  sample->counts[0] = 0;
}
static void frozen(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  if (seconds(t_us) > 800.0) sample->counts[0] = 123;
}
static void rail(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  if ((uint64_t)seconds(t_us) % 4 != 0) sample->counts[0] = 1000000;
}
static void faulty(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  if ((uint64_t)seconds(t_us) % 20 == 0) sample->fault = 1;
}
static void stuck_thermometer(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  for (int i = 0; i < 3; i++) sample->counts[i] += (int32_t)lround(20.0 * temperature(seconds(t_us)));
  sample->temp_counts = -2500;
}
static void jumping_thermometer(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  if (seconds(t_us) > 700.0) sample->temp_counts += 800;
}
static void three_times_the_noise(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  sample->counts[0] += (int32_t)lround(1000.0 * normal());
}
static void bump_of_20_s(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  if (seconds(t_us) >= 700.0 && seconds(t_us) < 720.0) sample->counts[0] += 50000;
}
static void bad_second_of_the_thermometer(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  if ((uint64_t)seconds(t_us) == 400) sample->temp_counts = 3500;
}

static int start(void** state) {
  (void)state;
  bench_start(&bench);
  noise_state = 1;
  return 0;
}

static imucal_link_health_reply_t ask(uint8_t channel) {
  const imucal_link_health_t request = {channel};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_HEALTH, &request), IMUCAL_LINK_ID_HEALTH_REPLY);
  return bench.reply.health_reply;
}

static imucal_link_samples_reply_t samples(void) {
  const imucal_link_samples_t request = {0};
  assert_int_equal(bench_ask(&bench, IMUCAL_LINK_ID_SAMPLES, &request), IMUCAL_LINK_ID_SAMPLES_REPLY);
  return bench.reply.samples_reply;
}

/* A whole test on channels 0 and 1; what the device says of channel 0. */
static imucal_link_health_reply_t calibrate(void (*shape)(uint64_t t_us, imucal_sample_t* sample)) {
  bench.shape = shape;
  for (uint8_t i = 0; i < 2; i++) assert_int_equal(bench_cal_start(&bench, i, 1), IMUCAL_OK);
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench_feed(&bench, TEST_S);
  return ask(0);
}

static void test_health_of_healthy_channels_is_clean(void** state) {
  (void)state;
  const imucal_link_health_reply_t health = calibrate(healthy);
  assert_int_equal(health.bits, 0);
  assert_int_equal(health.n, TEST_S - 1); /* the last second has no successor yet */
  assert_int_equal(health.n_used, health.n);
  assert_int_equal(health.n_rules, IMUCAL_HEALTH_N_RULES);
  assert_int_equal(health.judged, (1u << IMUCAL_HEALTH_N_RULES) - 1u);
  assert_true(health.has_span && health.span_lo_degc < 0.1f && health.span_hi_degc > 59.9f);
  assert_true(health.error_factor >= 1.0f && health.error_factor < 1.2f);
  for (uint32_t i = 0; i < health.n_rules; i++) assert_true(isfinite(health.value[i]) && isfinite(health.limit[i]));
}

static void test_health_names_the_fault_and_leaves_the_other_channel_alone(void** state) {
  const struct {
    void (*shape)(uint64_t t_us, imucal_sample_t* sample);
    uint32_t rule;
    bool is_of_all; /* the thermometer is everybody's */
  } faults[] = {{always_0, IMUCAL_HEALTH_NO_NOISE, false},
                {frozen, IMUCAL_HEALTH_REPEATED, false},
                {rail, IMUCAL_HEALTH_SATURATED, false},
                {faulty, IMUCAL_HEALTH_FAULTY, false},
                {stuck_thermometer, IMUCAL_HEALTH_TEMP_STUCK, true},
                {jumping_thermometer, IMUCAL_HEALTH_TEMP_JUMP, true},
                {three_times_the_noise, IMUCAL_HEALTH_NIS, false}};
  for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
    start(state);
    const imucal_link_health_reply_t health = calibrate(faults[i].shape);
    if (!(health.bits >> faults[i].rule & 1u))
      fail_msg("fault %u: bits %x lack %s", (unsigned)i, (unsigned)health.bits,
               imucal_health_rule_name(faults[i].rule));
    assert_true(health.value[faults[i].rule] != health.limit[faults[i].rule]);
    assert_int_equal(ask(1).bits != 0, faults[i].is_of_all);
  }
}

static void test_bump_of_20_s_is_left_out_and_counted(void** state) {
  (void)state;
  const imucal_link_health_reply_t health = calibrate(bump_of_20_s);
  assert_int_equal(health.n_rejected, 20);
  assert_int_equal(ask(1).n_rejected, 0);
  for (int degc = 0; degc <= 60; degc += 10) {
    const float bias = imucal_kf_bias(&bench.app.channel[0].learn.kf, (float)degc);
    assert_true(fabsf(bias - (80.0f + 5.0f * (float)degc)) < 25.0f);
  }
}

static void test_bad_second_of_the_thermometer_does_not_widen_the_span(void** state) {
  (void)state;
  const imucal_link_health_reply_t health = calibrate(bad_second_of_the_thermometer);
  assert_int_equal(health.n_spikes, 1);
  assert_true(health.span_lo_degc > -0.1f && health.span_hi_degc < 60.1f);
}

static void test_health_without_filter_or_channel_is_refused(void** state) {
  (void)state;
  const imucal_link_health_t first = {0}, absent = {9};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_HEALTH, &first), IMUCAL_ERR_STATE);
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_HEALTH, &absent), IMUCAL_ERR_UNKNOWN);
}

static void test_cal_start_with_a_span_no_rule_takes_keeps_the_old_filter(void** state) {
  (void)state;
  (void)calibrate(healthy);
  const imucal_link_cal_stop_t keep = {IMUCAL_STOP_KEEP};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_STOP, &keep), IMUCAL_OK);
  const uint32_t n = bench.app.channel[0].learn.kf.stats.n;
  const imucal_link_cal_start_t wide = {.order = 1,
                                        .t0_degc = 0.0f,
                                        .range_degc = 5000.0f,
                                        .m = 0.01f,
                                        .q = 8.0f,
                                        .r = 1296.0f,
                                        .markov_variance = 400.0f,
                                        .prior_sigma = 1e4f,
                                        .span_lo_degc = -4000.0f,
                                        .span_hi_degc = 4000.0f,
                                        .arw = 0.6f};
  assert_int_equal(bench_done(&bench, IMUCAL_LINK_ID_CAL_START, &wide), IMUCAL_ERR_SPAN);
  assert_int_equal(bench.app.channel[0].learn.kf.stats.n, n);
}

/* ---- clocks ---- */

static uint64_t (*stamp_of)(uint64_t t_us);

static void with_stamp(uint64_t t_us, imucal_sample_t* sample) {
  healthy(t_us, sample);
  sample->t_us = stamp_of(t_us);
}

static uint64_t one_hour_ahead_once(uint64_t t_us) {
  return t_us == 500000000u ? t_us + 3600000000u : t_us;
}
static uint64_t set_back(uint64_t t_us) {
  return t_us >= 500000000u ? t_us - 400000000u : t_us;
}
static uint64_t set_forward(uint64_t t_us) {
  return t_us >= 500000000u ? t_us + 1700000000000000u : t_us;
}
static uint64_t of_32_bits(uint64_t t_us) {
  return (uint32_t)(t_us + 0xFFFFFFFFu - 500000000u);
}

static void test_clock_faults_cost_at_most_2_s(void** state) {
  uint64_t (*const faults[])(uint64_t t_us) = {one_hour_ahead_once, set_back, set_forward, of_32_bits};
  for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
    start(state);
    stamp_of = faults[i];
    const imucal_link_health_reply_t health = calibrate(with_stamp);
    if (bench.app.channel[0].learn.kf.stats.n < TEST_S - 3)
      fail_msg("clock %u: only %u seconds learnt", (unsigned)i, (unsigned)bench.app.channel[0].learn.kf.stats.n);
    assert_int_equal(health.bits, 0);
    const imucal_link_samples_reply_t n = samples();
    assert_int_equal(n.samples, n.summed + n.duplicates + n.behind + n.ahead + n.refused);
    assert_int_equal(n.samples, TEST_S * 100u);
    assert_in_range(n.samples - n.summed, 0, 200);
    assert_int_equal(n.clock_set, faults[i] == set_back);
    assert_int_equal(n.clock_wrapped, faults[i] == of_32_bits);
    if (faults[i] == of_32_bits) assert_int_equal(n.summed, n.samples);
  }
}

static void test_samples_of_wrong_stamp_are_compensated_all_the_same(void** state) {
  (void)state;
  stamp_of = one_hour_ahead_once;
  bench.shape = with_stamp;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  bench.t_us = 499990000u;
  bench.n_left = 2;
  bench_run(&bench);
  assert_true(bench.last_raw.t_us == 4100000000u);
  assert_int_equal(samples().ahead, 1);
}

static void test_counts_outlive_the_end_of_a_stream(void** state) {
  (void)state;
  stamp_of = one_hour_ahead_once;
  bench.shape = with_stamp;
  bench.ends = true;
  bench.t_us = 490000000u;
  bench.n_left = 2000;
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK);
  const imucal_link_samples_reply_t before = samples();
  assert_int_equal(before.ahead, 1);
  assert_int_equal(bench_stream(&bench, 0), IMUCAL_OK);
  const imucal_link_samples_reply_t after = samples();
  assert_memory_equal(&before, &after, sizeof after);
}

#define CASE(test) cmocka_unit_test_setup(test, start)

int main(void) {
  const struct CMUnitTest tests[] = {
      CASE(test_health_of_healthy_channels_is_clean),
      CASE(test_health_names_the_fault_and_leaves_the_other_channel_alone),
      CASE(test_bump_of_20_s_is_left_out_and_counted),
      CASE(test_bad_second_of_the_thermometer_does_not_widen_the_span),
      CASE(test_health_without_filter_or_channel_is_refused),
      CASE(test_cal_start_with_a_span_no_rule_takes_keeps_the_old_filter),
      CASE(test_clock_faults_cost_at_most_2_s),
      CASE(test_samples_of_wrong_stamp_are_compensated_all_the_same),
      CASE(test_counts_outlive_the_end_of_a_stream),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
