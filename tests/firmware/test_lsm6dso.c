// SPDX-License-Identifier: MIT
/* Driver of the LSM6DSO against the register-level model of tests/emu/lsm6dso.h, on SPI and on I2C. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "emu/lsm6dso.h"
#include "sensors/lsm6dso.h"

static emu_lsm_t lsm;
static imucal_sensor_bus_t bus;
static imucal_lsm6dso_t sensor;
static imucal_status last_status;
static bool is_accel_first; /* every test runs with both orders of the words of a time slot */
static const imucal_lsm6dso_config_t usual = {.rate_hz = 417, .gyro_fs_sel = 3, .accel_range_g = 16, .filter = 2};

static void turn(void* ctx, uint64_t k, double t_us, emu_world_t* world) {
  (void)ctx, (void)t_us;
  world->rate_dps[0] = 140.0;
  world->rate_dps[1] = -2250.0;
  world->rate_dps[2] = 0.2 * emu_noise(k, 1);
  world->accel_g[0] = -7.32;
  world->temp_degc = 42.0;
}

static int power_on(void** state) {
  (void)state;
  emu_lsm_power_on(&lsm);
  lsm.bus.feel = turn;
  lsm.is_accel_first = is_accel_first;
  bus = emu_lsm_bus(&lsm, true);
  return 0;
}

static uint32_t run(double seconds, double step_us, imucal_sample_t* last) {
  imucal_sample_t samples[30];
  uint32_t total = 0;
  const double end_us = lsm.bus.now_us + seconds * 1e6;
  while (lsm.bus.now_us < end_us) {
    uint32_t n;
    emu_lsm_advance(&lsm, step_us);
    last_status = imucal_lsm6dso_read(&sensor, (uint64_t)lsm.bus.now_us, samples, 30, &n);
    for (uint32_t i = 0; i < n; i++) {
      if (total + i > 0) assert_true(samples[i].t_us > last->t_us);
      *last = samples[i];
    }
    total += n;
  }
  return total;
}

static void test_words_become_samples_on_both_buses(void** state) {
  (void)state;
  for (int is_spi = 0; is_spi < 2; is_spi++) {
    (void)power_on(NULL);
    bus = emu_lsm_bus(&lsm, is_spi);
    imucal_sample_t last;
    assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_OK);
    assert_int_equal(lsm.bus.n_violations, 0);
    assert_true(run(1.0, 20000, &last) > 390);
    assert_int_equal(last.counts[0], 2000);
    assert_int_equal(last.counts[1], -32143);
    assert_int_equal(last.counts[3], -15000);
    const imucal_sensor_units_t units = imucal_lsm6dso_units(&usual);
    assert_true(fabs((double)(units.dps_per_count * 2000) - 140.0) < 0.001);
    assert_true(fabs((double)(units.g_per_count * 15000) - 7.32) < 0.0001);
    assert_true(fabs((double)((float)last.temp_counts * units.degc_per_count + units.degc_at_zero) - 42.0) < 0.1);
    assert_int_equal(sensor.counts.n_invalid + sensor.counts.n_lost, 0);
    assert_int_equal(last.saturated | last.fault, 0);
  }
}

static void test_ranges_and_settings(void** state) {
  (void)state;
  const uint8_t ranges_g[] = {2, 4, 8, 16};
  for (int i = 0; i < 4; i++) {
    (void)power_on(NULL);
    const imucal_lsm6dso_config_t config = {.rate_hz = 104, .gyro_fs_sel = (uint8_t)i, .accel_range_g = ranges_g[i]};
    imucal_sample_t last;
    assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &config), IMUCAL_OK);
    (void)run(0.5, 50000, &last);
    const imucal_sensor_units_t units = imucal_lsm6dso_units(&config);
    assert_true(fabs((double)(units.dps_per_count * (float)last.counts[0]) - 140.0) < 0.1);
    assert_true(fabs((double)(units.g_per_count * (float)last.counts[5]) - 1.0) < 0.001);
    assert_int_equal(last.saturated, (i < 3 ? 2 : 0) | (ranges_g[i] < 8 ? 8 : 0));
  }
  imucal_lsm6dso_config_t bad = usual;
  bad.rate_hz = 416;
  assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &bad), IMUCAL_ERR_ARGUMENT);
  bad = usual;
  bad.accel_range_g = 3;
  assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &bad), IMUCAL_ERR_ARGUMENT);
}

static void test_clock_starts_from_the_factorys_figure_and_is_estimated(void** state) {
  (void)state;
  lsm.freq_fine = -14; /* -2.1 % */
  emu_lsm_reset_registers(&lsm);
  lsm.bus.clock_error = -0.02;
  imucal_sample_t last;
  assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_OK);
  assert_true(fabs((double)imucal_sensor_clock_drift_ppm(&sensor.clock) + 21000) < 10);
  (void)run(60.0, 21300, &last);
  assert_true(fabs((double)imucal_sensor_clock_drift_ppm(&sensor.clock) + 20000) < 40);
  assert_true(fabs(remainder((double)last.t_us - lsm.next_us, 2400 / 0.98)) < 400.0);
  assert_int_equal(sensor.clock.n_resyncs + sensor.counts.n_lost, 0);
}

