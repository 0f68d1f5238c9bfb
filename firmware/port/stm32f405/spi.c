// SPDX-License-Identifier: MIT
/* RM0090 chapter 28.3.5: full duplex, one byte in flight: each byte sent brings one back, so nothing can overrun unless
 * the clock or the peripheral misbehaves.  Long answers come by DMA (28.3.9, chapter 10): no gaps between bytes, whatever
 * interrupts the core takes meanwhile. */
#include "stm32f405.h"

#define BYTE_LIMIT_US 200u /* at the slowest rate a byte takes 24 us */
#define DMA_FROM_BYTES 16u /* setting up takes as long as some bytes */
#define RX DMA2_STREAM(0)
#define TX DMA2_STREAM(3)

/* Port and pin of each chip select. */
static const struct { uint32_t port, pin; } selects[] = {[STM32_SPI_PA4] = {0, 4}, [STM32_SPI_PB0] = {1, 0}};

static void select_chip(stm32_spi_chip_t chip, bool is_selected) {
  reg_write(GPIO(selects[chip].port) + GPIO_BSRR, 1u << (selects[chip].pin + (is_selected ? 16u : 0u)));
}

void stm32_spi_init_pb0(void) {
  reg_set(RCC_AHB1ENR, 1u << 1); /* port B */
  select_chip(STM32_SPI_PB0, false);
  reg_write(GPIO(1) + GPIO_MODER, (reg_read(GPIO(1) + GPIO_MODER) & ~3u) | 1u);
  reg_set(GPIO(1) + GPIO_OSPEEDR, 2u);
}

void stm32_spi_init(uint32_t apb2_hz, uint32_t hz) {
  reg_set(RCC_AHB1ENR, 1u << 0);  /* port A */
  reg_set(RCC_APB2ENR, 1u << 12); /* SPI1 */
  reg_set(RCC_AHB1ENR, 1u << 22); /* DMA2 */
  select_chip(STM32_SPI_PA4, false);
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

static void set_stream(uint32_t stream, uint32_t how, const void* memory, size_t n) {
  reg_write(stream + DMA_FCR, 0); /* direct: no FIFO */
  reg_write(stream + DMA_PAR, SPI1 + SPI_DR);
  reg_write(stream + DMA_M0AR, reg_address(memory));
  reg_write(stream + DMA_NDTR, (uint32_t)n);
  reg_write(stream + DMA_CR, DMA_CR_CHANNEL(3) | how);
  reg_write(stream + DMA_CR, DMA_CR_CHANNEL(3) | how | DMA_CR_EN);
}

/* A stream ends the byte it is at before its EN reads 0. */
static bool stop_stream(uint32_t stream) {
  const uint64_t end_us = stm32_time_us() + BYTE_LIMIT_US;
  reg_clear(stream + DMA_CR, DMA_CR_EN);
  while (reg_read(stream + DMA_CR) & DMA_CR_EN)
    if (stm32_time_us() > end_us) return false;
  return true;
}

static bool wait_for_dma(size_t n) {
  const uint64_t end_us = stm32_time_us() + BYTE_LIMIT_US + 25u * n;
  for (;;) {
    const uint32_t flags = reg_read(DMA2_LISR);
    if (flags & DMA2_LISR_ERRORS || reg_read(SPI1 + SPI_SR) & (SPI_SR_OVR | SPI_SR_MODF)) return false;
    if (flags & DMA2_LISR_TCIF0) return true;
    if (stm32_time_us() > end_us) return false;
  }
}

/* n <= 65535 bytes; zeros go out. */
static bool receive_by_dma(uint8_t* in, size_t n) {
  static const uint8_t zero = 0;
  reg_write(DMA2_LIFCR, DMA2_LISR_ALL); /* flags of the last time keep a stream from starting */
  reg_write(SPI1 + SPI_CR2, SPI_CR2_RXDMAEN);
  set_stream(RX, DMA_CR_MINC, in, n);
  set_stream(TX, DMA_CR_TO_PERIPHERAL, &zero, n);
  reg_write(SPI1 + SPI_CR2, SPI_CR2_RXDMAEN | SPI_CR2_TXDMAEN); /* last: from here on bytes run */
  const bool is_good = wait_for_dma(n);
  const bool is_tx_off = stop_stream(TX), is_rx_off = stop_stream(RX);
  reg_write(SPI1 + SPI_CR2, 0);
  return is_good && is_tx_off && is_rx_off;
}

static bool receive(uint8_t* in, size_t n) {
  bool is_good = true;
  if (n >= DMA_FROM_BYTES) return receive_by_dma(in, n);
  for (size_t i = 0; i < n && is_good; i++) is_good = exchange(0, in + i);
  return is_good;
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

imucal_status stm32_spi_transfer(stm32_spi_chip_t chip, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  uint8_t ignored;
  bool is_good = true;
  select_chip(chip, true);
  for (size_t i = 0; i < n_out && is_good; i++) is_good = exchange(out[i], &ignored);
  is_good = is_good && receive(in, n_in);
  is_good = is_good && wait_not_busy();
  select_chip(chip, false);
  if (!is_good) recover();
  return is_good ? IMUCAL_OK : IMUCAL_ERR_SENSOR;
}
