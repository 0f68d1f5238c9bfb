// SPDX-License-Identifier: MIT
/* Register-level model of the BMI088, from BST-BMI088-DS001 rev. 1.9: two chips on one bus; the accelerometer wakes in I2C
 * mode and suspended, answers reads after a dummy byte, its temperature is renewed every 1.28 s; the gyro's FIFO of 100
 * frames (bypass, FIFO, stream), emptied by writing FIFO_CONFIG_0, overrun flag cleared by writing FIFO_CONFIG_1;
 * resets, read-only registers, both self-tests.  Not modelled: accelerometer FIFO, interrupts, gyro low power. */
#ifndef IMUCAL_TESTS_EMU_BMI088_H
#define IMUCAL_TESTS_EMU_BMI088_H
#include "sensor_bus.h"

typedef struct emu_bmi {
  emu_bus_t bus;
  uint8_t acc[128], gyr[128];
  uint8_t acc_id, gyr_id;
  bool is_acc_spi, is_temp_invalid, is_bist_bad;
  uint8_t frame[100][6];
  uint32_t first, n_frames, n_overwritten;
  double next_us, temp_us, acc_ready_us, gyr_ready_us;
  uint64_t k;
  double st_g[3];
} emu_bmi_t;

static inline void emu_bmi_reset_accel(emu_bmi_t* bmi) {
  memset(bmi->acc, 0, sizeof bmi->acc);
  bmi->acc[0x00] = bmi->acc_id;
  bmi->acc[0x03] = 0x10;
  bmi->acc[0x22] = 0x80; /* no temperature yet */
  bmi->acc[0x40] = 0xA8;
  bmi->acc[0x41] = 0x01;
  bmi->acc[0x7C] = 0x03;
  bmi->is_acc_spi = false;
  bmi->acc_ready_us = bmi->bus.now_us + 1000;
}

static inline void emu_bmi_reset_gyro(emu_bmi_t* bmi) {
  memset(bmi->gyr, 0, sizeof bmi->gyr);
  bmi->gyr[0x00] = bmi->gyr_id;
  bmi->gyr[0x10] = 0x80;
  bmi->gyr[0x3C] = 0x10;
  bmi->first = bmi->n_frames = 0;
  bmi->gyr_ready_us = bmi->bus.now_us + 30000;
  bmi->next_us = bmi->gyr_ready_us;
}

static inline void emu_bmi_power_on(emu_bmi_t* bmi) {
  memset(bmi, 0, sizeof *bmi);
  bmi->acc_id = 0x1E;
  bmi->gyr_id = 0x0F;
  for (int i = 0; i < 3; i++) bmi->st_g[i] = i == 2 ? 0.5 : 0.8; /* to either side */
  emu_bmi_reset_accel(bmi);
  emu_bmi_reset_gyro(bmi);
}

static inline double emu_bmi_rate_hz(const emu_bmi_t* bmi) {
  static const double rates[8] = {2000, 2000, 1000, 400, 200, 100, 200, 100};
  return rates[bmi->gyr[0x10] & 7];
}

static inline void emu_bmi_measure_accel(emu_bmi_t* bmi, const emu_world_t* world) {
  if (bmi->acc[0x7C] != 0 || bmi->acc[0x7D] != 4) return;
  const double full = 3.0 * (1 << bmi->acc[0x41]);
  for (int i = 0; i < 3; i++) {
    const double st = bmi->acc[0x6D] == 0x0D ? bmi->st_g[i] : bmi->acc[0x6D] == 0x09 ? -bmi->st_g[i] : 0;
    emu_put_le16(bmi->acc + 0x12 + 2 * i, emu_round((world->accel_g[i] + st) / full * 32768.0, 32767));
  }
  if (bmi->bus.now_us < bmi->temp_us) return;
  bmi->temp_us = bmi->bus.now_us + 1280000;
  const int32_t temp = emu_round((world->temp_degc - 23.0) / 0.125, 1023) & 0x7FF;
  bmi->acc[0x22] = (uint8_t)(bmi->is_temp_invalid ? 0x80 : temp >> 3);
  bmi->acc[0x23] = (uint8_t)((temp & 7) << 5);
}

static inline void emu_bmi_measure(emu_bmi_t* bmi) {
  emu_world_t world;
  emu_feel(&bmi->bus, bmi->k, bmi->next_us, &world);
  emu_bmi_measure_accel(bmi, &world);
  bmi->k++;
  const uint32_t mode = bmi->gyr[0x3E] >> 6;
  if (mode == 0) return;
  if (bmi->n_frames == 100) {
    bmi->gyr[0x0E] |= 0x80;
    bmi->n_overwritten++;
    if (mode == 1) return;
    bmi->first = (bmi->first + 1) % 100;
    bmi->n_frames--;
  }
  uint8_t* frame = bmi->frame[(bmi->first + bmi->n_frames++) % 100];
  for (int i = 0; i < 3; i++)
    emu_put_le16(frame + 2 * i, emu_round(world.rate_dps[i] / (2000.0 / (1 << bmi->gyr[0x0F])) * 32768.0, 32767));
}

