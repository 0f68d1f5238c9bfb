// SPDX-License-Identifier: MIT
/* Register-level model of the STM32F405's flash controller (RM0090 chapter 3), supply monitor (5), SPI1 (28) and TIM2
 * for the port's own driver sources, which are compiled here with their registers in this model.  Stricter than the
 * chip: what a data sheet forbids is counted.  Faults: a controller that stays busy, write protection, a programming
 * sequence error, a wrong key, a supply that sags; SPI: no byte comes back, busy for ever, overrun, mode fault. */
#ifndef IMUCAL_TESTS_EMU_STM32F405_H
#define IMUCAL_TESTS_EMU_STM32F405_H
#define STM32_REGISTER_MODEL
#include <string.h>

#include "port/stm32f405/stm32f405.h"

typedef struct emu_stm32 {
  uint64_t now_us; /* moves by one with every register read: some 100 cycles */
  /* flash */
  uint8_t slot[2][STM32_SLOT_BYTES];
  uint32_t cr, sr, optcr, acr;
  int n_keys, n_option_keys;
  bool is_key_wrong, is_option_open;
  uint64_t busy_until_us;
  uint32_t n_violations; /* locked, busy, not erased, wrong width, outside the slots */
  uint32_t n_erases, n_words;
  bool stays_busy, is_protected, is_sequence_wrong, is_supply_low, is_option_stuck;
  uint32_t fail_word; /* the n-th word programmed from now fails; 0: none */
  uint64_t erase_us;
  /* SPI1 */
  uint32_t cr1, spi_sr, gpio_bsrr_low;
  uint8_t rx, out[64], answer[64];
  uint32_t n_out, n_selects, n_spi_violations;
  bool is_selected, is_silent, is_spi_busy;
  uint32_t overrun_at, modf_at; /* byte number + 1 */
  /* The chip behind the bus: answer to the n-th byte since it was selected; null: answer[]. */
  uint8_t (*slave)(uint8_t out, uint32_t n);
  /* The one at PB0, and what happens when it is released. */
  uint8_t (*slave_pb0)(uint8_t out, uint32_t n);
  void (*release_pb0)(void);
  bool is_pb0_selected;
  /* DMA2 streams 0 and 3 (chapter 10) */
  uint32_t spi_cr2, dma_flags, dma_cr[2], dma_ndtr[2], dma_par[2], dma_m0ar[2];
  const void* memory[8]; /* what M0AR points to: 1 + index */
  uint32_t n_memory, n_dma_bytes, n_dma_violations;
  bool is_dma_stalled, stays_enabled;
  bool is_dr_read;       /* since the overrun */
  uint32_t dma_error_at; /* byte number + 1 */
} emu_stm32_t;

static emu_stm32_t stm32;

/* Further peripherals, modelled in a file of their own (stm32f405_i2c.h, stm32f405_dma.h) and included by the test. */
typedef struct emu_peripheral {
  uint32_t first, last; /* addresses */
  uint32_t (*read)(uint32_t address);
  void (*write)(uint32_t address, uint32_t value);
} emu_peripheral_t;
static emu_peripheral_t peripherals[4];

static inline const emu_peripheral_t* emu_peripheral_at(uint32_t address) {
  for (size_t i = 0; i < sizeof peripherals / sizeof peripherals[0]; i++)
    if (peripherals[i].read && address >= peripherals[i].first && address <= peripherals[i].last)
      return &peripherals[i];
  return NULL;
}

static inline void emu_stm32_power_on(void) {
  memset(&stm32, 0, sizeof stm32);
  memset(stm32.slot, 0xFF, sizeof stm32.slot);
  stm32.cr = FLASH_CR_LOCK;
  stm32.optcr = 0x0FFFAAEDu; /* reset value: locked, brown-out reset off */
  stm32.acr = 5u | 7u << 8;
  stm32.erase_us = 250000;
  stm32.spi_sr = SPI_SR_TXE;
  for (uint32_t i = 0; i < sizeof stm32.answer; i++) stm32.answer[i] = (uint8_t)(0xA0 + i);
}

static inline bool emu_stm32_is_busy(void) {
  return stm32.stays_busy || stm32.now_us < stm32.busy_until_us;
}

static inline uint32_t emu_stm32_flash_sr(void) {
  return stm32.sr | (emu_stm32_is_busy() ? FLASH_SR_BSY : 0);
}

