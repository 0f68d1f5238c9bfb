// SPDX-License-Identifier: MIT
/* Driver of the MPU-6050 and MPU-6500 against the register-level model of tests/emu/mpu6050.h. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "emu/mpu6050.h"
#include "sensors/mpu6050.h"

static emu_mpu_t mpu;
static imucal_sensor_bus_t bus;
static imucal_mpu6050_t sensor;
static imucal_status last_status;
static const imucal_mpu6050_config_t usual = {.rate_hz = 200, .gyro_fs_sel = 3, .accel_fs_sel = 2, .filter = 3};

static void turn(void* ctx, uint64_t k, double t_us, emu_world_t* world) {
  (void)ctx, (void)t_us;
  world->rate_dps[0] = 100.0;
  world->rate_dps[1] = -1999.0;
  world->rate_dps[2] = 0.07 * emu_noise(k, 1);
  world->accel_g[0] = -7.5;
  world->temp_degc = 42.0;
}

static int power_on(void** state) {
  (void)state;
  emu_mpu_power_on(&mpu, false);
  mpu.bus.feel = turn;
  bus = emu_mpu_bus(&mpu);
  return 0;
}

static uint32_t run(double seconds, double step_us, imucal_sample_t* last) {
  imucal_sample_t samples[40];
  uint32_t total = 0;
  const double end_us = mpu.bus.now_us + seconds * 1e6;
  while (mpu.bus.now_us < end_us) {
    uint32_t n;
    emu_mpu_advance(&mpu, step_us);
    last_status = imucal_mpu6050_read(&sensor, (uint64_t)mpu.bus.now_us, samples, 40, &n);
    for (uint32_t i = 0; i < n; i++) {
      if (total + i > 0) assert_true(samples[i].t_us > last->t_us);
      *last = samples[i];
    }
    total += n;
  }
  return total;
}

static void test_both_chips_are_told_apart_and_read(void** state) {
  (void)state;
  for (int is_6500 = 0; is_6500 < 2; is_6500++) {
    emu_mpu_power_on(&mpu, is_6500);
    mpu.bus.feel = turn;
    imucal_sample_t last;
    assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_OK);
    assert_int_equal(sensor.is_6500, is_6500);
    assert_true(mpu.reset_until_us > 0); /* it was reset first */
    assert_int_equal(mpu.bus.n_violations, 0);
    assert_true(run(1.0, 20000, &last) > 185);
    assert_int_equal(last.counts[0], 1638);
    assert_int_equal(last.counts[1], -32752);
    assert_int_equal(last.counts[3], -30720);
    assert_int_equal(last.counts[5], 4096);
    const imucal_sensor_units_t units = imucal_mpu6050_units(&sensor);
    assert_true(fabs((double)((float)last.temp_counts * units.degc_per_count + units.degc_at_zero) - 42.0) < 0.05);
    assert_int_equal(last.saturated | last.fault, 0);
  }
}

static void power_on_6500_on_spi(void) {
  emu_mpu_power_on(&mpu, true);
  mpu.is_spi = true;
  mpu.bus.feel = turn;
  bus = emu_mpu_bus(&mpu);
}

static void test_mpu6500_on_spi(void** state) {
  (void)state;
  imucal_sample_t last;
  power_on_6500_on_spi();
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_OK);
  assert_true(run(1.0, 20000, &last) > 185);
  assert_int_equal(last.counts[0], 1638);
  assert_int_equal(last.counts[3], -30720);
  const imucal_sensor_units_t units = imucal_mpu6050_units(&sensor);
  assert_true(fabs((double)((float)last.temp_counts * units.degc_per_count + units.degc_at_zero) - 42.0) < 0.05);
  mpu.bus.fault = EMU_BUS_ZEROS;
  assert_int_equal(run(0.5, 20000, &last), 0);
  assert_int_equal(last_status, IMUCAL_ERR_SENSOR);
  mpu.bus.fault = EMU_BUS_GOOD;
  emu_mpu_brown_out(&mpu);
  assert_true(run(2.0, 20000, &last) > 100);
  assert_int_equal(sensor.counts.n_resets, 1);
  emu_mpu_advance(&mpu, 1e6);
  assert_true(run(1.0, 20000, &last) > 150);
  assert_true(sensor.counts.n_overruns >= 1);
  assert_int_equal(last.counts[0], 1638);
  assert_int_equal(mpu.bus.n_violations, 0);
  imucal_sensor_self_test_t test;
  mpu.bus.feel = NULL;
  assert_int_equal(imucal_mpu6050_self_test(&sensor, &test), IMUCAL_OK);
  assert_int_equal(test.failed, 0);
  assert_int_equal(mpu.bus.n_violations, 0);
}

