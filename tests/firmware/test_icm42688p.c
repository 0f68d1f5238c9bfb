// SPDX-License-Identifier: MIT
/* Driver of the ICM-42688-P against the register-level model of tests/emu/icm42688p.h. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "emu/icm42688p.h"
#include "sensors/icm42688p.h"
#include "sensors/source.h"

static emu_icm_t icm;
static imucal_sensor_bus_t bus;
static imucal_icm42688p_t sensor;
static imucal_status last_status; /* of the last read */
static const imucal_icm42688p_config_t fine = {.rate_hz = 1000, .is_high_resolution = true, .filter = 1};

static imucal_status start(const imucal_icm42688p_config_t* config) {
  bus = emu_icm_bus(&icm);
  return imucal_icm42688p_start(&sensor, &bus, config);
}

static int power_on(void** state) {
  (void)state;
  emu_icm_power_on(&icm);
  return 0;
}

/* Reads every `step_us` for `seconds`; *last is the newest sample; checks that time runs forward. */
static uint32_t run(double seconds, double step_us, imucal_sample_t* last) {
  imucal_sample_t samples[25];
  uint32_t total = 0;
  const double end_us = icm.bus.now_us + seconds * 1e6;
  while (icm.bus.now_us < end_us) {
    uint32_t n;
    emu_icm_advance(&icm, step_us);
    last_status = imucal_icm42688p_read(&sensor, (uint64_t)icm.bus.now_us, samples, 25, &n);
    for (uint32_t i = 0; i < n; i++) {
      if (total + i > 0) assert_true(samples[i].t_us > last->t_us);
      *last = samples[i];
    }
    total += n;
  }
  return total;
}

static void turn(void* ctx, uint64_t k, double t_us, emu_world_t* world) {
  (void)ctx, (void)k, (void)t_us;
  const double dps[3] = {100.0, -1500.25, 0.0152587890625}, g[3] = {-15.5, 0.0001220703125, 1.0};
  memcpy(world->rate_dps, dps, sizeof dps);
  memcpy(world->accel_g, g, sizeof g);
  world->temp_degc = 60.0;
}

static void test_start_known_chip_is_configured_without_breaking_a_rule(void** state) {
  (void)state;
  assert_int_equal(start(&fine), IMUCAL_OK);
  assert_int_equal(icm.bus.n_violations, 0);
  assert_int_equal(sensor.identity, 0x47);
  assert_int_equal(icm.reg[0][0x4F], 0x06);
  assert_int_equal(icm.reg[0][0x64] & 0x10, 0);
}

static void test_start_refuses_settings_the_chip_does_not_have(void** state) {
  (void)state;
  imucal_icm42688p_config_t config = fine;
  config.rate_hz = 833;
  assert_int_equal(start(&config), IMUCAL_ERR_ARGUMENT);
  config = fine;
  config.filter = 8;
  assert_int_equal(start(&config), IMUCAL_ERR_ARGUMENT);
}

static void test_read_20_bit_words_carry_the_finest_bits(void** state) {
  (void)state;
  icm.bus.feel = turn;
  imucal_sample_t last;
  assert_int_equal(start(&fine), IMUCAL_OK);
  assert_true(run(0.2, 5000, &last) > 150);
  const int32_t expected[6] = {13107, -196641, 2, -126976, 1, 8192};
  assert_memory_equal(last.counts, expected, sizeof expected);
  const imucal_sensor_units_t units = imucal_icm42688p_units(&fine);
  assert_true(fabs((double)(units.dps_per_count * 13107) - 100.0) < 0.004);
  assert_true(fabs((double)((float)last.temp_counts * units.degc_per_count + units.degc_at_zero) - 60.0) < 0.1);
  assert_int_equal(last.saturated | last.fault, 0);
}

static void test_read_16_bit_ranges_and_temperature_register(void** state) {
  (void)state;
  const imucal_icm42688p_config_t coarse = {.rate_hz = 200, .gyro_fs_sel = 4, .accel_fs_sel = 2};
  imucal_sample_t last;
  icm.bus.feel = turn;
  assert_int_equal(start(&coarse), IMUCAL_OK);
  assert_true(run(0.5, 20000, &last) > 80);
  const imucal_sensor_units_t units = imucal_icm42688p_units(&coarse);
  assert_int_equal(last.counts[0], 26214); /* 100 dps at 125 */
  assert_true(fabs((double)units.dps_per_count - 125.0 / 32768.0) < 1e-9);
  assert_true(fabs((double)((float)last.temp_counts * units.degc_per_count + units.degc_at_zero) - 60.0) < 0.1);
  assert_int_equal(last.saturated, 1u << 1 | 1u << 3); /* -1500 dps and -15.5 g are outside */
  assert_int_equal(sensor.counts.n_saturated, sensor.counts.n_samples);
}

