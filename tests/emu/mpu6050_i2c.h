// SPDX-License-Identifier: MIT
/* The model of the MPU-6050 as the slave of the model of I2C1: first byte the register, which counts up but at the FIFO.  While
 * it resets it does not acknowledge. */
#ifndef IMUCAL_TESTS_EMU_MPU6050_I2C_H
#define IMUCAL_TESTS_EMU_MPU6050_I2C_H
#include "emu/mpu6050.h"
#include "emu/stm32f405_i2c.h"

static emu_mpu_t emu_mpu;
static uint8_t emu_mpu_at;

static inline bool emu_mpu_i2c_put(uint8_t byte, bool is_first) {
  emu_mpu_advance(&emu_mpu, (double)stm32.now_us - emu_mpu.bus.now_us);
  const bool is_awake = emu_mpu.bus.now_us >= emu_mpu.reset_until_us;
  emu_mpu.bus.n_transfers += is_first;
  if (is_first)
    emu_mpu_at = byte & 0x7F;
  else if (is_awake && emu_mpu.bus.fault == EMU_BUS_GOOD)
    emu_mpu_write(&emu_mpu, emu_mpu_at++, byte);
  return is_awake;
}

static inline uint8_t emu_mpu_i2c_get(void) {
  if (emu_mpu.bus.fault == EMU_BUS_ZEROS) return 0x00;
  if (emu_mpu.bus.fault == EMU_BUS_ONES) return 0xFF;
  const uint8_t byte = emu_mpu_read(&emu_mpu, emu_mpu_at);
  if (emu_mpu_at != 0x74) emu_mpu_at = (uint8_t)((emu_mpu_at + 1) & 0x7F);
  return byte;
}

/* After emu_i2c_power_on. */
static inline void emu_mpu_i2c_connect(void) {
  i2c.put = emu_mpu_i2c_put;
  i2c.get = emu_mpu_i2c_get;
}
#endif