static inline uint32_t emu_stm32_spi_read(uint32_t address) {
  if (address == SPI1 + SPI_CR1) return stm32.cr1;
  if (address == SPI1 + SPI_CR2) return stm32.spi_cr2;
  if (address == SPI1 + SPI_SR) {
    if (stm32.is_dr_read) stm32.spi_sr &= ~SPI_SR_OVR; /* DR, then SR: cleared */
    return stm32.spi_sr | (stm32.is_spi_busy ? SPI_SR_BSY : 0);
  }
  stm32.spi_sr &= ~SPI_SR_RXNE;
  stm32.is_dr_read = stm32.spi_sr & SPI_SR_OVR;
  return stm32.rx;
}

uint32_t stm32_model_address(const void* memory) {
  stm32.memory[stm32.n_memory++ % 8] = memory;
  return 1 + (stm32.n_memory - 1) % 8;
}

static inline uint8_t emu_stm32_slave_byte(uint8_t out) {
  const uint8_t in = stm32.is_pb0_selected ? stm32.slave_pb0 ? stm32.slave_pb0(out, stm32.n_out) : 0xFF
                     : stm32.slave         ? stm32.slave(out, stm32.n_out)
                                           : stm32.answer[stm32.n_out % sizeof stm32.answer];
  stm32.out[stm32.n_out % sizeof stm32.out] = out;
  stm32.n_out++;
  if (stm32.n_out == stm32.overrun_at) {
    stm32.spi_sr |= SPI_SR_OVR;
    stm32.is_dr_read = false;
  }
  if (stm32.n_out == stm32.modf_at) stm32.spi_sr |= SPI_SR_MODF;
  return in;
}

/* One byte there and one back, while both streams run and SPI1 asks for them. */
static inline void emu_stm32_dma_run(void) {
  const bool runs = (stm32.dma_cr[0] & DMA_CR_EN) && (stm32.dma_cr[1] & DMA_CR_EN) && stm32.spi_cr2 == 3;
  if (!runs || stm32.is_dma_stalled || (stm32.spi_sr & SPI_SR_OVR) || stm32.dma_ndtr[0] == 0) return;
  if (!stm32.is_selected || !(stm32.cr1 & SPI_CR1_SPE)) stm32.n_dma_violations++;
  uint8_t* to = (uint8_t*)(uintptr_t)stm32.memory[(stm32.dma_m0ar[0] - 1) % 8];
  const uint8_t* from = stm32.memory[(stm32.dma_m0ar[1] - 1) % 8];
  *to = emu_stm32_slave_byte(*from);
  stm32.memory[(stm32.dma_m0ar[0] - 1) % 8] = to + (stm32.dma_cr[0] & DMA_CR_MINC ? 1 : 0);
  if (stm32.dma_cr[1] & DMA_CR_MINC) stm32.n_dma_violations++; /* one zero, not what lies behind it */
  if (++stm32.n_dma_bytes == stm32.dma_error_at) stm32.dma_flags |= 1u << 3;
  stm32.dma_ndtr[1]--;
  if (--stm32.dma_ndtr[0]) return;
  stm32.dma_flags |= 1u << 5 | 1u << 27;
  for (int i = 0; i < 2; i++) stm32.dma_cr[i] &= stm32.stays_enabled ? ~0u : ~DMA_CR_EN;
}

static inline void emu_stm32_dma_write(uint32_t address, uint32_t value) {
  if (address == DMA2_LIFCR) stm32.dma_flags &= ~value;
  for (int i = 0; i < 2; i++) {
    const uint32_t stream = DMA2_STREAM(i ? 3 : 0);
    const bool is_on = stm32.dma_cr[i] & DMA_CR_EN;
    if (address >= stream && address < stream + 0x18 && is_on && address != stream + DMA_CR) stm32.n_dma_violations++;
    if (address == stream + DMA_NDTR) stm32.dma_ndtr[i] = value;
    if (address == stream + DMA_PAR) stm32.dma_par[i] = value;
    if (address == stream + DMA_M0AR) stm32.dma_m0ar[i] = value;
    if (address != stream + DMA_CR) continue;
    const bool is_wrong = stm32.dma_ndtr[i] == 0 || stm32.dma_par[i] != SPI1 + SPI_DR || value >> 25 != 3 ||
                          (stm32.dma_flags & (i ? 0x3Du << 22 : 0x3Du)) || !(value & DMA_CR_TO_PERIPHERAL) != !i;
    if ((value & DMA_CR_EN) && !is_on && is_wrong) stm32.n_dma_violations++;
    stm32.dma_cr[i] = stm32.stays_enabled && is_on ? stm32.dma_cr[i] : value;
  }
}

