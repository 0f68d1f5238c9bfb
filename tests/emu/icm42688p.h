// SPDX-License-Identifier: MIT
/* Register-level model of the ICM-42688-P on SPI, from DS-000347 rev. 1.7: user banks 0 to 4 with their reset values,
 * address auto-increment (not at FIFO_DATA), read-only and clear-on-read registers, soft reset of 1 ms, 200 us without
 * register writes after PWR_MGMT0, gyro start-up, FIFO packets 3 and 4 in a ring of 2048 bytes (bypass, stream, stop on
 * full), time stamps, factory self-test codes and response.  Not modelled: notch and anti-alias filters, APEX, I3C,
 * interrupt pins. */
#ifndef IMUCAL_TESTS_EMU_ICM42688P_H
#define IMUCAL_TESTS_EMU_ICM42688P_H
#include "sensor_bus.h"

enum { ICM_FIFO_BYTES = 2048, ICM_RING = ICM_FIFO_BYTES / 16 };

typedef struct emu_icm {
  emu_bus_t bus;
  uint8_t reg[5][128];
  uint8_t bank;
  double reset_until_us, quiet_until_us, gyro_since_us, next_us;
  uint64_t k; /* samples measured since power-on */
  uint8_t packet[ICM_RING][20];
  uint32_t first, n_packets; /* whole packets in the FIFO */
  uint32_t at_byte;          /* of the first packet, read so far */
  uint32_t n_overwritten;
  double tick_us;     /* unit of the time stamps: 1, or 32/30 */
  double st_ratio[6]; /* self-test response over the factory's */
  uint8_t who_am_i;
  bool is_temp_frozen;
  double frozen_degc;
} emu_icm_t;

static inline void emu_icm_reset_registers(emu_icm_t* icm) {
  memset(icm->reg, 0, sizeof icm->reg);
  static const uint8_t bank0[][2] = {{0x13, 0x05}, {0x2D, 0x10}, {0x4C, 0x30}, {0x4D, 0x91}, {0x4F, 0x06},
                                     {0x50, 0x06}, {0x51, 0x16}, {0x52, 0x11}, {0x53, 0x0D}, {0x54, 0x23},
                                     {0x56, 0x82}, {0x64, 0x10}, {0x65, 0x10}};
  for (size_t i = 0; i < sizeof bank0 / sizeof bank0[0]; i++) icm->reg[0][bank0[i][0]] = bank0[i][1];
  icm->reg[0][0x75] = icm->who_am_i;
  static const uint8_t codes[6] = {120, 95, 101, 140, 133, 128};
  memcpy(&icm->reg[1][0x5F], codes, 3);
  memcpy(&icm->reg[2][0x3B], codes + 3, 3);
  icm->bank = 0;
  icm->first = icm->n_packets = icm->at_byte = 0;
}

static inline void emu_icm_power_on(emu_icm_t* icm) {
  memset(icm, 0, sizeof *icm);
  icm->who_am_i = 0x47;
  icm->tick_us = 32.0 / 30.0;
  for (int i = 0; i < 6; i++) icm->st_ratio[i] = 1.0;
  emu_icm_reset_registers(icm);
}

/* The sensor loses its supply for a moment. */
static inline void emu_icm_brown_out(emu_icm_t* icm) {
  emu_icm_reset_registers(icm);
  icm->reset_until_us = icm->bus.now_us + 1000;
}

static inline double emu_icm_rate_hz(const emu_icm_t* icm) {
  static const double odr[16] = {0, 32000, 16000, 8000, 4000, 2000, 1000, 200, 100, 50, 25, 12.5, 0, 0, 0, 500};
  return odr[icm->reg[0][0x4F] & 0x0F];
}

static inline uint32_t emu_icm_packet_bytes(const emu_icm_t* icm) {
  return (icm->reg[0][0x5F] & 0x13) == 0x13 ? 20 : 16;
}

/* Counts with four fractional bits: the 20-bit form. */
static inline int32_t emu_icm_word20(double value, double full_scale, bool is_hires, uint32_t zero_bits) {
  const int32_t word = emu_round(value / full_scale * 32768.0 * (is_hires ? 16 >> zero_bits : 1),
                                 is_hires ? 524287 >> zero_bits : 32767);
  return is_hires ? word * (1 << zero_bits) : word * 16;
}

