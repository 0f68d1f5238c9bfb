// SPDX-License-Identifier: MIT
/* Driver of the BMI088 against the register-level model of tests/emu/bmi088.h. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "emu/bmi088.h"
#include "sensors/bmi088.h"

static emu_bmi_t bmi;
static imucal_sensor_bus_t bus;
static imucal_bmi088_t sensor;
static imucal_status last_status;
static const imucal_bmi088_config_t usual = {.rate_hz = 1000, .accel_fs_sel = 2};

static void turn(void* ctx, uint64_t k, double t_us, emu_world_t* world) {
  (void)ctx, (void)t_us;
  world->rate_dps[0] = 100.0;
  world->rate_dps[1] = -1900.0;
  world->rate_dps[2] = 0.2 * emu_noise(k, 1);
  world->accel_g[0] = -10.5;
  world->temp_degc = -12.25;
}

static int power_on(void** state) {
  (void)state;
  emu_bmi_power_on(&bmi);
  bmi.bus.feel = turn;
  bus = emu_bmi_bus(&bmi);
  return 0;
}

static uint32_t run(double seconds, double step_us, imucal_sample_t* last) {
  imucal_sample_t samples[40];
  uint32_t total = 0;
  const double end_us = bmi.bus.now_us + seconds * 1e6;
  while (bmi.bus.now_us < end_us) {
    uint32_t n;
    emu_bmi_advance(&bmi, step_us);
    last_status = imucal_bmi088_read(&sensor, (uint64_t)bmi.bus.now_us, samples, 40, &n);
    for (uint32_t i = 0; i < n; i++) {
      if (total + i > 0) assert_true(samples[i].t_us > last->t_us);
      *last = samples[i];
    }
    total += n;
  }
  return total;
}

static void test_both_chips_are_set_up_and_read(void** state) {
  (void)state;
  imucal_sample_t last;
  bmi.acc[0x48] = bmi.gyr[0x3D] = 0x55; /* left there by another program: a reset clears it */
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_OK);
  assert_int_equal(bmi.acc[0x48] | bmi.gyr[0x3D], 0);
  assert_int_equal(bmi.bus.n_violations, 0);
  assert_true(run(3.0, 15000, &last) > 2900);
  assert_int_equal(last.counts[0], 1638);
  assert_int_equal(last.counts[1], -31130);
  assert_int_equal(last.counts[3], -28672);
  assert_int_equal(last.counts[5], 2731);
  const imucal_sensor_units_t units = imucal_bmi088_units(&usual);
  assert_true(fabs((double)(units.dps_per_count * 1638) - 100.0) < 0.05);
  assert_true(fabs((double)(units.g_per_count * 28672) - 10.5) < 0.001);
  assert_true(fabs((double)((float)last.temp_counts * units.degc_per_count + units.degc_at_zero) + 12.25) < 0.001);
  assert_int_equal(last.saturated | last.fault, 0);
}

static void test_settings_the_chip_does_not_have(void** state) {
  (void)state;
  imucal_bmi088_config_t bad = usual;
  bad.rate_hz = 500;
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &bad), IMUCAL_ERR_ARGUMENT);
  bad = usual;
  bad.gyro_fs_sel = 5;
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &bad), IMUCAL_ERR_ARGUMENT);
}

static void test_rails(void** state) {
  (void)state;
  const imucal_bmi088_config_t config = {.rate_hz = 400, .gyro_fs_sel = 1, .accel_fs_sel = 1};
  imucal_sample_t last;
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &config), IMUCAL_OK);
  (void)run(0.5, 15000, &last);
  assert_int_equal(last.saturated, 1u << 1 | 1u << 3);
}

static void test_clock_is_estimated(void** state) {
  (void)state;
  bmi.bus.clock_error = 0.01;
  imucal_sample_t last;
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_OK);
  (void)run(60.0, 15700, &last);
  assert_true(fabs((double)imucal_sensor_clock_drift_ppm(&sensor.clock) - 10000) < 30);
  assert_true(fabs(remainder((double)last.t_us - bmi.next_us, 1000 / 1.01)) < 300.0);
  assert_int_equal(sensor.clock.n_resyncs + sensor.counts.n_lost, 0);
}

