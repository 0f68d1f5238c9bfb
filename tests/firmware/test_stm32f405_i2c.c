// SPDX-License-Identifier: MIT
/* The STM32F405's I2C driver, compiled from its own source over a register model of I2C1, with a modelled MPU-6050 and its driver
 * at the other end; and every error of the bus. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "emu/mpu6050_i2c.h"
#include "port/stm32f405/i2c.c"
#include "sensors/mpu6050.h"

/* ---- a memory as the slave: first byte the address, which counts up ---- */

static uint8_t memory[256], at;

static bool put_memory(uint8_t byte, bool is_first) {
  if (is_first)
    at = byte;
  else
    memory[at++] = byte;
  return true;
}

static uint8_t get_memory(void) {
  return memory[at++];
}

static int power_on(void** state) {
  (void)state;
  emu_stm32_power_on();
  emu_i2c_power_on();
  i2c.put = put_memory;
  i2c.get = get_memory;
  for (int i = 0; i < 256; i++) memory[i] = (uint8_t)(i ^ 0x5A);
  stm32_i2c_init(42000000);
  return 0;
}

static void assert_clean(void) {
  assert_int_equal(i2c.n_violations + i2c.n_acked_too_many, 0);
  assert_false(i2c.is_busy);
}

static void assert_works_again(void) {
  const uint8_t reg = 0x31;
  uint8_t value = 0;
  assert_int_equal(stm32_i2c_transfer(0x68, &reg, 1, &value, 1), IMUCAL_OK);
  assert_int_equal(value, 0x31 ^ 0x5A);
  assert_clean();
}

static void test_timing_registers_are_those_of_400_khz(void** state) {
  (void)state;
  assert_int_equal(i2c.cr2, 42);
  assert_int_equal(i2c.ccr, 1u << 15 | 35); /* 42 MHz / (3 * 35) = 400 kHz */
  assert_int_equal(i2c.trise, 13);          /* 300 ns at 42 MHz, and 1 (27.6.9) */
  assert_int_equal(i2c.n_clocks, 1);        /* the line was free: none of the nine */
}

static void test_reads_of_every_length_refuse_the_last_byte_and_no_other(void** state) {
  (void)state;
  for (size_t n = 1; n <= 40; n++) {
    uint8_t in[40] = {0};
    const uint8_t reg = 7;
    const uint32_t n_stops = i2c.n_stops;
    assert_int_equal(stm32_i2c_transfer(0x68, &reg, 1, in, n), IMUCAL_OK);
    for (size_t i = 0; i < n; i++) assert_int_equal(in[i], (7 + i) ^ 0x5A);
    assert_int_equal(at, (uint8_t)(7 + n)); /* the slave gave so many bytes and not one more */
    assert_int_equal(i2c.n_stops - n_stops, 1);
    assert_clean();
  }
}

static void test_writes_arrive(void** state) {
  (void)state;
  const uint8_t out[4] = {0x20, 1, 2, 3};
  assert_int_equal(stm32_i2c_transfer(0x68, out, 4, NULL, 0), IMUCAL_OK);
  assert_memory_equal(memory + 0x20, out + 1, 3);
  assert_clean();
  assert_int_equal(stm32_i2c_transfer(0x68, NULL, 0, NULL, 0), IMUCAL_ERR_ARGUMENT);
}

static void test_nobody_answers(void** state) {
  (void)state;
  const uint8_t reg = 1;
  uint8_t value;
  assert_int_equal(stm32_i2c_transfer(0x69, &reg, 1, &value, 1), IMUCAL_ERR_SENSOR);
  assert_int_equal(i2c.sr1 & I2C_SR1_ERRORS, 0);
  assert_works_again();
}

static bool put_refused(uint8_t byte, bool is_first) {
  (void)byte;
  return is_first;
}

static void test_a_byte_that_is_not_acknowledged_ends_the_transfer(void** state) {
  (void)state;
  const uint8_t out[3] = {0x20, 1, 2};
  i2c.put = put_refused;
  assert_int_equal(stm32_i2c_transfer(0x68, out, 3, NULL, 0), IMUCAL_ERR_SENSOR);
  assert_false(i2c.is_busy);
  i2c.put = put_memory;
  assert_works_again();
}

static void test_arbitration_lost_leaves_the_bus_to_the_other(void** state) {
  (void)state;
  const uint8_t out[3] = {0x20, 1, 2};
  i2c.lose_arbitration_at = 2;
  const uint32_t n_stops = i2c.n_stops;
  assert_int_equal(stm32_i2c_transfer(0x68, out, 3, NULL, 0), IMUCAL_ERR_SENSOR);
  assert_int_equal(i2c.n_stops, n_stops);
  i2c.lose_arbitration_at = 0;
  assert_works_again();
}