static inline void emu_icm_words(emu_icm_t* icm, const emu_world_t* world, bool is_fifo, int32_t gyro[3],
                                 int32_t accel[3]) {
  const bool is_hires = is_fifo && emu_icm_packet_bytes(icm) == 20;
  const double gyro_fs = is_hires ? 2000.0 : 2000.0 / (1 << (icm->reg[0][0x4F] >> 5));
  const double accel_fs = is_hires ? 16.0 : 16.0 / (1 << (icm->reg[0][0x50] >> 5));
  const bool is_gyro_up = icm->bus.now_us - icm->gyro_since_us >= 30000.0;
  for (int i = 0; i < 3; i++) {
    const uint8_t st = icm->reg[0][0x70];
    const double st_unit = icm->reg[1][0x5F + i] ? 2620.0 * pow(1.01, icm->reg[1][0x5F + i] - 1) * 250.0 / 32768.0 : 0;
    const double sta_unit = icm->reg[2][0x3B + i] ? 2620.0 * pow(1.01, icm->reg[2][0x3B + i] - 1) * 2.0 / 32768.0 : 0;
    const double g = world->rate_dps[i] + ((st >> i & 1) ? st_unit * icm->st_ratio[i] : 0);
    const double a = world->accel_g[i] + ((st >> (3 + i) & 1) && (st & 0x40) ? sta_unit * icm->st_ratio[3 + i] : 0);
    gyro[i] = is_gyro_up ? emu_icm_word20(g, gyro_fs, is_hires, 1) : -524288;
    accel[i] = emu_icm_word20(a, accel_fs, is_hires, 2);
  }
}

static inline void emu_icm_push(emu_icm_t* icm, const int32_t gyro[3], const int32_t accel[3], int32_t temp,
                                uint16_t stamp) {
  const uint32_t bytes = emu_icm_packet_bytes(icm), capacity = ICM_FIFO_BYTES / bytes;
  const uint32_t mode = icm->reg[0][0x16] >> 6;
  if (mode == 0 || !(icm->reg[0][0x5F] & 3)) return;
  if (icm->n_packets == capacity) {
    icm->reg[0][0x2D] |= 0x02;
    icm->n_overwritten++;
    if (mode != 1) return;
    icm->first = (icm->first + 1) % ICM_RING;
    icm->n_packets--;
    icm->at_byte = 0;
  }
  uint8_t* p = icm->packet[(icm->first + icm->n_packets++) % ICM_RING];
  p[0] = (uint8_t)(0x68 | (bytes == 20 ? 0x10 : 0));
  for (int i = 0; i < 3; i++) {
    emu_put_be16(p + 1 + 2 * i, accel[i] >> 4);
    emu_put_be16(p + 7 + 2 * i, gyro[i] >> 4);
    if (bytes == 20) p[17 + i] = (uint8_t)((accel[i] & 0xF) << 4 | (gyro[i] & 0xF));
  }
  if (bytes == 20)
    emu_put_be16(p + 13, temp);
  else
    p[13] = (uint8_t)emu_round(temp / 64.0, 127);
  emu_put_be16(p + (bytes == 20 ? 15 : 14), stamp);
}

static inline void emu_icm_measure(emu_icm_t* icm) {
  emu_world_t world;
  emu_feel(&icm->bus, icm->k, icm->next_us, &world);
  if (icm->is_temp_frozen) world.temp_degc = icm->frozen_degc;
  const double temp_noise = icm->is_temp_frozen ? 0 : 2.0 * emu_noise(icm->k, 99);
  const int32_t temp = emu_round((world.temp_degc - 25.0) * 132.48 + temp_noise, 32767);
  int32_t gyro[3], accel[3];
  emu_icm_words(icm, &world, false, gyro, accel);
  emu_put_be16(&icm->reg[0][0x1D], temp);
  for (int i = 0; i < 3; i++) {
    emu_put_be16(&icm->reg[0][0x1F + 2 * i], accel[i] >> 4);
    emu_put_be16(&icm->reg[0][0x25 + 2 * i], gyro[i] >> 4);
  }
  icm->reg[0][0x2D] |= 0x08;
  emu_icm_words(icm, &world, true, gyro, accel);
  emu_icm_push(icm, gyro, accel, temp,
               (uint16_t)(uint64_t)((double)icm->k * 1e6 / emu_icm_rate_hz(icm) / icm->tick_us));
  icm->k++;
}

static inline void emu_icm_advance(emu_icm_t* icm, double us) {
  icm->bus.now_us += us;
  const bool is_on = (icm->reg[0][0x4E] & 0x0C) == 0x0C && emu_icm_rate_hz(icm) > 0;
  const double period_us = is_on ? 1e6 / emu_icm_rate_hz(icm) / (1.0 + icm->bus.clock_error) : 0;
  const double end_us = icm->bus.now_us;
  while (is_on && icm->next_us <= end_us) {
    icm->bus.now_us = icm->next_us;
    if (icm->next_us >= icm->reset_until_us) emu_icm_measure(icm);
    icm->next_us += period_us;
  }
  if (!is_on) icm->next_us = end_us;
  icm->bus.now_us = end_us;
}