static inline void emu_bmi_advance(emu_bmi_t* bmi, double us) {
  const double end_us = bmi->bus.now_us + us;
  const double period_us = 1e6 / emu_bmi_rate_hz(bmi) / (1.0 + bmi->bus.clock_error);
  while (bmi->next_us <= end_us) {
    bmi->bus.now_us = bmi->next_us;
    emu_bmi_measure(bmi);
    bmi->next_us += period_us;
  }
  bmi->bus.now_us = end_us;
}

static inline uint8_t emu_bmi_read_gyro(emu_bmi_t* bmi, uint8_t address, uint32_t* at) {
  if (address == 0x0E) return (uint8_t)((bmi->gyr[0x0E] & 0x80) | bmi->n_frames);
  if (address != 0x3F) return bmi->gyr[address];
  if (bmi->n_frames == 0) return 0;
  const uint8_t byte = bmi->frame[bmi->first][*at];
  if (++*at == 6) {
    *at = 0;
    bmi->first = (bmi->first + 1) % 100;
    bmi->n_frames--;
  }
  return byte;
}

static inline void emu_bmi_write_gyro(emu_bmi_t* bmi, uint8_t address, uint8_t value) {
  if (address <= 0x0E)
    bmi->bus.n_violations++;
  else if (address == 0x14 && value == 0xB6)
    emu_bmi_reset_gyro(bmi);
  else if (address == 0x3C)
    bmi->gyr[0x3C] = (uint8_t)(value & 1 ? 0x12 | (bmi->is_bist_bad ? 4 : 0) : 0x10);
  else if (address == 0x10)
    bmi->gyr[0x10] = (uint8_t)(0x80 | (value & 0x0F));
  else
    bmi->gyr[address] = value;
  if (address == 0x3D || (address == 0x3E && value >> 6 == 0)) bmi->first = bmi->n_frames = 0;
  if (address == 0x3E) bmi->gyr[0x0E] = 0;
}

static inline void emu_bmi_write_accel(emu_bmi_t* bmi, uint8_t address, uint8_t value) {
  const bool is_suspended = bmi->acc[0x7C] != 0 && address < 0x7C;
  if (address <= 0x3F || is_suspended)
    bmi->bus.n_violations++;
  else if (address == 0x7E && value == 0xB6)
    emu_bmi_reset_accel(bmi);
  else
    bmi->acc[address] = value;
}

static imucal_status emu_bmi_transfer(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in,
                                      size_t n_in) {
  emu_bmi_t* bmi = ctx;
  emu_bmi_advance(bmi, 2.0 + 0.8 * (double)(n_out + n_in));
  const bool is_read = out[0] & 0x80;
  const bool is_deaf =
      device == 0 ? !bmi->is_acc_spi || bmi->bus.now_us < bmi->acc_ready_us : bmi->bus.now_us < bmi->gyr_ready_us;
  uint8_t address = out[0] & 0x7F;
  uint32_t at = 0;
  for (size_t i = 0; i < n_in && is_read; i++) {
    if (is_deaf) {
      in[i] = 0;
    } else if (device == 0) {
      in[i] = i == 0 ? 0x5A : bmi->acc[address++ & 0x7F]; /* the dummy byte */
    } else {
      in[i] = emu_bmi_read_gyro(bmi, address, &at);
      if (address != 0x3F) address++;
    }
  }
  for (size_t i = 1; i < n_out && !is_read && bmi->bus.fault == EMU_BUS_GOOD; i++, address++) {
    if (is_deaf)
      bmi->bus.n_violations++;
    else if (device == 0)
      emu_bmi_write_accel(bmi, address, out[i]);
    else
      emu_bmi_write_gyro(bmi, address, out[i]);
  }
  if (device == 0 && !(out[0] == 0x7E && n_out > 1)) bmi->is_acc_spi = true; /* the rising edge of its chip select */
  return emu_bus_answer(&bmi->bus, in, n_in);
}

static void emu_bmi_delay(void* ctx, uint32_t us) {
  emu_bmi_advance(ctx, us);
}

static inline imucal_sensor_bus_t emu_bmi_bus(emu_bmi_t* bmi) {
  return (imucal_sensor_bus_t){.ctx = bmi, .transfer = emu_bmi_transfer, .delay_us = emu_bmi_delay, .is_spi = true};
}
#endif