static void test_only_the_identity_asked_for_is_taken(void** state) {
  (void)state;
  imucal_mpu6050_config_t config = usual;
  config.identity = 0x70; /* its thermometer has other units */
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &config), IMUCAL_ERR_SENSOR);
  assert_int_equal(sensor.counts.n_identity, 1);
  config.identity = 0x68;
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &config), IMUCAL_OK);
}

static void test_start_refuses_settings_the_chip_does_not_have(void** state) {
  (void)state;
  imucal_mpu6050_config_t config = usual;
  config.rate_hz = 300;
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &config), IMUCAL_ERR_ARGUMENT);
  config = usual;
  config.filter = 0;
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &config), IMUCAL_ERR_ARGUMENT);
}

static void test_rail_is_marked(void** state) {
  (void)state;
  imucal_mpu6050_config_t config = usual;
  config.gyro_fs_sel = 1;
  imucal_sample_t last;
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &config), IMUCAL_OK);
  (void)run(0.5, 20000, &last);
  assert_int_equal(last.saturated, 1u << 1);
  assert_int_equal(sensor.counts.n_saturated, sensor.counts.n_samples);
}

static void test_clock_without_time_stamps_is_estimated(void** state) {
  (void)state;
  const double errors[] = {0.01, -0.03};
  for (int i = 0; i < 2; i++) {
    emu_mpu_power_on(&mpu, false);
    mpu.bus.feel = turn;
    mpu.bus.clock_error = errors[i];
    imucal_sample_t last;
    assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_OK);
    (void)run(120.0, 31300, &last);
    assert_true(fabs((double)imucal_sensor_clock_drift_ppm(&sensor.clock) - errors[i] * 1e6) < 60);
    /* The newest in the FIFO may have come during the burst: right to the sample, up to whole periods. */
    const double period_us = 5000.0 / (1 + errors[i]);
    assert_true(fabs(remainder((double)last.t_us - mpu.next_us, period_us)) < 500.0);
    assert_true(mpu.next_us - (double)last.t_us < 2.5 * period_us);
    assert_int_equal(sensor.clock.n_resyncs + sensor.counts.n_lost, 0);
  }
}

static void test_wrong_identity_and_stuck_bus(void** state) {
  (void)state;
  mpu.who_am_i = 0x47;
  emu_mpu_reset_registers(&mpu);
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_ERR_SENSOR);
  assert_int_equal(sensor.identity, 0x47);
  const emu_fault_t faults[] = {EMU_BUS_ZEROS, EMU_BUS_ONES, EMU_BUS_ERRORS};
  for (int i = 0; i < 3; i++) {
    (void)power_on(NULL);
    mpu.bus.fault = faults[i];
    assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_ERR_SENSOR);
    assert_true(sensor.counts.n_bus_errors > 0);
    mpu.bus.fault = EMU_BUS_GOOD;
    imucal_sample_t last;
    assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_OK);
    assert_int_equal(sensor.counts.n_bus_errors, 0);
    (void)run(0.5, 20000, &last);
    const uint32_t before = sensor.counts.n_samples;
    mpu.bus.fault = faults[i];
    assert_int_equal(run(1.0, 20000, &last), 0);
    assert_int_equal(last_status, IMUCAL_ERR_SENSOR);
    assert_true(sensor.counts.n_bus_errors > 0);
    mpu.bus.fault = EMU_BUS_GOOD;
    (void)run(1.0, 20000, &last);
    assert_true(sensor.counts.n_samples > before + 100);
    assert_int_equal(last.counts[0], 1638);
  }
}

