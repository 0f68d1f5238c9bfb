// SPDX-License-Identifier: MIT
/* Register-level model of the LSM6DSO, from DS12140 rev. 5: reset values, software reset, auto-increment only with
 * IF_INC and within FIFO_DATA_OUT (79h..7Eh back to 78h), read-only registers, FIFO of 512 tagged words with slot counter
 * and parity (bypass, FIFO, continuous), overrun flags, INTERNAL_FREQ_FINE, self-test.  Not modelled: embedded
 * functions, sensor hub, compression, I3C. */
#ifndef IMUCAL_TESTS_EMU_LSM6DSO_H
#define IMUCAL_TESTS_EMU_LSM6DSO_H
#include "sensor_bus.h"

enum { LSM_WORDS = 512 };

typedef struct emu_lsm {
  emu_bus_t bus;
  bool is_spi;
  uint8_t who_am_i;
  int8_t freq_fine; /* what the factory wrote; the true clock error is bus.clock_error */
  uint8_t reg[128];
  uint8_t word[LSM_WORDS][7];
  uint32_t first, n_words, at_byte, n_overwritten;
  double next_us, since_us;
  uint64_t k;
  double st_dps[3], st_g[3];
  bool is_temp_frozen;
  bool is_accel_first; /* order of the two words of a time slot: the data sheet leaves it open */
} emu_lsm_t;

static inline void emu_lsm_reset_registers(emu_lsm_t* lsm) {
  memset(lsm->reg, 0, sizeof lsm->reg);
  lsm->reg[0x02] = 0x3F;
  lsm->reg[0x0F] = lsm->who_am_i;
  lsm->reg[0x12] = 0x04;
  lsm->reg[0x18] = 0xE0;
  lsm->reg[0x63] = (uint8_t)lsm->freq_fine;
  lsm->first = lsm->n_words = lsm->at_byte = 0;
}

static inline void emu_lsm_power_on(emu_lsm_t* lsm) {
  memset(lsm, 0, sizeof *lsm);
  lsm->who_am_i = 0x6C;
  for (int i = 0; i < 3; i++) {
    lsm->st_dps[i] = i == 1 ? -400 : 400;
    lsm->st_g[i] = 0.5;
  }
  emu_lsm_reset_registers(lsm);
}

static inline double emu_lsm_rate_hz(uint8_t ctrl) {
  const int code = ctrl >> 4;
  return code == 0 || code > 10 ? 0 : code == 1 ? 12.5 : 1e6 / 150.0 / (1 << (10 - code));
}

static inline void emu_lsm_push(emu_lsm_t* lsm, uint8_t kind, const uint8_t* six) {
  const uint32_t mode = lsm->reg[0x0A] & 7;
  if (mode == 0 || (mode == 1 && lsm->n_words == LSM_WORDS)) return;
  if (lsm->n_words == LSM_WORDS) {
    lsm->reg[0x3B] |= 0x48;
    lsm->first = (lsm->first + 1) % LSM_WORDS;
    lsm->n_words--;
    lsm->n_overwritten++;
    lsm->at_byte = 0;
  }
  uint8_t* word = lsm->word[(lsm->first + lsm->n_words++) % LSM_WORDS];
  uint8_t tag = (uint8_t)(kind << 3 | (lsm->k & 3) << 1);
  for (int bit = 1, ones = 0; bit < 8; bit++) {
    ones += tag >> bit & 1;
    if (bit == 7) tag = (uint8_t)(tag | (ones & 1));
  }
  word[0] = tag;
  memcpy(word + 1, six, 6);
}

static inline void emu_lsm_measure(emu_lsm_t* lsm) {
  static const double ranges_g[4] = {2, 16, 4, 8};
  emu_world_t world;
  emu_feel(&lsm->bus, lsm->k, lsm->next_us, &world);
  const double degc = lsm->is_temp_frozen ? 30.0 : world.temp_degc + 0.02 * emu_noise(lsm->k, 99);
  emu_put_le16(lsm->reg + 0x20, emu_round((degc - 25.0) * 256.0, 32767));
  const double dps_lsb = 0.00875 * (1 << (lsm->reg[0x11] >> 2 & 3));
  const double g_lsb = 0.000061 * ranges_g[lsm->reg[0x10] >> 2 & 3] / 2;
  const bool is_up = lsm->next_us - lsm->since_us > 70000;
  for (int i = 0; i < 3; i++) {
    const double rate = world.rate_dps[i] + ((lsm->reg[0x14] >> 2 & 3) == 1 ? lsm->st_dps[i] : 0);
    const double accel = world.accel_g[i] + ((lsm->reg[0x14] & 3) == 1 ? lsm->st_g[i] : 0);
    emu_put_le16(lsm->reg + 0x22 + 2 * i, is_up ? emu_round(rate / dps_lsb, 32767) : 12345); /* settling */
    emu_put_le16(lsm->reg + 0x28 + 2 * i, emu_round(accel / g_lsb, 32767));
  }
  lsm->reg[0x1E] = 7;
  for (int turn = 0; turn < 2; turn++) {
    if ((turn == 0) == lsm->is_accel_first && (lsm->reg[0x09] & 15)) emu_lsm_push(lsm, 2, lsm->reg + 0x28);
    if ((turn == 0) != lsm->is_accel_first && lsm->reg[0x09] >> 4) emu_lsm_push(lsm, 1, lsm->reg + 0x22);
  }
  lsm->k++;
}

