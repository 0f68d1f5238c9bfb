// SPDX-License-Identifier: MIT
/* Register-level model of the MPU-6050 (RM-MPU-6000A-00 rev. 4.2) and the MPU-6500 (RM-MPU-6500A-00 rev. 2.1): reset
 * values, sleep after reset (then only PWR_MGMT_1 can be written), auto-increment (not at FIFO_R_W), read-only registers,
 * a FIFO of 1024 (512) bytes whose oldest BYTES are overwritten, overflow flag cleared by reading, factory trim codes and
 * self-test response.  Not modelled: auxiliary I2C, motion detection, low-power cycling. */
#ifndef IMUCAL_TESTS_EMU_MPU6050_H
#define IMUCAL_TESTS_EMU_MPU6050_H
#include "sensor_bus.h"

typedef struct emu_mpu {
  emu_bus_t bus;
  bool is_6500;
  uint8_t who_am_i;
  uint8_t reg[128];
  uint8_t fifo[1024];
  uint32_t first, n_bytes;
  double reset_until_us, next_us;
  uint64_t k;
  uint32_t n_lost_bytes;
  double st_ratio[6];
  bool is_temp_frozen;
  bool is_spi; /* MPU-6500 alone: bit 7 of the address says read; I2C is to be switched off with the FIFO on */
} emu_mpu_t;

static inline void emu_mpu_reset_registers(emu_mpu_t* mpu) {
  memset(mpu->reg, 0, sizeof mpu->reg);
  mpu->reg[0x6B] = mpu->is_6500 ? 0x01 : 0x40;
  mpu->reg[0x75] = mpu->who_am_i;
  if (mpu->is_6500) {
    static const uint8_t codes[6] = {90, 100, 110, 120, 130, 140};
    memcpy(mpu->reg, codes, 3);
    memcpy(mpu->reg + 0x0D, codes + 3, 3);
  } else { /* XA 18 XG 10, YA 19 YG 11, ZA 17 ZG 9 */
    static const uint8_t codes[4] = {18 >> 2 << 5 | 10, 19 >> 2 << 5 | 11, 17 >> 2 << 5 | 9,
                                     (18 & 3) << 4 | (19 & 3) << 2 | (17 & 3)};
    memcpy(mpu->reg + 0x0D, codes, 4);
  }
  mpu->first = mpu->n_bytes = 0;
}

static inline void emu_mpu_power_on(emu_mpu_t* mpu, bool is_6500) {
  memset(mpu, 0, sizeof *mpu);
  mpu->is_6500 = is_6500;
  mpu->who_am_i = is_6500 ? 0x70 : 0x68;
  for (int i = 0; i < 6; i++) mpu->st_ratio[i] = 1.0;
  emu_mpu_reset_registers(mpu);
}

static inline void emu_mpu_brown_out(emu_mpu_t* mpu) {
  emu_mpu_reset_registers(mpu);
  mpu->reset_until_us = mpu->bus.now_us + 50000;
}

static inline uint32_t emu_mpu_capacity(const emu_mpu_t* mpu) {
  return mpu->is_6500 ? 512 : 1024;
}

static inline void emu_mpu_push(emu_mpu_t* mpu, uint8_t byte) {
  if (mpu->n_bytes == emu_mpu_capacity(mpu)) {
    mpu->first = (mpu->first + 1) % sizeof mpu->fifo;
    mpu->n_bytes--;
    mpu->n_lost_bytes++;
    mpu->reg[0x3A] |= 0x10;
  }
  mpu->fifo[(mpu->first + mpu->n_bytes++) % sizeof mpu->fifo] = byte;
}

/* Self-test response of axis i (gyros first) in counts at 250 dps, or 8 g (MPU-6500: 2 g). */
static inline double emu_mpu_trim(const emu_mpu_t* mpu, int i) {
  if (mpu->is_6500) return 2620.0 * pow(1.01, (i < 3 ? mpu->reg[i] : mpu->reg[0x0D + i - 3]) - 1);
  if (i < 3) return (i == 1 ? -1 : 1) * 25.0 * 131.0 * pow(1.046, (mpu->reg[0x0D + i] & 0x1F) - 1);
  const int code = mpu->reg[0x0D + i - 3] >> 5 << 2 | (mpu->reg[0x10] >> (4 - 2 * (i - 3)) & 3);
  return 4096.0 * 0.34 * pow(0.92 / 0.34, (code - 1) / 30.0);
}

