// SPDX-License-Identifier: MIT
/* RM0090 chapter 30: two rings; the handler fills one and empties the other.  Indices run freely, sizes are powers of
 * two: a ring is full at a difference of its size. */
#include "port/arm/cortexm.h"
#include "stm32f405.h"

static struct {
  volatile uint32_t put, take;
  uint8_t bytes[STM32_RX_RING];
} rx;
static struct {
  volatile uint32_t put, take;
  uint8_t bytes[STM32_TX_RING];
} tx;
static volatile uint32_t n_lost;

void stm32_usart_init(uint32_t apb2_hz, uint32_t baud) {
  reg_set(RCC_AHB1ENR, 1u << 0); /* port A */
  reg_set(RCC_APB2ENR, 1u << 4); /* USART1 */
  /* PA9, PA10: alternate function 7; a pull-up holds the line idle where nothing is plugged in. */
  reg_write(GPIO(0) + GPIO_MODER, (reg_read(GPIO(0) + GPIO_MODER) & ~(0xFu << 18)) | 0xAu << 18);
  reg_write(GPIO(0) + GPIO_PUPDR, (reg_read(GPIO(0) + GPIO_PUPDR) & ~(0x3u << 20)) | 0x1u << 20);
  reg_write(GPIO(0) + GPIO_AFR(1), (reg_read(GPIO(0) + GPIO_AFR(1)) & ~0xFF0u) | 0x770u);
  reg_write(USART_BRR, (apb2_hz + baud / 2) / baud); /* 16 samples per bit: mantissa and fraction are one number */
  reg_write(USART_CR1, USART_CR1_UE | USART_CR1_TE | USART_CR1_RE | USART_CR1_RXNEIE);
  REG32(0xE000E100u + 4 * (USART1_IRQ / 32)) = 1u << (USART1_IRQ % 32); /* NVIC_ISER */
}

/* Called by the handler, and by the writer with the handler masked. */
static void pump(void) {
  while (tx.take != tx.put && (reg_read(USART_SR) & USART_SR_TXE))
    reg_write(USART_DR, tx.bytes[tx.take++ % STM32_TX_RING]);
  if (tx.take == tx.put)
    reg_clear(USART_CR1, USART_CR1_TXEIE);
  else
    reg_set(USART_CR1, USART_CR1_TXEIE);
}

void usart1_handler(void) {
  const uint32_t sr = reg_read(USART_SR);
  if (sr & (USART_SR_RXNE | USART_SR_ORE)) {
    const uint8_t byte = (uint8_t)reg_read(USART_DR); /* clears both */
    if (sr & USART_SR_ORE) n_lost++;
    if (!(sr & USART_SR_RXNE)) {
    } else if (rx.put - rx.take == STM32_RX_RING) {
      n_lost++;
    } else {
      rx.bytes[rx.put % STM32_RX_RING] = byte;
      rx.put++;
    }
  }
  pump();
}

size_t stm32_usart_read(uint8_t* data, size_t capacity) {
  size_t n = 0;
  while (n < capacity && rx.take != rx.put) data[n++] = rx.bytes[rx.take++ % STM32_RX_RING];
  return n;
}

size_t stm32_usart_write(const uint8_t* data, size_t length) {
  size_t n = 0;
  while (n < length && tx.put - tx.take != STM32_TX_RING) {
    tx.bytes[tx.put % STM32_TX_RING] = data[n++];
    tx.put++;
  }
  __asm volatile("cpsid i" ::: "memory");
  pump();
  __asm volatile("cpsie i" ::: "memory");
  return n;
}

bool stm32_usart_is_sent(void) {
  return tx.put == tx.take && (reg_read(USART_SR) & USART_SR_TC);
}

uint32_t stm32_usart_lost(void) {
  return n_lost;
}