static void test_bus_error_is_cleared_and_stopped(void** state) {
  (void)state;
  const uint8_t out[3] = {0x20, 1, 2};
  i2c.bus_error_at = 1;
  assert_int_equal(stm32_i2c_transfer(0x68, out, 3, NULL, 0), IMUCAL_ERR_SENSOR);
  i2c.bus_error_at = 0;
  assert_works_again();
}

static void test_a_clock_that_is_held_ends_after_its_limit_and_is_set_up_anew(void** state) {
  (void)state;
  const uint8_t reg = 1;
  uint8_t value;
  const uint32_t n_resets = i2c.n_resets;
  i2c.is_clock_held = true;
  const uint64_t before_us = stm32.now_us;
  assert_int_equal(stm32_i2c_transfer(0x68, &reg, 1, &value, 1), IMUCAL_ERR_SENSOR);
  assert_in_range(stm32.now_us - before_us, 1000, 6000);
  assert_int_equal(i2c.n_resets - n_resets, 1);
  i2c.is_clock_held = false;
  assert_works_again();
}

static void test_a_data_line_that_is_held_is_clocked_free(void** state) {
  (void)state;
  const uint8_t reg = 1;
  uint8_t value;
  i2c.is_line_held = true;
  i2c.n_clocks = 0;
  assert_int_equal(stm32_i2c_transfer(0x68, &reg, 1, &value, 1), IMUCAL_ERR_SENSOR);
  assert_false(i2c.is_line_held);
  assert_works_again();
}

/* ---- the MPU-6050's driver on this bus ---- */

static void turn(void* ctx, uint64_t k, double t_us, emu_world_t* world) {
  (void)ctx, (void)t_us;
  world->rate_dps[0] = 100.0;
  world->rate_dps[2] = 0.1 * emu_noise(k, 1);
  world->temp_degc = 36.53;
}

static imucal_status transfer(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  (void)ctx, (void)device;
  return stm32_i2c_transfer(0x68, out, n_out, in, n_in);
}

static void delay_us(void* ctx, uint32_t us) {
  (void)ctx;
  stm32.now_us += us;
}

static void test_mpu6050_delivers_over_the_bus(void** state) {
  (void)state;
  static const imucal_sensor_bus_t bus = {.transfer = transfer, .delay_us = delay_us};
  static const imucal_mpu6050_config_t config = {.rate_hz = 200, .gyro_fs_sel = 0, .accel_fs_sel = 1, .filter = 3};
  imucal_mpu6050_t sensor;
  imucal_sample_t samples[20];
  emu_mpu_power_on(&emu_mpu, false);
  emu_mpu.bus.feel = turn;
  emu_mpu_i2c_connect();
  assert_int_equal(imucal_mpu6050_start(&sensor, &bus, &config), IMUCAL_OK);
  uint32_t total = 0;
  for (int i = 0; i < 100; i++) {
    uint32_t n;
    stm32.now_us += 40000;
    assert_int_equal(imucal_mpu6050_read(&sensor, stm32.now_us, samples, 20, &n), IMUCAL_OK);
    for (uint32_t k = 0; k < n; k++) {
      assert_int_equal(samples[k].counts[0], 13107);
      assert_true(abs(samples[k].temp_counts) < 20);
    }
    total += n;
  }
  assert_in_range(total, 800, 860); /* 4 s, and what the transfers take */
  assert_int_equal(sensor.counts.n_bus_errors + sensor.counts.n_lost + emu_mpu.bus.n_violations, 0);
  assert_clean();
  i2c.is_absent = true;
  uint32_t n;
  assert_int_equal(imucal_mpu6050_read(&sensor, stm32.now_us, samples, 20, &n), IMUCAL_ERR_SENSOR);
  assert_int_equal(sensor.counts.n_bus_errors, 1);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup(test_timing_registers_are_those_of_400_khz, power_on),
      cmocka_unit_test_setup(test_reads_of_every_length_refuse_the_last_byte_and_no_other, power_on),
      cmocka_unit_test_setup(test_writes_arrive, power_on),
      cmocka_unit_test_setup(test_nobody_answers, power_on),
      cmocka_unit_test_setup(test_a_byte_that_is_not_acknowledged_ends_the_transfer, power_on),
      cmocka_unit_test_setup(test_arbitration_lost_leaves_the_bus_to_the_other, power_on),
      cmocka_unit_test_setup(test_bus_error_is_cleared_and_stopped, power_on),
      cmocka_unit_test_setup(test_a_clock_that_is_held_ends_after_its_limit_and_is_set_up_anew, power_on),
      cmocka_unit_test_setup(test_a_data_line_that_is_held_is_clocked_free, power_on),
      cmocka_unit_test_setup(test_mpu6050_delivers_over_the_bus, power_on),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
