// SPDX-License-Identifier: MIT
/* MPU-6050 (GY-521 boards) on I2C1 at 200 Hz, 500 dps, 4 g, 42 Hz; AD0 low.  The MPU-6500 has another thermometer: IDENTITY 0x70
 * (MPU-9250: 0x71) takes that chip alone, and its units. */
#include "board.h"
#include "sensors/mpu6050.h"

#define ADDRESS 0x68u
#define IDENTITY 0x68u
#define RATE_HZ 200u
#define POLL_US 25000u /* 5 samples: 70 bytes, 1.7 ms of the bus */

static imucal_status transfer(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  (void)ctx, (void)device;
  return stm32_i2c_transfer(ADDRESS, out, n_out, in, n_in);
}

static void delay_us(void* ctx, uint32_t us) {
  (void)ctx;
  stm32_delay_us(us);
}

board_sensor_t board_sensor_init(const stm32_clocks_t* clocks) {
  static imucal_mpu6050_t mpu;
  static const imucal_sensor_bus_t bus = {.transfer = transfer, .delay_us = delay_us};
  static const imucal_mpu6050_config_t config = {
      .rate_hz = RATE_HZ, .gyro_fs_sel = 1, .accel_fs_sel = 1, .filter = 3, .identity = IDENTITY};
  stm32_i2c_init(clocks->apb1_hz);
  mpu = (imucal_mpu6050_t){.config = config,
                           .is_6500 = IDENTITY != 0x68u}; /* for the units, asked for before the start */
  return (board_sensor_t){.driver = &imucal_mpu6050_driver,
                          .state = &mpu,
                          .config = &config,
                          .bus = &bus,
                          .poll_us = POLL_US,
                          .rate_hz = RATE_HZ,
                          .units = imucal_mpu6050_units(&mpu)};
}
