// SPDX-License-Identifier: MIT
#include "nrf51.h"
#include "port/arm/cortexm.h"

/* 28: UART */
#define UART_STARTRX REG32(0x40002000u)
#define UART_STARTTX REG32(0x40002008u)
#define UART_RXDRDY REG32(0x40002108u)
#define UART_TXDRDY REG32(0x4000211Cu)
#define UART_INTENSET REG32(0x40002304u)
#define UART_ENABLE REG32(0x40002500u)
#define UART_PSELTXD REG32(0x4000250Cu)
#define UART_PSELRXD REG32(0x40002514u)
#define UART_RXD REG32(0x40002518u)
#define UART_TXD REG32(0x4000251Cu)
#define UART_BAUDRATE REG32(0x40002524u)
#define BAUD_115200 0x01D7E000u
enum { UART_ENABLED = 4, INT_RXDRDY = 1 << 2, PIN_TXD = 24, PIN_RXD = 25 };

/* 6: NVMC */
#define NVMC_READY REG32(0x4001E400u)
#define NVMC_CONFIG REG32(0x4001E504u)
#define NVMC_ERASEPAGE REG32(0x4001E508u)
enum { NVMC_READ_ONLY = 0, NVMC_WRITE = 1, NVMC_ERASE = 2 };

/* 18: TIMER0 */
#define TIMER_START REG32(0x40008000u)
#define TIMER_CLEAR REG32(0x4000800Cu)
#define TIMER_CAPTURE0 REG32(0x40008040u)
#define TIMER_COMPARE1 REG32(0x40008144u)
#define TIMER_INTENSET REG32(0x40008304u)
#define TIMER_CC1 REG32(0x40008544u)
#define TIMER_MODE REG32(0x40008504u)
#define TIMER_BITMODE REG32(0x40008508u)
#define TIMER_PRESCALER REG32(0x40008510u)
#define TIMER_CC0 REG32(0x40008540u)
enum { BITMODE_32 = 3, INT_COMPARE1 = 1 << 17 };

/* 22: RNG */
#define RNG_START REG32(0x4000D000u)
#define RNG_STOP REG32(0x4000D004u)
#define RNG_VALRDY REG32(0x4000D100u)
#define RNG_VALUE REG32(0x4000D508u)

#define CLOCK_HFCLKSTART REG32(0x40000000u)
#define CLOCK_HFCLKSTARTED REG32(0x40000100u)

static bool is_transmitting;

void nrf51_uart_init(void) {
  UART_PSELTXD = PIN_TXD;
  UART_PSELRXD = PIN_RXD;
  UART_BAUDRATE = BAUD_115200;
  UART_ENABLE = UART_ENABLED;
  UART_INTENSET = INT_RXDRDY;
  UART_RXDRDY = 0;
  UART_STARTTX = 1;
  UART_STARTRX = 1;
  is_transmitting = false;
  NVIC_ISER0 = 1u << NRF51_UART_IRQ;
}

size_t nrf51_uart_read(uint8_t* data, size_t capacity) {
  size_t n = 0;
  while (n < capacity && UART_RXDRDY) {
    UART_RXDRDY = 0; /* before RXD: reading RXD may raise it again for the next byte */
    data[n++] = (uint8_t)UART_RXD;
  }
  return n;
}

size_t nrf51_uart_write(const uint8_t* data, size_t length) {
  size_t n = 0;
  while (n < length) {
    if (is_transmitting && !UART_TXDRDY) break;
    UART_TXDRDY = 0;
    UART_TXD = data[n++];
    is_transmitting = true;
  }
  return n;
}

static void wait_flash(void) {
  while (!NVMC_READY) {
  }
}

void nrf51_flash_erase_page(uint32_t address) {
  NVMC_CONFIG = NVMC_ERASE;
  wait_flash();
  NVMC_ERASEPAGE = address;
  wait_flash();
  NVMC_CONFIG = NVMC_READ_ONLY;
  wait_flash();
}

void nrf51_flash_program(uint32_t address, const uint8_t* data, size_t length) {
  NVMC_CONFIG = NVMC_WRITE;
  wait_flash();
  for (size_t i = 0; i + 4 <= length; i += 4) {
    REG32(address + i) =
        (uint32_t)data[i] | (uint32_t)data[i + 1] << 8 | (uint32_t)data[i + 2] << 16 | (uint32_t)data[i + 3] << 24;
    wait_flash();
  }
  NVMC_CONFIG = NVMC_READ_ONLY;
  wait_flash();
}

void nrf51_timer_init(void) {
  CLOCK_HFCLKSTARTED = 0;
  CLOCK_HFCLKSTART = 1; /* the crystal: the time stamps need better than the RC oscillator's percent */
  TIMER_MODE = 0;
  TIMER_BITMODE = BITMODE_32;
  TIMER_PRESCALER = 0;
  TIMER_CC1 = 0;
  TIMER_INTENSET = INT_COMPARE1;
  NVIC_ISER0 = 1u << NRF51_TIMER0_IRQ;
  TIMER_CLEAR = 1;
  TIMER_START = 1;
}

void nrf51_timer_clear_wrap(void) {
  TIMER_COMPARE1 = 0;
}

uint32_t nrf51_timer_ticks(void) {
  TIMER_CAPTURE0 = 1;
  return TIMER_CC0;
}

uint32_t nrf51_random(void) {
  uint32_t value = 0;
  RNG_START = 1;
  for (uint32_t i = 0; i < 4; i++) {
    RNG_VALRDY = 0;
    while (!RNG_VALRDY) {
    }
    value = value << 8 | (RNG_VALUE & 0xFFu);
  }
  RNG_STOP = 1;
  return value;
}