static void test_clock_one_percent_off_is_estimated_and_times_are_the_boards(void** state) {
  (void)state;
  const double errors[] = {0.01, -0.01, 0.0};
  for (int i = 0; i < 3; i++) {
    emu_icm_power_on(&icm);
    icm.bus.clock_error = errors[i];
    imucal_sample_t last;
    assert_int_equal(start(&fine), IMUCAL_OK);
    const uint32_t n = run(60.0, 9700, &last);
    assert_true(fabs(n - 60.0 * 1000.0 * (1.0 + errors[i])) < 60);
    assert_true(fabs((double)imucal_sensor_clock_drift_ppm(&sensor.clock) - errors[i] * 1e6) < 20);
    const double newest_us = icm.next_us - 1000.0 / (1.0 + errors[i]); /* true time of the sample */
    assert_true(fabs((double)last.t_us - newest_us) < 300.0);
    assert_int_equal(sensor.clock.n_resyncs, 0);
    assert_int_equal(sensor.counts.n_lost + sensor.counts.n_overruns + sensor.counts.n_bus_errors, 0);
  }
}

static void test_both_time_stamp_units_are_taken(void** state) {
  (void)state;
  const double ticks[] = {1.0, 32.0 / 30.0};
  for (int i = 0; i < 2; i++) {
    emu_icm_power_on(&icm);
    icm.tick_us = ticks[i];
    imucal_sample_t last;
    assert_int_equal(start(&fine), IMUCAL_OK);
    (void)run(2.0, 5000, &last);
    assert_true(sensor.counts.n_invalid < 3);
  }
}

static void test_wrong_identity_is_refused(void** state) {
  (void)state;
  icm.who_am_i = 0x68;
  emu_icm_reset_registers(&icm);
  assert_int_equal(start(&fine), IMUCAL_ERR_SENSOR);
  assert_int_equal(sensor.identity, 0x68);
}

static void test_stuck_bus_at_start_and_in_operation(void** state) {
  (void)state;
  const emu_fault_t faults[] = {EMU_BUS_ZEROS, EMU_BUS_ONES, EMU_BUS_ERRORS};
  for (int i = 0; i < 3; i++) {
    emu_icm_power_on(&icm);
    icm.bus.fault = faults[i];
    assert_int_equal(start(&fine), IMUCAL_ERR_SENSOR);
    assert_true(sensor.counts.n_bus_errors > 0);
    icm.bus.fault = EMU_BUS_GOOD;
    imucal_sample_t last;
    assert_int_equal(start(&fine), IMUCAL_OK);
    (void)run(0.5, 10000, &last);
    const uint32_t n_good = sensor.counts.n_samples;
    icm.bus.fault = faults[i];
    assert_int_equal(run(0.5, 10000, &last), 0); /* nothing is passed on as good */
    assert_int_equal(last_status, IMUCAL_ERR_SENSOR);
    assert_true(sensor.counts.n_bus_errors > 0);
    icm.bus.fault = EMU_BUS_GOOD;
    (void)run(0.5, 10000, &last);
    assert_true(sensor.counts.n_samples > n_good + 400); /* and it goes on by itself */
  }
}

static void test_reset_in_the_middle_is_seen_and_set_up_again(void** state) {
  (void)state;
  imucal_sample_t last;
  icm.bus.feel = turn;
  assert_int_equal(start(&fine), IMUCAL_OK);
  (void)run(1.0, 10000, &last);
  emu_icm_brown_out(&icm);
  (void)run(1.0, 10000, &last);
  assert_int_equal(sensor.counts.n_resets, 1);
  assert_int_equal(last.counts[0], 13107);
  assert_true(sensor.counts.n_lost > 20 && sensor.counts.n_lost < 120);
  assert_int_equal(icm.bus.n_violations, 0);
}

