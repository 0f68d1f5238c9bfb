// SPDX-License-Identifier: MIT
// learn: what becomes of a second, with its count; the filter's state as by the filter's own calls, bit for
// bit.
#include "unit.h"

#include "learn.h"

enum { RATE_HZ = 10 };

static const imucal_kf_config_t kConfig = {.order = 2,
                                           .t0_degc = 30,
                                           .range_degc = 30,
                                           .m = 0.01f,
                                           .q = 8,
                                           .r = 1296,
                                           .markov_variance = 400,
                                           .prior_sigma = 1e4f};

typedef struct {
  imucal_sum_t sum;
  imucal_second_t second;
  imucal_thermometer_t thermometer;
  imucal_learn_t learn;
  imucal_kf_t kf; /* what the filter must be */
} device_t;

static void start(device_t* device, float degc_per_count) {
  assert_int_equal(imucal_sum_init(&device->sum, 2, RATE_HZ), IMUCAL_OK);
  imucal_thermometer_init(&device->thermometer, degc_per_count, 10.0f);
  assert_int_equal(imucal_learn_init(&device->learn, &kConfig), IMUCAL_OK);
  assert_int_equal(imucal_kf_init(&device->kf, &kConfig), IMUCAL_OK);
}

/* A second of n samples, all of them `counts` and `temp_counts`; `flags` are those of channel 1. */
static imucal_learn_outcome_t second_of(device_t* device, uint32_t n, int32_t temp_counts, float value, uint8_t flags,
                                        uint32_t n_skipped) {
  device->second = (imucal_second_t){.temp_sum = (int64_t)temp_counts * n,
                                     .n_samples = n,
                                     .n_skipped = n_skipped,
                                     .n_channels = 2,
                                     .flags = {0, flags},
                                     .is_gap = 2 * n < RATE_HZ};
  imucal_thermometer_read(&device->thermometer, &device->second);
  return imucal_learn_second(&device->learn, &device->thermometer, &device->sum, &device->second, 1, value);
}

static void expect_filter(const device_t* device) {
  assert_memory_equal(&device->learn.kf, &device->kf, sizeof device->kf);
}

static void test_whole_second_is_one_update(void** state) {
  (void)state;
  device_t device;
  start(&device, 0.01f);
  assert_int_equal(second_of(&device, RATE_HZ, 2000, 50.0f, 0, 0), IMUCAL_LEARN_USED);
  assert_int_equal(imucal_kf_update(&device.kf, 50.0f, 30.0f), IMUCAL_OK);
  assert_true(device.thermometer.temp_degc == 30.0f && device.thermometer.is_sure);
  expect_filter(&device);
  assert_int_equal(device.learn.n[IMUCAL_LEARN_USED], 1);
  assert_int_equal(device.learn.n_gap_s, 0);
}

static void test_skipped_seconds_are_bridged_before_the_update(void** state) {
  (void)state;
  device_t device;
  start(&device, 0.01f);
  assert_int_equal(second_of(&device, RATE_HZ, 1000, 50.0f, 0, 0), IMUCAL_LEARN_USED);
  assert_int_equal(second_of(&device, RATE_HZ, 2000, 70.0f, 0, 13), IMUCAL_LEARN_USED);
  assert_int_equal(imucal_kf_update(&device.kf, 50.0f, 20.0f), IMUCAL_OK);
  assert_int_equal(imucal_kf_skip(&device.kf, 13), IMUCAL_OK);
  assert_int_equal(imucal_kf_update(&device.kf, 70.0f, 30.0f), IMUCAL_OK);
  expect_filter(&device);
  assert_int_equal(device.learn.n_gap_s, 13);
}

static void test_lost_samples_raise_the_noise(void** state) {
  (void)state;
  device_t device;
  start(&device, 0.01f);
  assert_int_equal(second_of(&device, 8, 2000, 50.0f, IMUCAL_FLAG_MISSING, 0), IMUCAL_LEARN_USED);
  assert_int_equal(imucal_kf_update_scaled(&device.kf, 50.0f, 30.0f, 1.25f), IMUCAL_OK);
  expect_filter(&device);
}

