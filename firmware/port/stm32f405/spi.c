// SPDX-License-Identifier: MIT
/* RM0090 chapter 28.3.5: full duplex, one byte in flight: each byte sent brings one back, so nothing can overrun unless
 * the clock or the peripheral misbehaves. */
#include "stm32f405.h"

#define CS_LOW (1u << (16 + 4))
#define CS_HIGH (1u << 4)
#define BYTE_LIMIT_US 200u /* at the slowest rate a byte takes 24 us */

void stm32_spi_init(uint32_t apb2_hz, uint32_t hz) {
  reg_set(RCC_AHB1ENR, 1u << 0);  /* port A */
  reg_set(RCC_APB2ENR, 1u << 12); /* SPI1 */
  reg_write(GPIO(0) + GPIO_BSRR, CS_HIGH);
  /* PA4 output, PA5 to PA7 alternate function 5; fast edges. */
  reg_write(GPIO(0) + GPIO_MODER, (reg_read(GPIO(0) + GPIO_MODER) & ~0xFF00u) | 0xA900u);
  reg_set(GPIO(0) + GPIO_OSPEEDR, 0xAA00u);
  reg_write(GPIO(0) + GPIO_AFR(0), (reg_read(GPIO(0) + GPIO_AFR(0)) & 0x000FFFFFu) | 0x55500000u);
  uint32_t divider = 0; /* 2^(divider + 1) */
  while (divider < 7 && apb2_hz >> (divider + 1) > hz) divider++;
  reg_write(SPI1 + SPI_CR1, SPI_CR1_MASTER_MODE3 | divider << 3);
  reg_set(SPI1 + SPI_CR1, SPI_CR1_SPE);
}

/* Waits for the flag; false: too long, overrun or mode fault. */
static bool wait_for(uint32_t flag) {
  const uint64_t end_us = stm32_time_us() + BYTE_LIMIT_US;
  for (;;) {
    const uint32_t sr = reg_read(SPI1 + SPI_SR);
    if (sr & (SPI_SR_OVR | SPI_SR_MODF)) return false;
    if (sr & flag) return true;
    if (stm32_time_us() > end_us) return false;
  }
}

static bool exchange(uint8_t out, uint8_t* in) {
  if (!wait_for(SPI_SR_TXE)) return false;
  reg_write(SPI1 + SPI_DR, out);
  if (!wait_for(SPI_SR_RXNE)) return false;
  *in = (uint8_t)reg_read(SPI1 + SPI_DR);
  return true;
}

static bool wait_not_busy(void) {
  const uint64_t end_us = stm32_time_us() + BYTE_LIMIT_US;
  while (reg_read(SPI1 + SPI_SR) & SPI_SR_BSY)
    if (stm32_time_us() > end_us) return false;
  return true;
}

/* Off and on: the byte in flight is given up, overrun (DR, SR read) and mode fault (CR1 written) are cleared. */
static void recover(void) {
  const uint32_t cr1 = reg_read(SPI1 + SPI_CR1) | SPI_CR1_MASTER_MODE3;
  reg_write(SPI1 + SPI_CR1, cr1 & ~SPI_CR1_SPE);
  (void)reg_read(SPI1 + SPI_DR);
  (void)reg_read(SPI1 + SPI_SR);
  reg_write(SPI1 + SPI_CR1, cr1 | SPI_CR1_SPE);
}

imucal_status stm32_spi_transfer(const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  uint8_t ignored;
  bool is_good = true;
  reg_write(GPIO(0) + GPIO_BSRR, CS_LOW);
  for (size_t i = 0; i < n_out && is_good; i++) is_good = exchange(out[i], &ignored);
  for (size_t i = 0; i < n_in && is_good; i++) is_good = exchange(0, in + i);
  is_good = is_good && wait_not_busy();
  reg_write(GPIO(0) + GPIO_BSRR, CS_HIGH);
  if (!is_good) recover();
  return is_good ? IMUCAL_OK : IMUCAL_ERR_SENSOR;
}
