// SPDX-License-Identifier: MIT
/* Model of a W25Q128JV behind its SPI bus: instructions, status registers, write enable latch, page wrap, sector erase, busy
 * times, power-down; where each is confirmed stands in firmware/port/stm32f405/README.md.  It shares its author with the driver:
 * tests/firmware/test_w25q_wire.c holds the driver's bytes against other people's tables.  What the data sheet
 * says is ignored is ignored here, and counted: a driver that relies on it is wrong.
 * Faults: bus all 0, all 1, failing; a latch that does not set; busy for ever; protection; another identity; power cut inside
 * any byte of a program and any part of an erase, after which bits may read differently from read to read. */
#ifndef IMUCAL_TESTS_EMU_W25Q_H
#define IMUCAL_TESTS_EMU_W25Q_H
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "flash/w25q.h"

#define EMU_W25Q_BYTES 65536u /* of the array that are kept; addresses beyond repeat them */
enum { EMU_W25Q_NEVER = -1 };

typedef struct emu_w25q {
  uint8_t bytes[EMU_W25Q_BYTES], wavers[EMU_W25Q_BYTES];
  uint8_t id[3], sr1, sr2, sr3; /* sr1 without BUSY; sr3 FFh: has none */
  bool is_down;                 /* power-down: hears nothing but ABh */
  uint64_t now_us, busy_until_us;
  uint32_t erase_us;
  uint64_t random;
  /* faults */
  enum { EMU_W25Q_GOOD, EMU_W25Q_ZEROS, EMU_W25Q_ONES, EMU_W25Q_ERRORS } bus_fault;
  bool is_latch_stuck, stays_busy, is_supply_low;
  uint32_t fail_at;            /* this transfer, counted by n_transfers, fails; 0: none */
  long steps_left, steps_used; /* bytes programmed and 256ths of a sector erased until the power goes */
  bool is_off;
  /* what the driver did */
  uint32_t first, last; /* addresses it may write */
  uint32_t n_transfers, n_erases, n_programs, n_pages_wrapped;
  uint32_t n_violations; /* ignored by the chip, outside first .. last, 0 to 1 without an erase */
} emu_w25q_t;

static inline uint64_t emu_w25q_random(emu_w25q_t* chip) {
  uint64_t x = chip->random += 0x9E3779B97F4A7C15u;
  x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
  x = (x ^ x >> 27) * 0x94D049BB133111EBu;
  return x ^ x >> 31;
}

/* As it comes: erased, nothing protected, QE set in the -IQ types. */
static inline void emu_w25q_init(emu_w25q_t* chip, uint32_t base) {
  memset(chip, 0, sizeof *chip);
  memset(chip->bytes, 0xFF, sizeof chip->bytes);
  chip->id[0] = 0xEF, chip->id[1] = 0x40, chip->id[2] = 0x18;
  chip->sr2 = 0x02;
  chip->sr3 = 0x60;
  chip->erase_us = 45000;
  chip->steps_left = EMU_W25Q_NEVER;
  chip->first = base;
  chip->last = base + 2 * 4096 - 1;
}

static inline void emu_w25q_power_on(emu_w25q_t* chip) {
  chip->sr1 &= (uint8_t)~2u;
  chip->is_down = chip->is_off = false;
  chip->busy_until_us = 0;
  chip->steps_left = EMU_W25Q_NEVER;
  chip->steps_used = 0;
}

static inline bool emu_w25q_is_busy(const emu_w25q_t* chip) {
  return chip->stays_busy || chip->now_us < chip->busy_until_us;
}

/* BP2 to BP0, CMP, SUS, WPS: here any bit protects all of it. */
static inline bool emu_w25q_is_protected(const emu_w25q_t* chip) {
  return (chip->sr1 & 0x1C) != 0 || (chip->sr2 & 0xC0) != 0 || ((chip->sr3 & 0x04) != 0 && chip->sr3 != 0xFF);
}

/* One byte on its way from old to new when the power goes. */
static inline void emu_w25q_tear(emu_w25q_t* chip, uint32_t at, uint8_t to) {
  const uint8_t moving = (uint8_t)((chip->bytes[at] ^ to) | chip->wavers[at]);
  const uint8_t took = moving & (uint8_t)emu_w25q_random(chip);
  chip->bytes[at] = (uint8_t)((chip->bytes[at] & ~took) | (to & took));
  chip->wavers[at] = moving & (uint8_t)emu_w25q_random(chip);
}

static inline bool emu_w25q_step(emu_w25q_t* chip) {
  chip->steps_used++;
  if (chip->steps_left == EMU_W25Q_NEVER || chip->steps_left-- > 0) return true;
  chip->is_off = true;
  return false;
}

/* A write needs the latch, and an array that is not protected; the latch is cleared when it ends. */
static inline bool emu_w25q_may_write(emu_w25q_t* chip, uint32_t address) {
  const bool is_inside = address >= chip->first && address <= chip->last;
  const bool is_allowed = (chip->sr1 & 2u) && !emu_w25q_is_protected(chip);
  if (!is_inside || !is_allowed) chip->n_violations++;
  return is_allowed;
}