static void test_overrun_is_counted_and_the_clock_goes_on(void** state) {
  (void)state;
  imucal_sample_t last;
  assert_int_equal(start(&fine), IMUCAL_OK);
  (void)run(20.0, 10000, &last);
  const uint32_t before = sensor.counts.n_samples, k = (uint32_t)icm.k;
  emu_icm_advance(&icm, 700000.0); /* the board writes flash for too long */
  (void)run(5.0, 10000, &last);
  assert_int_equal(sensor.counts.n_overruns, 1);
  const uint32_t taken = sensor.counts.n_samples - before, measured = (uint32_t)icm.k - k;
  assert_true(abs((int)(taken + sensor.counts.n_lost) - (int)measured) <= 3);
  assert_int_equal(sensor.counts.n_lost, icm.n_overwritten);
  assert_int_equal(sensor.clock.n_resyncs, 0);
  assert_true(fabs((double)last.t_us - (icm.next_us - 1000.0)) < 300.0);
}

static void test_small_capacity_leaves_the_rest_in_the_fifo(void** state) {
  (void)state;
  imucal_sample_t samples[4];
  uint32_t n, total = 0;
  assert_int_equal(start(&fine), IMUCAL_OK);
  uint64_t last_us = 0;
  for (int i = 0; i < 2000; i++) {
    emu_icm_advance(&icm, 3000);
    assert_int_equal(imucal_icm42688p_read(&sensor, (uint64_t)icm.bus.now_us, samples, 4, &n), IMUCAL_OK);
    for (uint32_t j = 0; j < n; j++) {
      assert_true(samples[j].t_us > last_us);
      last_us = samples[j].t_us;
    }
    total += n;
  }
  assert_true(total > 5990 && sensor.counts.n_overruns == 0 && sensor.counts.n_lost == 0);
}

/* Gyro and accelerometer tremble by a count as real ones do. */
static void tremble(void* ctx, uint64_t k, double t_us, emu_world_t* world) {
  (void)t_us;
  const bool* is_stuck = ctx;
  for (uint32_t i = 0; i < 3 && !*is_stuck; i++) world->rate_dps[i] = 0.05 * emu_noise(k, i);
}

static void test_frozen_temperature_is_reported_as_a_fault(void** state) {
  (void)state;
  imucal_sample_t last;
  bool is_stuck = false;
  icm.bus.feel = tremble;
  icm.bus.feel_ctx = &is_stuck;
  assert_int_equal(start(&fine), IMUCAL_OK);
  (void)run(1.0, 10000, &last);
  assert_int_equal(last.fault, 0);
  icm.is_temp_frozen = true;
  icm.frozen_degc = 31.0;
  (void)run(50.0, 10000, &last);
  assert_int_equal(sensor.counts.n_stuck_temp, 0);
  (void)run(15.0, 10000, &last);
  assert_int_equal(sensor.counts.n_stuck_temp, 1);
  assert_int_equal(last.fault, 0x3F);
  icm.is_temp_frozen = false;
  (void)run(0.1, 10000, &last);
  assert_int_equal(last.fault, 0);
}

static void test_words_that_stand_still_are_a_fault(void** state) {
  (void)state;
  bool is_stuck = false;
  imucal_sample_t last;
  icm.bus.feel = tremble;
  icm.bus.feel_ctx = &is_stuck;
  assert_int_equal(start(&fine), IMUCAL_OK);
  (void)run(3.0, 10000, &last);
  assert_int_equal(sensor.counts.n_stuck_data, 0);
  is_stuck = true;
  (void)run(1.5, 10000, &last);
  assert_int_equal(sensor.counts.n_stuck_data, 1);
  assert_int_equal(last.fault, 0x3F);
}

static void test_damaged_packets_are_refused(void** state) {
  (void)state;
  imucal_sample_t last;
  icm.bus.feel = turn;
  assert_int_equal(start(&fine), IMUCAL_OK);
  (void)run(0.5, 10000, &last);
  const uint32_t before = sensor.counts.n_invalid;
  emu_icm_advance(&icm, 10000);
  icm.packet[icm.first][0] = 0x40;                          /* no gyro in it */
  memset(icm.packet[(icm.first + 1) % ICM_RING] + 7, 0, 2); /* x of the gyro ... */
  icm.packet[(icm.first + 1) % ICM_RING][7] = 0x80;         /* ... is the mark of invalid data */
  memset(icm.packet[(icm.first + 2) % ICM_RING] + 3, 0, 2); /* y of the accelerometer as well */
  icm.packet[(icm.first + 2) % ICM_RING][3] = 0x80;
  (void)run(0.02, 10000, &last);
  assert_int_equal(sensor.counts.n_invalid - before, 3);
  assert_int_equal(last.counts[0], 13107);
}