static inline uint8_t emu_icm_fifo_byte(emu_icm_t* icm) {
  if (icm->n_packets == 0) return 0xFF; /* header with bit 7 set: empty */
  const uint8_t byte = icm->packet[icm->first][icm->at_byte++];
  if (icm->at_byte == emu_icm_packet_bytes(icm)) {
    icm->first = (icm->first + 1) % ICM_RING;
    icm->n_packets--;
    icm->at_byte = 0;
  }
  return byte;
}

static inline uint8_t emu_icm_read(emu_icm_t* icm, uint8_t address) {
  if (address == 0x76) return icm->bank;
  if (icm->bank == 0 && address == 0x2E) { /* the level is latched when its high byte is read */
    const uint32_t level = icm->n_packets * emu_icm_packet_bytes(icm) - icm->at_byte;
    icm->reg[0][0x2F] = (uint8_t)level;
    return (uint8_t)(level >> 8);
  }
  if (icm->bank == 0 && address == 0x30) return emu_icm_fifo_byte(icm);
  const uint8_t value = icm->reg[icm->bank][address];
  if (icm->bank == 0 && address == 0x2D) icm->reg[0][0x2D] = 0;
  return value;
}

static inline void emu_icm_write(emu_icm_t* icm, uint8_t address, uint8_t value) {
  if (icm->bus.now_us < icm->quiet_until_us) icm->bus.n_violations++;
  if (address == 0x76) {
    icm->bank = value & 7 ? (uint8_t)((value & 7) % 5) : 0;
    return;
  }
  const bool is_read_only =
      icm->bank == 0 && ((address >= 0x1D && address <= 0x30) || address == 0x75 || address == 0x6C || address == 0x6D);
  if (is_read_only || icm->bus.now_us < icm->quiet_until_us) {
    icm->bus.n_violations += is_read_only ? 1u : 0u;
    return;
  }
  if (icm->bank == 0 && address == 0x11 && (value & 1)) {
    emu_icm_brown_out(icm);
    return;
  }
  if (icm->bank == 0 && address == 0x4B) { /* clears itself */
    if (value & 2) icm->first = icm->n_packets = icm->at_byte = 0;
    return;
  }
  if (icm->bank == 0 && address == 0x4E) {
    if ((value & 0x0C) == 0x0C && (icm->reg[0][0x4E] & 0x0C) != 0x0C) icm->gyro_since_us = icm->bus.now_us;
    icm->quiet_until_us = icm->bus.now_us + 200;
    icm->next_us = icm->bus.now_us + 1000;
  }
  if (icm->bank == 0 && address == 0x16 && value >> 6 == 0) icm->first = icm->n_packets = icm->at_byte = 0;
  icm->reg[icm->bank][address] = value;
}

static imucal_status emu_icm_transfer(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in,
                                      size_t n_in) {
  emu_icm_t* icm = ctx;
  (void)device;
  emu_icm_advance(icm, 1.0 + 0.5 * (double)(n_out + n_in)); /* 16 MHz, and the driver's own work */
  const bool is_deaf = icm->bus.now_us < icm->reset_until_us;
  uint8_t address = out[0] & 0x7F;
  for (size_t i = 0; i < n_in && (out[0] & 0x80); i++) {
    in[i] = is_deaf ? 0 : emu_icm_read(icm, address);
    if (!(icm->bank == 0 && address == 0x30)) address = (uint8_t)((address + 1) & 0x7F);
  }
  for (size_t i = 1; i < n_out && !(out[0] & 0x80); i++) {
    if (is_deaf)
      icm->bus.n_violations++;
    else if (icm->bus.fault == EMU_BUS_GOOD)
      emu_icm_write(icm, address, out[i]);
    address = (uint8_t)((address + 1) & 0x7F);
  }
  return emu_bus_answer(&icm->bus, in, n_in);
}

static void emu_icm_delay(void* ctx, uint32_t us) {
  emu_icm_advance(ctx, us);
}

static inline imucal_sensor_bus_t emu_icm_bus(emu_icm_t* icm) {
  return (imucal_sensor_bus_t){.ctx = icm, .transfer = emu_icm_transfer, .delay_us = emu_icm_delay, .is_spi = true};
}
#endif