static inline void emu_w25q_erase(emu_w25q_t* chip, uint32_t address) {
  if (!emu_w25q_may_write(chip, address)) return;
  const uint32_t sector = address % EMU_W25Q_BYTES & ~4095u;
  chip->n_erases++;
  chip->sr1 &= (uint8_t)~2u;
  for (uint32_t part = 0; part < 256; part++) {
    if (!emu_w25q_step(chip)) { /* the cells of a sector move together: all of it is torn */
      for (uint32_t i = 0; i < 4096; i++) emu_w25q_tear(chip, sector + i, 0xFF);
      return;
    }
  }
  memset(chip->bytes + sector, 0xFF, 4096);
  memset(chip->wavers + sector, 0, 4096);
  chip->busy_until_us = chip->now_us + chip->erase_us;
}

/* Beyond the end of the page the address begins again at its start. */
static inline void emu_w25q_program(emu_w25q_t* chip, uint32_t address, const uint8_t* data, size_t n) {
  if (n == 0 || n > 256) chip->n_violations++;
  if (!emu_w25q_may_write(chip, address)) return;
  chip->n_programs++;
  chip->sr1 &= (uint8_t)~2u;
  if (address % 256 + n > 256) chip->n_pages_wrapped++;
  for (size_t i = 0; i < n; i++) {
    const uint32_t at = ((address & ~255u) + (address + (uint32_t)i) % 256) % EMU_W25Q_BYTES;
    const uint8_t to = chip->bytes[at] & data[i];
    if (to != data[i] && chip->wavers[at] == 0) chip->n_violations++;
    if (!emu_w25q_step(chip)) {
      emu_w25q_tear(chip, at, to);
      return;
    }
    chip->bytes[at] = to;
    chip->wavers[at] &= data[i]; /* programmed to 0 it is 0; one that should be 1 goes on wavering */
  }
  chip->busy_until_us = chip->now_us + 30 + 5 * n / 2; /* 0.67 ms a page; tPP is 0.7 ms */
}

static inline uint8_t emu_w25q_byte(emu_w25q_t* chip, uint32_t address) {
  const uint32_t at = address % EMU_W25Q_BYTES;
  return (uint8_t)((chip->bytes[at] & ~chip->wavers[at]) | ((uint8_t)emu_w25q_random(chip) & chip->wavers[at]));
}

/* Undriven, the line is pulled up. */
static inline void emu_w25q_answer(emu_w25q_t* chip, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  const uint32_t address = n_out >= 4 ? (uint32_t)out[1] << 16 | (uint32_t)out[2] << 8 | out[3] : 0;
  if (n_in) memset(in, 0xFF, n_in);
  if (chip->is_down && out[0] != 0xAB) return;
  const bool is_busy = emu_w25q_is_busy(chip);
  if (out[0] == 0x05 || out[0] == 0x35 || out[0] == 0x15) {
    const uint8_t value = out[0] == 0x05 ? (uint8_t)(chip->sr1 | is_busy) : out[0] == 0x35 ? chip->sr2 : chip->sr3;
    memset(in, value, n_in);
    return;
  }
  if (is_busy) { /* all else is ignored; ABh may be tried, it changes nothing */
    if (out[0] != 0xAB) chip->n_violations++;
    return;
  }
  switch (out[0]) {
  case 0xAB:
    chip->is_down = false;
    break;
  case 0x9F:
    for (size_t i = 0; i < n_in; i++) in[i] = chip->id[i % 3];
    break;
  case 0x06:
    if (!chip->is_latch_stuck) chip->sr1 |= 2u;
    break;
  case 0x03:
    for (size_t i = 0; i < n_in; i++) in[i] = emu_w25q_byte(chip, address + (uint32_t)i);
    break;
  case 0x02:
    emu_w25q_program(chip, address, out + 4, n_out - 4);
    break;
  case 0x20:
    emu_w25q_erase(chip, address);
    break;
  default:
    chip->n_violations++;
  }
}

static inline imucal_status emu_w25q_transfer(void* ctx, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  emu_w25q_t* chip = (emu_w25q_t*)ctx;
  chip->n_transfers++;
  chip->now_us += n_out + n_in;
  if (chip->is_off || chip->bus_fault == EMU_W25Q_ERRORS || chip->n_transfers == chip->fail_at)
    return IMUCAL_ERR_SENSOR;
  if (chip->bus_fault == EMU_W25Q_GOOD) {
    emu_w25q_answer(chip, out, n_out, in, n_in);
    return chip->is_off ? IMUCAL_ERR_SENSOR : IMUCAL_OK;
  }
  if (n_in) memset(in, chip->bus_fault == EMU_W25Q_ONES ? 0xFF : 0x00, n_in);
  return IMUCAL_OK;
}

static inline void emu_w25q_delay_us(void* ctx, uint32_t us) {
  ((emu_w25q_t*)ctx)->now_us += us;
}

static inline bool emu_w25q_is_supply_good(void* ctx) {
  return !((emu_w25q_t*)ctx)->is_supply_low;
}

static inline imucal_w25q_bus_t emu_w25q_bus(emu_w25q_t* chip) {
  return (imucal_w25q_bus_t){chip, emu_w25q_transfer, emu_w25q_delay_us, emu_w25q_is_supply_good};
}
#endif