static void test_reset_in_the_middle(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_OK);
  (void)run(1.0, 20000, &last);
  emu_mpu_brown_out(&mpu);
  (void)run(2.0, 20000, &last);
  assert_int_equal(sensor.counts.n_resets, 1);
  assert_int_equal(last.counts[0], 1638); /* with the old full scale, not the one after reset */
  assert_true(sensor.counts.n_lost > 50 && sensor.counts.n_lost < 200);
}

static void test_overrun_empties_the_fifo_and_packets_stay_aligned(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_OK);
  (void)run(10.0, 20000, &last);
  const uint32_t before = sensor.counts.n_samples;
  const uint64_t k = mpu.k;
  emu_mpu_advance(&mpu, 1000000.0);
  (void)run(5.0, 20000, &last);
  assert_int_equal(sensor.counts.n_overruns, 1);
  assert_true(mpu.n_lost_bytes % 14 != 0); /* the chip lost its alignment */
  assert_int_equal(last.counts[0], 1638);
  const int taken = (int)(sensor.counts.n_samples - before + sensor.counts.n_lost);
  assert_true(abs(taken - (int)(mpu.k - k)) <= 5);
}

static void test_frozen_temperature_and_words(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_OK);
  mpu.is_temp_frozen = true;
  (void)run(58.0, 50000, &last);
  assert_int_equal(last.fault, 0);
  (void)run(4.0, 50000, &last);
  assert_int_equal(last.fault, 0x3F);
  assert_int_equal(sensor.counts.n_stuck_temp, 1);
  mpu.is_temp_frozen = false;
  mpu.bus.feel = NULL; /* words of a sensor without noise */
  (void)run(2.0, 50000, &last);
  assert_int_equal(sensor.counts.n_stuck_data, 1);
  assert_int_equal(last.fault, 0x3F);
}

static void test_self_test_of_both_chips(void** state) {
  (void)state;
  for (int is_6500 = 0; is_6500 < 2; is_6500++) {
    emu_mpu_power_on(&mpu, is_6500);
    imucal_sensor_self_test_t test;
    assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &usual), IMUCAL_OK);
    assert_int_equal(imucal_mpu6050_self_test(&sensor, &test), IMUCAL_OK);
    assert_int_equal(test.failed, 0);
    mpu.st_ratio[1] = is_6500 ? 0.4 : 0.8;
    mpu.st_ratio[5] = is_6500 ? 1.6 : 1.2;
    mpu.st_ratio[0] = is_6500 ? 1.4 : 1.1; /* still allowed */
    assert_int_equal(imucal_mpu6050_self_test(&sensor, &test), IMUCAL_OK);
    assert_int_equal(test.failed, 1u << 1 | 1u << 5);
    imucal_sample_t last;
    mpu.bus.feel = turn;
    (void)run(0.5, 20000, &last);
    assert_int_equal(last.counts[0], 1638);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_both_chips_are_told_apart_and_read, power_on),
      cmocka_unit_test_setup(test_mpu6500_on_spi, power_on),
      cmocka_unit_test_setup(test_only_the_identity_asked_for_is_taken, power_on),
      cmocka_unit_test_setup(test_start_refuses_settings_the_chip_does_not_have, power_on),
      cmocka_unit_test_setup(test_rail_is_marked, power_on),
      cmocka_unit_test_setup(test_clock_without_time_stamps_is_estimated, power_on),
      cmocka_unit_test_setup(test_wrong_identity_and_stuck_bus, power_on),
      cmocka_unit_test_setup(test_reset_in_the_middle, power_on),
      cmocka_unit_test_setup(test_overrun_empties_the_fifo_and_packets_stay_aligned, power_on),
      cmocka_unit_test_setup(test_frozen_temperature_and_words, power_on),
      cmocka_unit_test_setup(test_self_test_of_both_chips, power_on),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
