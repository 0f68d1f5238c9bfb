// SPDX-License-Identifier: MIT
/* Register-level model of the STM32F405's I2C1 in master mode (RM0090 chapter 27), as seen by the driver's own source: the order of
 * flags, the two receive registers, when an acknowledge is decided, what ADDR, BTF and STOP need.  What the manual forbids is
 * counted.  Faults: nobody acknowledges, arbitration lost, bus error, a clock that is held, a data line that is held.
 * The slave is a function that takes and gives bytes.  Included after emu/stm32f405.h, whose registers it extends. */
#ifndef IMUCAL_TESTS_EMU_STM32F405_I2C_H
#define IMUCAL_TESTS_EMU_STM32F405_I2C_H
#include "emu/stm32f405.h"

typedef struct emu_i2c {
  uint32_t cr1, cr2, ccr, trise, sr1;
  bool is_busy, is_reader, is_started, has_dr, has_shift, is_refused; /* refused: the slave got its NACK */
  bool is_sr1_read;                                                   /* since ADDR rose */
  uint8_t dr, shift;
  uint32_t n_violations, n_starts, n_stops, n_resets, n_bytes;
  uint32_t n_acked_too_many; /* bytes acknowledged after the last one wanted */
  /* The sensor: first: just addressed to write.  Returns whether it acknowledges. */
  bool (*put)(uint8_t byte, bool is_first);
  uint8_t (*get)(void);
  uint8_t address;
  bool is_absent, is_clock_held, is_line_held; /* line held: until nine clocks */
  uint32_t lose_arbitration_at, bus_error_at;  /* byte number + 1 */
  uint32_t n_clocks;
  bool is_first_byte;
} emu_i2c_t;

static emu_i2c_t i2c;

/* The master's receiver: a byte comes while there is room, and is acknowledged as CR1 says at that moment (with POS the first
 * byte always is). */
static inline void emu_i2c_run(void) {
  if (i2c.is_clock_held || !i2c.is_busy || (i2c.sr1 & (I2C_SR1_ADDR | I2C_SR1_SB))) return;
  if (!i2c.is_reader) {
    if (i2c.has_shift) {
      i2c.has_shift = false;
      i2c.n_bytes++;
      if (i2c.n_bytes == i2c.lose_arbitration_at) { /* the bus is another master's now */
        i2c.sr1 |= I2C_SR1_ARLO;
        i2c.is_busy = false;
        return;
      }
      if (i2c.n_bytes == i2c.bus_error_at) i2c.sr1 |= I2C_SR1_BERR;
      if (!i2c.put(i2c.shift, i2c.is_first_byte)) i2c.sr1 |= I2C_SR1_AF;
      i2c.is_first_byte = false;
    }
    if (i2c.has_dr) {
      i2c.shift = i2c.dr;
      i2c.has_shift = true;
      i2c.has_dr = false;
      i2c.sr1 |= I2C_SR1_TXE;
      i2c.sr1 &= ~I2C_SR1_BTF;
    } else if (i2c.is_started && !i2c.has_shift && i2c.n_bytes > 0 && !(i2c.sr1 & I2C_SR1_AF)) {
      i2c.sr1 |= I2C_SR1_BTF;
    }
    return;
  }
  for (int i = 0; i < 2 && !i2c.is_refused && !i2c.has_shift; i++) {
    i2c.shift = i2c.get();
    i2c.has_shift = true;
    i2c.n_bytes++;
    const bool is_acked = (i2c.cr1 & I2C_CR1_ACK) || ((i2c.cr1 & I2C_CR1_POS) && i2c.n_bytes == 1);
    i2c.is_refused = !is_acked;
    if (!i2c.has_dr) {
      i2c.dr = i2c.shift;
      i2c.has_dr = true;
      i2c.has_shift = false;
    }
  }
  if (i2c.has_dr) i2c.sr1 |= I2C_SR1_RXNE;
  if (i2c.has_dr && i2c.has_shift) i2c.sr1 |= I2C_SR1_BTF;
}

static inline uint32_t emu_i2c_take_dr(void) {
  if (!i2c.has_dr) i2c.n_violations++;
  const uint8_t byte = i2c.dr;
  i2c.has_dr = i2c.has_shift;
  if (i2c.has_shift) i2c.dr = i2c.shift;
  i2c.has_shift = false;
  i2c.sr1 &= ~(I2C_SR1_RXNE | I2C_SR1_BTF);
  emu_i2c_run();
  if (i2c.has_dr) i2c.sr1 |= I2C_SR1_RXNE;
  return byte;
}