/* Each reason alone: bridged by one second, counted under its own name and nowhere else. */
static void test_each_reason_bridges_and_has_its_count(void** state) {
  (void)state;
  const struct {
    uint32_t n;
    float value;
    uint8_t flags;
    imucal_learn_outcome_t outcome;
  } cases[] = {{4, 50, IMUCAL_FLAG_MISSING, IMUCAL_LEARN_MISSING},
               {RATE_HZ, 50, IMUCAL_FLAG_FAULT, IMUCAL_LEARN_FAULT},
               {RATE_HZ, 50, IMUCAL_FLAG_SATURATED, IMUCAL_LEARN_SATURATED},
               {RATE_HZ, 2e7f, 0, IMUCAL_LEARN_REFUSED},
               {RATE_HZ, NAN, 0, IMUCAL_LEARN_REFUSED},
               /* several: the first one counts */
               {4, 50, IMUCAL_FLAG_FAULT | IMUCAL_FLAG_SATURATED, IMUCAL_LEARN_MISSING},
               {RATE_HZ, 50, IMUCAL_FLAG_FAULT | IMUCAL_FLAG_SATURATED, IMUCAL_LEARN_FAULT}};
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    device_t device;
    start(&device, 0.01f);
    assert_int_equal(second_of(&device, RATE_HZ, 2000, 50.0f, 0, 0), IMUCAL_LEARN_USED);
    assert_int_equal(second_of(&device, cases[i].n, 2000, cases[i].value, cases[i].flags, 3), cases[i].outcome);
    assert_int_equal(imucal_kf_update(&device.kf, 50.0f, 30.0f), IMUCAL_OK);
    assert_int_equal(imucal_kf_skip(&device.kf, 3), IMUCAL_OK);
    if (cases[i].outcome == IMUCAL_LEARN_REFUSED) device.kf.stats.n_refused = 1;
    assert_int_equal(imucal_kf_skip(&device.kf, 1), IMUCAL_OK);
    expect_filter(&device);
    assert_int_equal(device.learn.n_gap_s, 3);
    for (int k = 0; k < IMUCAL_LEARN_N_OUTCOMES; k++)
      assert_int_equal(device.learn.n[k], k == IMUCAL_LEARN_USED || k == (int)cases[i].outcome);
  }
}

/* The other channel's flags are not this one's. */
static void test_flags_are_of_the_channel_asked(void** state) {
  (void)state;
  device_t device;
  start(&device, 0.01f);
  imucal_learn_t first;
  assert_int_equal(imucal_learn_init(&first, &kConfig), IMUCAL_OK);
  assert_int_equal(second_of(&device, RATE_HZ, 2000, 50.0f, IMUCAL_FLAG_FAULT, 0), IMUCAL_LEARN_FAULT);
  assert_int_equal(imucal_learn_second(&first, &device.thermometer, &device.sum, &device.second, 0, 50.0f),
                   IMUCAL_LEARN_USED);
}

/* GIVEN a thermometer of 1 degC; WHEN its reading has passed one step; THEN the seconds are left out until
 * the next. */
static void test_coarse_thermometer_is_tracked_and_unsure_seconds_are_left_out(void** state) {
  (void)state;
  device_t device;
  imucal_track_t track;
  start(&device, 1.0f);
  assert_true(device.thermometer.is_tracked);
  imucal_track_init(&track);
  uint32_t n_unsure = 0;
  for (int t = 0; t < 400; t++) {
    const int32_t temp_counts = t < 100 ? 20 : 20 + (t + 40) / 80;
    const uint32_t n_skipped = t % 50 == 30 ? 2 : 0;
    const imucal_learn_outcome_t outcome = second_of(&device, RATE_HZ, temp_counts, 5.0f, 0, n_skipped);
    imucal_track_skip(&track, n_skipped);
    const int64_t temp_q16 = imucal_track_update(&track, (int64_t)temp_counts * 65536);
    assert_true(device.thermometer.temp_degc == imucal_unit_from_q16(temp_q16, 1.0f, 10.0f));
    assert_int_equal(outcome, track.is_sure ? IMUCAL_LEARN_USED : IMUCAL_LEARN_TEMPERATURE);
    n_unsure += !track.is_sure;
  }
  assert_in_range(n_unsure, 50, 200);
  assert_int_equal(device.learn.n[IMUCAL_LEARN_TEMPERATURE], n_unsure);
}

static void test_thermometer_is_tracked_above_the_coarse_quantum_only(void** state) {
  (void)state;
  imucal_thermometer_t thermometer;
  imucal_thermometer_init(&thermometer, IMUCAL_TRACK_COARSE_DEGC, 0.0f);
  assert_false(thermometer.is_tracked);
  imucal_thermometer_init(&thermometer, 0.1001f, 0.0f);
  assert_true(thermometer.is_tracked);
}