static inline void emu_mpu_measure(emu_mpu_t* mpu) {
  emu_world_t world;
  emu_feel(&mpu->bus, mpu->k, mpu->next_us, &world);
  const double degc = mpu->is_temp_frozen ? 30.0 : world.temp_degc + 0.01 * emu_noise(mpu->k, 99);
  uint8_t* out = mpu->reg + 0x3B;
  emu_put_be16(out + 6,
               mpu->is_6500 ? emu_round((degc - 21.0) * 333.87, 32767) : emu_round((degc - 36.53) * 340.0, 32767));
  for (int i = 0; i < 3; i++) {
    const double dps = 250.0 * (1 << (mpu->reg[0x1B] >> 3 & 3)), g = 2.0 * (1 << (mpu->reg[0x1C] >> 3 & 3));
    const double accel_trim_g = emu_mpu_trim(mpu, 3 + i) * (mpu->is_6500 ? 2.0 : 8.0) / 32768.0;
    const double gyro_trim_dps = emu_mpu_trim(mpu, i) * 250.0 / 32768.0;
    const double accel = world.accel_g[i] + (mpu->reg[0x1C] >> (7 - i) & 1) * accel_trim_g * mpu->st_ratio[3 + i];
    const double rate = world.rate_dps[i] + (mpu->reg[0x1B] >> (7 - i) & 1) * gyro_trim_dps * mpu->st_ratio[i];
    emu_put_be16(out + 2 * i, emu_round(accel / g * 32768.0, 32767));
    emu_put_be16(out + 8 + 2 * i, emu_round(rate / dps * 32768.0, 32767));
  }
  mpu->reg[0x3A] |= 0x01;
  mpu->k++;
  if (!(mpu->reg[0x6A] & 0x40)) return;
  const uint8_t enable = mpu->reg[0x23];
  for (int i = 0; i < 6 && (enable & 0x08); i++) emu_mpu_push(mpu, out[i]);
  for (int i = 6; i < 8 && (enable & 0x80); i++) emu_mpu_push(mpu, out[i]);
  for (int i = 8; i < 14; i++)
    if (enable & (0x40 >> (i - 8) / 2)) emu_mpu_push(mpu, out[i]);
}

static inline void emu_mpu_advance(emu_mpu_t* mpu, double us) {
  const double end_us = mpu->bus.now_us + us;
  const bool is_awake = !(mpu->reg[0x6B] & 0x40);
  const double base_hz = mpu->reg[0x1A] % 7 ? 1000.0 : 8000.0; /* DLPF_CFG 0 and 7: 8 kHz */
  const double period_us = 1e6 * (1 + mpu->reg[0x19]) / base_hz / (1.0 + mpu->bus.clock_error);
  if (!is_awake) mpu->next_us = end_us + period_us;
  while (mpu->next_us <= end_us) {
    mpu->bus.now_us = mpu->next_us;
    if (mpu->next_us >= mpu->reset_until_us) emu_mpu_measure(mpu);
    mpu->next_us += period_us;
  }
  mpu->bus.now_us = end_us;
}

static inline uint8_t emu_mpu_read(emu_mpu_t* mpu, uint8_t address) {
  if (address == 0x72) {
    mpu->reg[0x73] = (uint8_t)mpu->n_bytes; /* high byte first: both are of one moment */
    return (uint8_t)(mpu->n_bytes >> 8);
  }
  if (address == 0x74) {
    if (mpu->n_bytes == 0) return 0xFF;
    const uint8_t byte = mpu->fifo[mpu->first];
    mpu->first = (mpu->first + 1) % sizeof mpu->fifo;
    mpu->n_bytes--;
    return byte;
  }
  const uint8_t value = mpu->reg[address];
  if (address == 0x3A) mpu->reg[0x3A] = 0;
  return value;
}

static inline void emu_mpu_write(emu_mpu_t* mpu, uint8_t address, uint8_t value) {
  const bool is_read_only =
      (address >= 0x3A && address <= 0x60) || address == 0x72 || address == 0x73 || address == 0x75;
  const bool is_asleep = (mpu->reg[0x6B] & 0x40) && address != 0x6B;
  if (is_read_only || is_asleep) {
    mpu->bus.n_violations++;
    return;
  }
  if (address == 0x6B && (value & 0x80)) {
    emu_mpu_brown_out(mpu);
    return;
  }
  if (address == 0x6A && (value & 0x04)) { /* the FIFO is reset while FIFO_EN is 0 */
    if (value & 0x40)
      mpu->bus.n_violations++;
    else
      mpu->first = mpu->n_bytes = 0;
    value = (uint8_t)(value & ~0x04);
  }
  if (mpu->is_spi && address == 0x6A && !(value & 0x10)) mpu->bus.n_violations++;
  mpu->reg[address] = value;
}

static imucal_status emu_mpu_transfer(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in,
                                      size_t n_in) {
  emu_mpu_t* mpu = ctx;
  (void)device;
  emu_mpu_advance(mpu, (mpu->is_spi ? 8.0 : 22.5) * (double)(2 + n_out + n_in)); /* 1 MHz, 400 kHz */
  uint8_t address = out[0] & 0x7F;
  if (((out[0] & 0x80) != 0) != (mpu->is_spi && n_in > 0)) mpu->bus.n_violations++;
  if (mpu->bus.now_us < mpu->reset_until_us) return IMUCAL_ERR_SENSOR; /* no acknowledge */
  for (size_t i = 1; i < n_out && mpu->bus.fault == EMU_BUS_GOOD; i++) emu_mpu_write(mpu, address++, out[i]);
  for (size_t i = 0; i < n_in; i++) {
    in[i] = emu_mpu_read(mpu, address);
    if (address != 0x74) address = (uint8_t)((address + 1) & 0x7F);
  }
  return emu_bus_answer(&mpu->bus, in, n_in);
}

static void emu_mpu_delay(void* ctx, uint32_t us) {
  emu_mpu_advance(ctx, us);
}

static inline imucal_sensor_bus_t emu_mpu_bus(emu_mpu_t* mpu) {
  return (imucal_sensor_bus_t){
      .ctx = mpu, .transfer = emu_mpu_transfer, .delay_us = emu_mpu_delay, .is_spi = mpu->is_spi};
}
#endif
