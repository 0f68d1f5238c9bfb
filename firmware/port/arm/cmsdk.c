// SPDX-License-Identifier: MIT
#include "cmsdk.h"
#include "cortexm.h"

#define UART0 0x40004000u
#define UART_DATA REG32(UART0 + 0x00u)
#define UART_STATE REG32(UART0 + 0x04u)
#define UART_CTRL REG32(UART0 + 0x08u)
#define UART_INTSTATUS REG32(UART0 + 0x0Cu)
#define UART_BAUDDIV REG32(UART0 + 0x10u)
enum { STATE_TX_FULL = 1, STATE_RX_FULL = 2, CTRL_TX = 1, CTRL_RX = 2, CTRL_RX_IRQ = 8, INT_RX = 2 };

#define TIMER0 0x40000000u
#define TIMER_CTRL REG32(TIMER0 + 0x00u)
#define TIMER_VALUE REG32(TIMER0 + 0x04u)
#define TIMER_RELOAD REG32(TIMER0 + 0x08u)
#define TIMER_INTCLEAR REG32(TIMER0 + 0x0Cu)
enum { TIMER_ENABLE = 1, TIMER_IRQ = 8 };

void cmsdk_uart_init(void) {
  UART_BAUDDIV = CMSDK_CLOCK_HZ / 921600u;
  UART_CTRL = CTRL_TX | CTRL_RX | CTRL_RX_IRQ;
  NVIC_ISER0 = 1u << CMSDK_UART0_RX_IRQ;
}

size_t cmsdk_uart_read(uint8_t* data, size_t capacity) {
  size_t n = 0;
  while (n < capacity && (UART_STATE & STATE_RX_FULL)) {
    data[n++] = (uint8_t)UART_DATA;
    UART_INTSTATUS = INT_RX;
  }
  return n;
}

size_t cmsdk_uart_write(const uint8_t* data, size_t length) {
  size_t n = 0;
  while (n < length && !(UART_STATE & STATE_TX_FULL)) UART_DATA = data[n++];
  return n;
}

void cmsdk_timer_init(void) {
  TIMER_RELOAD = 0xFFFFFFFFu;
  TIMER_VALUE = 0xFFFFFFFFu;
  TIMER_CTRL = TIMER_ENABLE | TIMER_IRQ;
  NVIC_ISER0 = 1u << CMSDK_TIMER0_IRQ;
}

void cmsdk_timer_clear_wrap(void) {
  TIMER_INTCLEAR = 1;
}

uint32_t cmsdk_timer_ticks(void) {
  return 0xFFFFFFFFu - TIMER_VALUE;
}