static void test_wrong_identity_and_stuck_bus(void** state) {
  (void)state;
  lsm.who_am_i = 0x6B;
  emu_lsm_reset_registers(&lsm);
  assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_ERR_SENSOR);
  assert_int_equal(sensor.identity, 0x6B);
  const emu_fault_t faults[] = {EMU_BUS_ZEROS, EMU_BUS_ONES, EMU_BUS_ERRORS};
  for (int i = 0; i < 3; i++) {
    (void)power_on(NULL);
    imucal_sample_t last;
    lsm.bus.fault = faults[i];
    assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_ERR_SENSOR);
    assert_true(sensor.counts.n_bus_errors > 0);
    lsm.bus.fault = EMU_BUS_GOOD;
    assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_OK);
    (void)run(0.5, 20000, &last);
    const uint32_t before = sensor.counts.n_samples;
    lsm.bus.fault = faults[i];
    assert_int_equal(run(0.5, 20000, &last), 0);
    assert_int_equal(last_status, IMUCAL_ERR_SENSOR);
    assert_true(sensor.counts.n_bus_errors > 0);
    lsm.bus.fault = EMU_BUS_GOOD;
    (void)run(1.5, 20000, &last);
    assert_true(sensor.counts.n_samples > before + 200);
    assert_int_equal(last.counts[0], 2000);
  }
}

static void test_reset_in_the_middle(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_OK);
  (void)run(1.0, 20000, &last);
  emu_lsm_reset_registers(&lsm);
  (void)run(2.0, 20000, &last);
  assert_int_equal(sensor.counts.n_resets, 1);
  assert_int_equal(last.counts[0], 2000);
  assert_true(sensor.counts.n_lost > 60 && sensor.counts.n_lost < 200);
}

static void test_overrun_is_counted_and_pairs_are_found_again(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_OK);
  (void)run(20.0, 20000, &last);
  const uint32_t before = sensor.counts.n_samples;
  const uint64_t k = lsm.k;
  emu_lsm_advance(&lsm, 1500000.0);
  (void)run(5.0, 20000, &last);
  assert_true(sensor.counts.n_overruns >= 1);
  assert_int_equal(last.counts[0], 2000);
  assert_int_equal(sensor.clock.n_resyncs, 0);
  assert_true(abs((int)(sensor.counts.n_samples - before + sensor.counts.n_lost) - (int)(lsm.k - k)) <= 4);
}

static void test_damaged_words_are_refused(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_OK);
  (void)run(0.5, 20000, &last);
  emu_lsm_advance(&lsm, 30000);
  assert_true(lsm.n_words > 8);
  const uint32_t first =
      lsm.word[lsm.first][0] >> 3 == (is_accel_first ? 2 : 1) ? lsm.first : (lsm.first + 1) % LSM_WORDS;
  lsm.word[first][0] ^= 0x01;                       /* parity: this word, and its partner finds none */
  lsm.word[(first + 2) % LSM_WORDS][0] ^= 0x05;     /* another time slot, parity right: not a pair */
  lsm.word[(first + 5) % LSM_WORDS][0] = 0x03 << 3; /* temperature, which nobody asked for ... */
  run(0.02, 20000, &last);
  assert_int_equal(sensor.counts.n_invalid, 5);
  assert_int_equal(last.counts[0], 2000);
}

static void test_frozen_temperature_and_words(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_OK);
  lsm.is_temp_frozen = true;
  (void)run(57.0, 50000, &last);
  assert_int_equal(last.fault, 0);
  (void)run(6.0, 50000, &last);
  assert_int_equal(last.fault, 0x3F);
  assert_int_equal(sensor.counts.n_stuck_temp, 1);
  lsm.is_temp_frozen = false;
  lsm.bus.feel = NULL;
  (void)run(2.0, 50000, &last);
  assert_int_equal(sensor.counts.n_stuck_data, 1);
}

static void test_self_test(void** state) {
  (void)state;
  imucal_sensor_self_test_t test;
  lsm.bus.feel = NULL;
  assert_int_equal(imucal_lsm6dso_start(&sensor, &bus, &usual), IMUCAL_OK);
  assert_int_equal(imucal_lsm6dso_self_test(&sensor, &test), IMUCAL_OK);
  assert_int_equal(test.failed, 0);
  lsm.st_dps[0] = 100;
  lsm.st_g[2] = 1.9;
  assert_int_equal(imucal_lsm6dso_self_test(&sensor, &test), IMUCAL_OK);
  assert_int_equal(test.failed, 1u | 1u << 5);
  imucal_sample_t last;
  lsm.bus.feel = turn;
  (void)run(0.3, 20000, &last);
  assert_int_equal(last.counts[0], 2000);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_words_become_samples_on_both_buses, power_on),
      cmocka_unit_test_setup(test_ranges_and_settings, power_on),
      cmocka_unit_test_setup(test_clock_starts_from_the_factorys_figure_and_is_estimated, power_on),
      cmocka_unit_test_setup(test_wrong_identity_and_stuck_bus, power_on),
      cmocka_unit_test_setup(test_reset_in_the_middle, power_on),
      cmocka_unit_test_setup(test_overrun_is_counted_and_pairs_are_found_again, power_on),
      cmocka_unit_test_setup(test_damaged_words_are_refused, power_on),
      cmocka_unit_test_setup(test_frozen_temperature_and_words, power_on),
      cmocka_unit_test_setup(test_self_test, power_on),
  };
  const int failed = cmocka_run_group_tests_name("gyro word first", tests, NULL, NULL);
  is_accel_first = true;
  return failed + cmocka_run_group_tests_name("accelerometer word first", tests, NULL, NULL);
}