static inline uint32_t emu_stm32_dma_read(uint32_t address) {
  emu_stm32_dma_run();
  if (address == DMA2_LISR) return stm32.dma_flags;
  return stm32.dma_cr[address == DMA2_STREAM(3) + DMA_CR];
}

uint32_t stm32_model_read(uint32_t address) {
  stm32.now_us++;
  if (emu_peripheral_at(address)) return emu_peripheral_at(address)->read(address);
  switch (address) {
  case FLASH_SR:
    return emu_stm32_flash_sr();
  case FLASH_CR:
    return stm32.cr;
  case FLASH_ACR:
    return stm32.acr;
  case FLASH_OPTCR:
    return stm32.optcr;
  case PWR_CSR:
    return stm32.is_supply_low ? PWR_CSR_PVDO : 0;
  case TIM2_CNT:
    return (uint32_t)stm32.now_us;
  default:
    if (address >= DMA2_LISR && address < DMA2_STREAM(8)) return emu_stm32_dma_read(address);
    return address >= SPI1 && address < SPI1 + 0x20 ? emu_stm32_spi_read(address) : 0;
  }
}

/* The slots as the processor reads them. */
const void* stm32_model_memory(uint32_t address) {
  return stm32.slot[0] + (address - STM32_SLOT_ADDRESS(0));
}

/* The port's clock, here without a chip's timer. */
uint64_t stm32_time_us(void) {
  return ++stm32.now_us;
}

static inline void emu_stm32_key(uint32_t value) {
  static const uint32_t keys[2] = {0x45670123u, 0xCDEF89ABu};
  if (stm32.is_key_wrong || stm32.n_keys > 1 || value != keys[stm32.n_keys]) {
    stm32.is_key_wrong = true; /* until the next reset */
    return;
  }
  if (++stm32.n_keys == 2) {
    stm32.cr &= ~FLASH_CR_LOCK;
    stm32.n_keys = 0;
  }
}

static inline void emu_stm32_flash_cr(uint32_t value) {
  if (stm32.cr & FLASH_CR_LOCK) {
    if (value != FLASH_CR_LOCK) stm32.n_violations++;
    return;
  }
  if (emu_stm32_is_busy() && !(value & FLASH_CR_LOCK)) stm32.n_violations++;
  stm32.cr = value & ~FLASH_CR_STRT;
  if (!(value & FLASH_CR_STRT)) return;
  const uint32_t sector = value >> 3 & 0xFu;
  if (!(value & FLASH_CR_SER) || (value >> 8 & 3u) != 2 || sector < 1 || sector > 2) {
    stm32.n_violations++;
    return;
  }
  stm32.busy_until_us = stm32.now_us + stm32.erase_us;
  stm32.n_erases++;
  if (stm32.is_protected) {
    stm32.sr |= FLASH_SR_WRPERR;
    return;
  }
  memset(stm32.slot[sector - 1], 0xFF, STM32_SLOT_BYTES);
}

static inline void emu_stm32_program(uint32_t address, uint32_t value) {
  const uint32_t at = address - STM32_SLOT_ADDRESS(0);
  uint8_t* bytes = stm32.slot[0] + at;
  if ((stm32.cr & FLASH_CR_LOCK) || emu_stm32_is_busy() || address % 4) stm32.n_violations++;
  if (!(stm32.cr & FLASH_CR_PG) || stm32.is_sequence_wrong) {
    stm32.sr |= FLASH_SR_PGSERR;
    return;
  }
  if ((stm32.cr >> 8 & 3u) != 2) {
    stm32.sr |= FLASH_SR_PGPERR;
    return;
  }
  if (stm32.is_protected || (stm32.fail_word && --stm32.fail_word == 0)) {
    stm32.sr |= FLASH_SR_WRPERR;
    return;
  }
  if (stm32.sr & FLASH_SR_ERRORS) stm32.n_violations++; /* an error was not cleared */
  stm32.n_words++;
  stm32.busy_until_us = stm32.now_us + 16;
  for (int i = 0; i < 4; i++) {
    if (bytes[i] != 0xFF) stm32.n_violations++;
    bytes[i] &= (uint8_t)(value >> 8 * i);
  }
}