/* The longest gaps that can be said: e is its stationary self again, and nothing is refused. */
static void test_take_gap_of_any_length_is_bridged(void** state) {
  (void)state;
  const uint32_t gaps[] = {IMUCAL_KF_MAX_GAP_S - 1u, IMUCAL_KF_MAX_GAP_S, IMUCAL_KF_MAX_GAP_S + 1u, UINT32_MAX};
  for (int i = 0; i < 4; i++) {
    device_t device;
    start(&device, 0.01f);
    imucal_learn_input_t input = {.value = 50.0f, .temp_degc = 30.0f, .noise_ratio = 1.0f};
    assert_int_equal(imucal_learn_take(&device.learn, &input), IMUCAL_LEARN_USED);
    input.gap_s = gaps[i];
    assert_int_equal(imucal_learn_take(&device.learn, &input), IMUCAL_LEARN_USED);
    assert_int_equal(imucal_kf_update(&device.kf, 50.0f, 30.0f), IMUCAL_OK);
    assert_int_equal(imucal_kf_skip(&device.kf, i == 0 ? gaps[0] : IMUCAL_KF_MAX_GAP_S), IMUCAL_OK);
    assert_int_equal(imucal_kf_update(&device.kf, 50.0f, 30.0f), IMUCAL_OK);
    expect_filter(&device);
    assert_int_equal(device.learn.n_gap_s, gaps[i]);
  }
}

static void test_take_verdict_against_is_bridged_not_learnt(void** state) {
  (void)state;
  device_t device;
  start(&device, 0.01f);
  const imucal_learn_input_t input = {
      .value = 50.0f, .temp_degc = 30.0f, .noise_ratio = 1.0f, .gap_s = 2, .verdict = IMUCAL_LEARN_MISSING};
  assert_int_equal(imucal_learn_take(&device.learn, &input), IMUCAL_LEARN_MISSING);
  assert_int_equal(imucal_kf_skip(&device.kf, 2), IMUCAL_OK);
  assert_int_equal(imucal_kf_skip(&device.kf, 1), IMUCAL_OK);
  expect_filter(&device);
}

static void test_init_refusals_change_nothing_and_a_new_start_counts_anew(void** state) {
  (void)state;
  imucal_learn_t learn, before;
  imucal_kf_config_t bad = kConfig;
  bad.order = 0;
  assert_int_equal(imucal_learn_init(NULL, &kConfig), IMUCAL_ERR_ARGUMENT);
  memset(&learn, 0x5A, sizeof learn);
  before = learn;
  assert_int_equal(imucal_learn_init(&learn, &bad), IMUCAL_ERR_ORDER);
  assert_memory_equal(&learn, &before, sizeof learn);
  assert_int_equal(imucal_learn_init(&learn, &kConfig), IMUCAL_OK);
  for (int k = 0; k < IMUCAL_LEARN_N_OUTCOMES; k++) assert_int_equal(learn.n[k], 0);
  assert_int_equal(learn.n_gap_s, 0);
}

static void test_take_before_init_is_refused(void** state) {
  (void)state;
  imucal_learn_t learn = {0};
  const imucal_learn_input_t input = {.value = 50.0f, .temp_degc = 30.0f, .noise_ratio = 1.0f, .gap_s = 2};
  assert_int_equal(imucal_learn_take(&learn, &input), IMUCAL_LEARN_REFUSED);
  assert_int_equal(learn.kf.stats.n_missed, 0);
}

/* ---- with the gate and the temperature's own ---- */

enum { N_WARM = IMUCAL_HEALTH_UNGATED_N + 4 }; /* the gate has closed */

/* A filter that knows 50 dph at 30 degC, and its health. */
static void start_checked(device_t* device, imucal_health_t* health) {
  const imucal_health_config_t config = {.r = 1296, .markov_variance = 400, .lo_degc = 0, .hi_degc = 60};
  start(device, 0.01f);
  assert_int_equal(imucal_health_init(health, &config), IMUCAL_OK);
  for (int k = 0; k < N_WARM; k++) {
    const imucal_learn_input_t input = {.value = 50.0f, .temp_degc = 30.0f, .noise_ratio = 1.0f};
    assert_int_equal(imucal_learn_checked(&device->learn, health, &input, 0), IMUCAL_LEARN_USED);
    assert_int_equal(imucal_kf_update(&device->kf, 50.0f, 30.0f), IMUCAL_OK);
  }
  expect_filter(device);
  assert_int_equal(device->learn.n[IMUCAL_LEARN_USED], N_WARM);
  assert_int_equal(health->n_used, N_WARM);
  assert_int_equal(health->n_innovations, N_WARM);
}