static void test_self_test_good_and_weak_axis(void** state) {
  (void)state;
  imucal_sensor_self_test_t test;
  assert_int_equal(start(&fine), IMUCAL_OK);
  assert_int_equal(imucal_icm42688p_self_test(&sensor, &test), IMUCAL_OK);
  assert_int_equal(test.failed, 0);
  icm.st_ratio[2] = 0.3;
  icm.st_ratio[4] = 1.7;
  assert_int_equal(imucal_icm42688p_self_test(&sensor, &test), IMUCAL_OK);
  assert_int_equal(test.failed, 1u << 2 | 1u << 4);
  imucal_sample_t last;
  assert_true(run(0.2, 10000, &last) > 150); /* and measures again */
  assert_int_equal(last.counts[5], 8192);
}

/* As the README's lines: one read holds 25 samples; whoever reads later than that goes on until one is not full. */
static void test_read_until_not_full_loses_nothing_at_90_ms(void** state) {
  (void)state;
  assert_int_equal(start(&fine), IMUCAL_OK);
  uint32_t total = 0;
  for (int i = 0; i < 30; i++) {
    imucal_sample_t samples[25];
    uint32_t n;
    emu_icm_advance(&icm, 90000);
    do {
      assert_int_equal(imucal_icm42688p_read(&sensor, (uint64_t)icm.bus.now_us, samples, 25, &n), IMUCAL_OK);
      total += n;
    } while (n == 25);
  }
  assert_in_range(total, 2690, 2740);
  assert_int_equal(sensor.counts.n_overruns, 0);
}

/* Forty samples a poll, of which a read holds 25: the next one follows at once. */
static void test_source_polled_slower_than_its_bursts_loses_nothing(void** state) {
  (void)state;
  static imucal_source_t source;
  const imucal_icm42688p_config_t fast = {.rate_hz = 8000, .is_high_resolution = true, .filter = 1};
  bus = emu_icm_bus(&icm);
  imucal_source_init(&source, &imucal_icm42688p_driver, &sensor, &fast, &bus, 5000, (uint64_t)icm.bus.now_us);
  uint32_t total = 0;
  uint64_t last_us = 0;
  for (const double end_us = icm.bus.now_us + 2e6; icm.bus.now_us < end_us;) {
    imucal_sample_t sample;
    emu_icm_advance(&icm, 500);
    while (imucal_source_read(&source, (uint64_t)icm.bus.now_us, &sample) == IMUCAL_PORT_SAMPLE) {
      assert_true(sample.t_us > last_us);
      last_us = sample.t_us;
      total++;
    }
  }
  imucal_link_sensor_reply_t report = {0};
  imucal_source_report(&source, &report);
  assert_int_equal(report.lost, 0);
  assert_true(report.overruns <= 1); /* while the start waited for the gyro */
  assert_in_range(total, 15900, 16100);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_start_known_chip_is_configured_without_breaking_a_rule, power_on),
      cmocka_unit_test_setup(test_start_refuses_settings_the_chip_does_not_have, power_on),
      cmocka_unit_test_setup(test_read_20_bit_words_carry_the_finest_bits, power_on),
      cmocka_unit_test_setup(test_read_16_bit_ranges_and_temperature_register, power_on),
      cmocka_unit_test_setup(test_clock_one_percent_off_is_estimated_and_times_are_the_boards, power_on),
      cmocka_unit_test_setup(test_both_time_stamp_units_are_taken, power_on),
      cmocka_unit_test_setup(test_wrong_identity_is_refused, power_on),
      cmocka_unit_test_setup(test_stuck_bus_at_start_and_in_operation, power_on),
      cmocka_unit_test_setup(test_reset_in_the_middle_is_seen_and_set_up_again, power_on),
      cmocka_unit_test_setup(test_overrun_is_counted_and_the_clock_goes_on, power_on),
      cmocka_unit_test_setup(test_small_capacity_leaves_the_rest_in_the_fifo, power_on),
      cmocka_unit_test_setup(test_frozen_temperature_is_reported_as_a_fault, power_on),
      cmocka_unit_test_setup(test_words_that_stand_still_are_a_fault, power_on),
      cmocka_unit_test_setup(test_damaged_packets_are_refused, power_on),
      cmocka_unit_test_setup(test_read_until_not_full_loses_nothing_at_90_ms, power_on),
      cmocka_unit_test_setup(test_source_polled_slower_than_its_bursts_loses_nothing, power_on),
      cmocka_unit_test_setup(test_self_test_good_and_weak_axis, power_on),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