static inline void emu_lsm_advance(emu_lsm_t* lsm, double us) {
  const double end_us = lsm->bus.now_us + us, rate_hz = emu_lsm_rate_hz(lsm->reg[0x11]);
  const double period_us = rate_hz > 0 ? 1e6 / rate_hz / (1.0 + lsm->bus.clock_error) : 0;
  if (rate_hz <= 0) lsm->next_us = end_us;
  while (rate_hz > 0 && lsm->next_us <= end_us) {
    lsm->bus.now_us = lsm->next_us;
    emu_lsm_measure(lsm);
    lsm->next_us += period_us;
  }
  lsm->bus.now_us = end_us;
}

static inline uint8_t emu_lsm_read(emu_lsm_t* lsm, uint8_t address) {
  if (address >= 0x78 && address <= 0x7E) {
    if (lsm->n_words == 0) return 0;
    const uint8_t byte = lsm->word[lsm->first][address - 0x78];
    if (address == 0x7E) { /* the word leaves with its last byte */
      lsm->first = (lsm->first + 1) % LSM_WORDS;
      lsm->n_words--;
    }
    return byte;
  }
  if (address == 0x3A) return (uint8_t)lsm->n_words;
  if (address == 0x3B) {
    const uint8_t status = (uint8_t)((lsm->reg[0x3B] & 0x48) | lsm->n_words >> 8);
    lsm->reg[0x3B] = 0;
    return status;
  }
  return lsm->reg[address];
}

static inline void emu_lsm_write(emu_lsm_t* lsm, uint8_t address, uint8_t value) {
  const bool is_read_only = address == 0x0F || (address >= 0x1A && address <= 0x2D) || address == 0x3A ||
                            address == 0x3B || address == 0x63 || address >= 0x78;
  if (is_read_only) {
    lsm->bus.n_violations++;
    return;
  }
  if (address == 0x12 && (value & 1)) {
    emu_lsm_reset_registers(lsm);
    return;
  }
  if (address == 0x0A && (value & 7) == 0) lsm->first = lsm->n_words = 0;
  if (address == 0x11 && lsm->reg[0x11] >> 4 == 0 && value >> 4) lsm->since_us = lsm->bus.now_us;
  lsm->reg[address] = value;
}

static imucal_status emu_lsm_transfer(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in,
                                      size_t n_in) {
  emu_lsm_t* lsm = ctx;
  (void)device;
  emu_lsm_advance(lsm, (lsm->is_spi ? 1.0 : 22.5) * (double)(2 + n_out + n_in));
  uint8_t address = out[0] & 0x7F;
  if (!lsm->is_spi && (out[0] & 0x80)) lsm->bus.n_violations++;
  const uint8_t step = lsm->reg[0x12] & 0x04 ? 1 : 0;
  for (size_t i = 1; i < n_out && lsm->bus.fault == EMU_BUS_GOOD; i++, address = (uint8_t)(address + step))
    emu_lsm_write(lsm, address, out[i]);
  for (size_t i = 0; i < n_in; i++) {
    in[i] = emu_lsm_read(lsm, address);
    address = address == 0x7E ? 0x78 : (uint8_t)((address + step) & 0x7F);
  }
  return emu_bus_answer(&lsm->bus, in, n_in);
}

static void emu_lsm_delay(void* ctx, uint32_t us) {
  emu_lsm_advance(ctx, us);
}

static inline imucal_sensor_bus_t emu_lsm_bus(emu_lsm_t* lsm, bool is_spi) {
  lsm->is_spi = is_spi;
  return (imucal_sensor_bus_t){.ctx = lsm, .transfer = emu_lsm_transfer, .delay_us = emu_lsm_delay, .is_spi = is_spi};
}
#endif