static void test_checked_knock_is_bridged_and_counted(void** state) {
  (void)state;
  device_t device;
  imucal_health_t health;
  start_checked(&device, &health);
  const imucal_learn_input_t knock = {.value = 1e5f, .temp_degc = 30.0f, .noise_ratio = 1.0f, .gap_s = 7};
  assert_int_equal(imucal_learn_checked(&device.learn, &health, &knock, 0), IMUCAL_LEARN_KNOCK);
  assert_int_equal(imucal_kf_skip(&device.kf, 7), IMUCAL_OK);
  assert_int_equal(imucal_kf_skip(&device.kf, 1), IMUCAL_OK);
  expect_filter(&device);
  assert_int_equal(device.learn.n[IMUCAL_LEARN_USED], N_WARM);
  assert_int_equal(device.learn.n[IMUCAL_LEARN_KNOCK], 1);
  assert_int_equal(device.learn.n_gap_s, 7);
  assert_int_equal(health.n_rejected, 1);
}

static void test_checked_implausible_temperature_is_bridged(void** state) {
  (void)state;
  device_t device;
  imucal_health_t health;
  start_checked(&device, &health);
  const imucal_learn_input_t jump = {.value = 50.0f, .temp_degc = 45.0f, .noise_ratio = 1.0f};
  assert_int_equal(imucal_learn_checked(&device.learn, &health, &jump, 0), IMUCAL_LEARN_TEMPERATURE);
  assert_int_equal(imucal_kf_skip(&device.kf, 1), IMUCAL_OK);
  expect_filter(&device);
  assert_int_equal(device.learn.n[IMUCAL_LEARN_TEMPERATURE], 1);
  assert_int_equal(device.learn.n[IMUCAL_LEARN_USED], N_WARM);
  assert_int_equal(health.n_innovations, N_WARM);
}

/* What is no measurement keeps its own reason, however odd its temperature, and the gate is not asked. */
static void test_checked_no_measurement_keeps_its_reason(void** state) {
  (void)state;
  device_t device;
  imucal_health_t health;
  start_checked(&device, &health);
  imucal_learn_input_t input = {
      .value = 1e5f, .temp_degc = 45.0f, .noise_ratio = 1.0f, .verdict = IMUCAL_LEARN_SATURATED};
  assert_int_equal(imucal_learn_checked(&device.learn, &health, &input, IMUCAL_FLAG_SATURATED), IMUCAL_LEARN_SATURATED);
  assert_int_equal(imucal_kf_skip(&device.kf, 1), IMUCAL_OK);
  input = (imucal_learn_input_t){.value = NAN, .temp_degc = 30.0f, .noise_ratio = 1.0f};
  assert_int_equal(imucal_learn_checked(&device.learn, &health, &input, 0), IMUCAL_LEARN_REFUSED);
  assert_int_equal(device.learn.n[IMUCAL_LEARN_SATURATED], 1);
  assert_int_equal(device.learn.n[IMUCAL_LEARN_REFUSED], 1);
  assert_int_equal(device.learn.n[IMUCAL_LEARN_KNOCK], 0);
  assert_int_equal(health.n_saturated, 1);
  assert_int_equal(health.n_used, N_WARM);
  assert_int_equal(health.n_gated, N_WARM);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_checked_knock_is_bridged_and_counted),
      cmocka_unit_test(test_checked_implausible_temperature_is_bridged),
      cmocka_unit_test(test_checked_no_measurement_keeps_its_reason),
      cmocka_unit_test(test_whole_second_is_one_update),
      cmocka_unit_test(test_skipped_seconds_are_bridged_before_the_update),
      cmocka_unit_test(test_lost_samples_raise_the_noise),
      cmocka_unit_test(test_each_reason_bridges_and_has_its_count),
      cmocka_unit_test(test_flags_are_of_the_channel_asked),
      cmocka_unit_test(test_coarse_thermometer_is_tracked_and_unsure_seconds_are_left_out),
      cmocka_unit_test(test_thermometer_is_tracked_above_the_coarse_quantum_only),
      cmocka_unit_test(test_take_gap_of_any_length_is_bridged),
      cmocka_unit_test(test_take_verdict_against_is_bridged_not_learnt),
      cmocka_unit_test(test_init_refusals_change_nothing_and_a_new_start_counts_anew),
      cmocka_unit_test(test_take_before_init_is_refused),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