static void test_wrong_identities_and_stuck_bus(void** state) {
  (void)state;
  bmi.acc_id = 0x1F; /* BMI085 */
  emu_bmi_reset_accel(&bmi);
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_ERR_SENSOR);
  assert_int_equal(sensor.accel_identity, 0x1F);
  (void)power_on(NULL);
  bmi.gyr_id = 0x0E;
  emu_bmi_reset_gyro(&bmi);
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_ERR_SENSOR);
  assert_int_equal(sensor.gyro_identity, 0x0E);
  const emu_fault_t faults[] = {EMU_BUS_ZEROS, EMU_BUS_ONES, EMU_BUS_ERRORS};
  for (int i = 0; i < 3; i++) {
    (void)power_on(NULL);
    imucal_sample_t last;
    bmi.bus.fault = faults[i];
    assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_ERR_SENSOR);
    assert_true(sensor.counts.n_bus_errors > 0);
    bmi.bus.fault = EMU_BUS_GOOD;
    assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_OK);
    (void)run(0.5, 15000, &last);
    const uint32_t before = sensor.counts.n_samples;
    bmi.bus.fault = faults[i];
    assert_int_equal(run(1.5, 15000, &last), 0);
    assert_int_equal(last_status, IMUCAL_ERR_SENSOR);
    assert_true(sensor.counts.n_bus_errors > 0);
    bmi.bus.fault = EMU_BUS_GOOD;
    (void)run(1.0, 15000, &last);
    assert_true(sensor.counts.n_samples > before + 500);
  }
}

static void test_either_chip_resets_in_the_middle(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_OK);
  (void)run(2.0, 15000, &last);
  emu_bmi_reset_gyro(&bmi);
  (void)run(2.0, 15000, &last);
  assert_int_equal(sensor.counts.n_resets, 1);
  assert_int_equal(last.counts[0], 1638);
  emu_bmi_reset_accel(&bmi); /* its words read as zeros: nothing of that is passed on */
  (void)run(3.0, 15000, &last);
  assert_int_equal(sensor.counts.n_resets, 2);
  assert_int_equal(last.counts[3], -28672);
}

static void test_overrun(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_OK);
  (void)run(10.0, 15000, &last);
  const uint32_t before = sensor.counts.n_samples;
  const uint64_t k = bmi.k;
  emu_bmi_advance(&bmi, 400000.0);
  (void)run(5.0, 15000, &last);
  assert_int_equal(sensor.counts.n_overruns, 1);
  assert_true(abs((int)(sensor.counts.n_samples - before + sensor.counts.n_lost) - (int)(bmi.k - k)) <= 20);
  assert_int_equal(last.counts[0], 1638);
}

static void test_invalid_temperature_and_words_that_stand_still(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_OK);
  (void)run(2.0, 15000, &last);
  assert_int_equal(last.fault, 0);
  bmi.is_temp_invalid = true;
  (void)run(2.0, 15000, &last);
  assert_int_equal(last.fault, 0x3F);
  assert_true(sensor.counts.n_invalid > 0);
  bmi.is_temp_invalid = false;
  (void)run(2.0, 15000, &last);
  assert_int_equal(last.fault, 0);
  bmi.bus.feel = NULL;
  (void)run(2.0, 15000, &last);
  assert_int_equal(last.fault, 0x3F);
  assert_int_equal(sensor.counts.n_stuck_data, 1);
}

static void test_self_test(void** state) {
  (void)state;
  imucal_sensor_self_test_t test;
  bmi.bus.feel = NULL;
  assert_int_equal(imucal_bmi088_start(&sensor, &bus, &usual), IMUCAL_OK);
  assert_int_equal(imucal_bmi088_self_test(&sensor, &test), IMUCAL_OK);
  assert_int_equal(test.failed, 0);
  bmi.st_g[1] = 0.4;
  bmi.is_bist_bad = true;
  assert_int_equal(imucal_bmi088_self_test(&sensor, &test), IMUCAL_OK);
  assert_int_equal(test.failed, 7u | 1u << 4);
  imucal_sample_t last;
  bmi.bus.feel = turn;
  (void)run(0.5, 15000, &last);
  assert_int_equal(last.counts[3], -28672);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_both_chips_are_set_up_and_read, power_on),
      cmocka_unit_test_setup(test_settings_the_chip_does_not_have, power_on),
      cmocka_unit_test_setup(test_rails, power_on),
      cmocka_unit_test_setup(test_clock_is_estimated, power_on),
      cmocka_unit_test_setup(test_wrong_identities_and_stuck_bus, power_on),
      cmocka_unit_test_setup(test_either_chip_resets_in_the_middle, power_on),
      cmocka_unit_test_setup(test_overrun, power_on),
      cmocka_unit_test_setup(test_invalid_temperature_and_words_that_stand_still, power_on),
      cmocka_unit_test_setup(test_self_test, power_on),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