static inline uint32_t emu_i2c_read(uint32_t address) {
  stm32.now_us += 5;
  emu_i2c_run();
  switch (address) {
  case I2C_CR1:
    return i2c.cr1;
  case I2C_SR1:
    i2c.is_sr1_read = true;
    return i2c.sr1;
  case I2C_SR2: {
    const bool was_busy = i2c.is_busy || i2c.is_line_held;
    if ((i2c.sr1 & I2C_SR1_ADDR) && i2c.is_sr1_read) i2c.sr1 &= ~I2C_SR1_ADDR;
    if (i2c.is_started && !i2c.is_reader && !(i2c.sr1 & I2C_SR1_ADDR)) i2c.sr1 |= i2c.n_bytes == 0 ? I2C_SR1_TXE : 0;
    return (was_busy ? I2C_SR2_BUSY : 0) | 1u;
  }
  case I2C_DR:
    return emu_i2c_take_dr();
  default:
    return address == I2C_CR2 ? i2c.cr2 : address == I2C_CCR ? i2c.ccr : i2c.trise;
  }
}

static inline void emu_i2c_stop(void) {
  if (!i2c.is_busy && !i2c.is_line_held) i2c.n_violations++;
  if (i2c.is_reader && !i2c.is_refused && !(i2c.sr1 & I2C_SR1_ERRORS) && i2c.n_bytes > 0) i2c.n_acked_too_many++;
  i2c.is_busy = i2c.is_clock_held;
  i2c.n_stops++;
}

static inline void emu_i2c_cr1(uint32_t value) {
  if (value & I2C_CR1_SWRST) {
    const uint32_t n_resets = i2c.n_resets + 1;
    i2c.sr1 = i2c.cr1 = 0;
    i2c.is_busy = i2c.is_started = i2c.has_dr = i2c.has_shift = false;
    i2c.n_resets = n_resets;
    return;
  }
  i2c.cr1 = value & ~(I2C_CR1_START | I2C_CR1_STOP);
  if (value & I2C_CR1_STOP) {
    /* One byte wanted: the stop is written while it still comes. */
    if (i2c.is_reader && i2c.is_started && i2c.n_bytes == 0) emu_i2c_run();
    emu_i2c_stop();
  }
  if (!(value & I2C_CR1_START)) return;
  if (!(value & I2C_CR1_PE) || i2c.ccr == 0 || i2c.trise == 0 || i2c.cr2 < 2) i2c.n_violations++; /* not set up */
  i2c.n_starts++;
  i2c.is_busy = true;
  i2c.is_started = false;
  i2c.sr1 = i2c.is_clock_held ? 0 : I2C_SR1_SB;
}

static inline void emu_i2c_dr(uint32_t value) {
  if (i2c.sr1 & I2C_SR1_SB) { /* the address */
    i2c.sr1 &= ~(I2C_SR1_SB | I2C_SR1_BTF | I2C_SR1_TXE);
    i2c.is_reader = value & 1u;
    i2c.n_bytes = 0;
    i2c.has_dr = i2c.has_shift = i2c.is_refused = false;
    i2c.is_first_byte = true;
    i2c.is_sr1_read = false;
    i2c.is_started = !i2c.is_absent && value >> 1 == i2c.address;
    i2c.sr1 |= i2c.is_started ? I2C_SR1_ADDR : I2C_SR1_AF;
    return;
  }
  if (!(i2c.sr1 & I2C_SR1_TXE) || !i2c.is_started || i2c.is_reader) i2c.n_violations++;
  i2c.dr = (uint8_t)value;
  i2c.has_dr = true;
  i2c.sr1 &= ~(I2C_SR1_TXE | I2C_SR1_BTF);
}

static inline void emu_i2c_write(uint32_t address, uint32_t value) {
  if (address == I2C_CR1) emu_i2c_cr1(value);
  if (address == I2C_CR2) i2c.cr2 = value;
  if (address == I2C_CCR) i2c.ccr = value;
  if (address == I2C_TRISE) i2c.trise = value;
  if (address == I2C_SR1) i2c.sr1 &= value | ~I2C_SR1_ERRORS;
  if (address == I2C_DR) emu_i2c_dr(value);
}

/* Port B as inputs and outputs: nine clocks free a line that is held. */
static inline uint32_t emu_i2c_idr(void) {
  return 1u << 6 | (i2c.is_line_held ? 0 : 1u << 7);
}

static inline void emu_i2c_bsrr(uint32_t value) {
  if (value & 1u << 6 && ++i2c.n_clocks > 8) i2c.is_line_held = false;
}

static inline uint32_t emu_i2c_port_read(uint32_t address) {
  return address == GPIO(1) + GPIO_IDR ? emu_i2c_idr() : 0;
}

static inline void emu_i2c_port_write(uint32_t address, uint32_t value) {
  if (address == GPIO(1) + GPIO_BSRR) emu_i2c_bsrr(value);
}

/* After emu_stm32_power_on. */
static inline void emu_i2c_power_on(void) {
  memset(&i2c, 0, sizeof i2c);
  i2c.address = 0x68;
  peripherals[0] = (emu_peripheral_t){I2C1, I2C1 + 0x20, emu_i2c_read, emu_i2c_write};
  peripherals[1] = (emu_peripheral_t){GPIO(1), GPIO(1) + 0x24, emu_i2c_port_read, emu_i2c_port_write};
}
#endif