static inline void emu_stm32_optcr(uint32_t value) {
  if (!stm32.is_option_open) {
    stm32.n_violations++;
    return;
  }
  if (!(value & FLASH_OPTCR_OPTSTRT) && !(value & FLASH_OPTCR_OPTLOCK) && !stm32.is_option_stuck) stm32.optcr = value;
  if (value & FLASH_OPTCR_OPTSTRT) stm32.busy_until_us = stm32.now_us + 20000;
  if (value & FLASH_OPTCR_OPTLOCK) stm32.is_option_open = false;
}

static inline void emu_stm32_spi_write(uint32_t address, uint32_t value) {
  if (address == SPI1 + SPI_CR1) {
    if (!(value & SPI_CR1_SPE)) stm32.spi_sr = SPI_SR_TXE | (stm32.spi_sr & SPI_SR_OVR);
    stm32.spi_sr &= ~SPI_SR_MODF;
    stm32.cr1 = value;
    return;
  }
  if (address == SPI1 + SPI_CR2) {
    /* The receiver's stream must be ready before bytes run (28.3.9). */
    if ((value & SPI_CR2_TXDMAEN) && !(stm32.dma_cr[0] & DMA_CR_EN)) stm32.n_dma_violations++;
    stm32.spi_cr2 = value;
    return;
  }
  if (!stm32.is_selected || !(stm32.cr1 & SPI_CR1_SPE) || (stm32.spi_sr & SPI_SR_RXNE)) stm32.n_spi_violations++;
  stm32.rx = emu_stm32_slave_byte((uint8_t)value);
  if (!stm32.is_silent) stm32.spi_sr |= SPI_SR_RXNE;
}

/* One chip at a time may listen. */
static inline void emu_stm32_select(bool goes_low, bool goes_high, bool is_pb0) {
  if (goes_low && stm32.is_selected && stm32.is_pb0_selected != is_pb0) stm32.n_spi_violations++;
  if (goes_low && !stm32.is_selected) {
    stm32.is_selected = true;
    stm32.is_pb0_selected = is_pb0;
    stm32.n_selects++;
    stm32.n_out = 0;
  }
  if (!goes_high || !stm32.is_selected || stm32.is_pb0_selected != is_pb0) return;
  stm32.is_selected = false;
  if (is_pb0 && stm32.release_pb0) stm32.release_pb0();
  stm32.is_pb0_selected = false;
}

void stm32_model_write(uint32_t address, uint32_t value) {
  if (emu_peripheral_at(address)) emu_peripheral_at(address)->write(address, value);
  if (address == FLASH_KEYR) emu_stm32_key(value);
  if (address == FLASH_OPTKEYR) {
    static const uint32_t keys[2] = {0x08192A3Bu, 0x4C5D6E7Fu};
    stm32.n_option_keys = value == keys[stm32.n_option_keys] ? stm32.n_option_keys + 1 : 0;
    if (stm32.n_option_keys == 2) {
      stm32.is_option_open = true;
      stm32.n_option_keys = 0;
      stm32.optcr &= ~FLASH_OPTCR_OPTLOCK;
    }
  }
  if (address == FLASH_CR) emu_stm32_flash_cr(value);
  if (address == FLASH_SR) stm32.sr &= ~value;
  if (address == FLASH_ACR) stm32.acr = value;
  if (address == FLASH_OPTCR) emu_stm32_optcr(value);
  if (address >= STM32_SLOT_ADDRESS(0) && address < STM32_SLOT_ADDRESS(2)) emu_stm32_program(address, value);
  if (address == GPIO(0) + GPIO_BSRR) emu_stm32_select(value & 1u << 20, value & 1u << 4, false);
  if (address == GPIO(1) + GPIO_BSRR) emu_stm32_select(value & 1u << 16, value & 1u << 0, true);
  if (address >= SPI1 && address < SPI1 + 0x20) emu_stm32_spi_write(address, value);
  if (address >= DMA2_LISR && address < DMA2_STREAM(8)) emu_stm32_dma_write(address, value);
}
#endif
