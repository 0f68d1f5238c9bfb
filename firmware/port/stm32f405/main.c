// SPDX-License-Identifier: MIT
/* STM32F405: the main loop, and the callbacks that are the same on the chip and in QEMU. */
#include "board.h"
#include "port/arm/cortexm.h"

#define BAUD 921600u
#define REBOOT_WAIT_US 200000u

static imucal_app_t app;
static imucal_board_t board;
static imucal_port_t port;

static size_t port_serial_read(void* ctx, uint8_t* data, size_t capacity) {
  (void)ctx;
  return stm32_usart_read(data, capacity);
}

static size_t port_serial_write(void* ctx, const uint8_t* data, size_t length) {
  (void)ctx;
  return stm32_usart_write(data, length);
}

static uint64_t port_time_us(void* ctx) {
  (void)ctx;
  return stm32_time_us();
}

static void port_watchdog(void* ctx) {
  (void)ctx;
  stm32_watchdog_feed();
}

static void port_reboot(void* ctx) {
  (void)ctx;
  const uint64_t end_us = stm32_time_us() + REBOOT_WAIT_US;
  while (!stm32_usart_is_sent() && stm32_time_us() < end_us) {
  }
  cortexm_reset();
}

/* Interrupts are masked between the last look and the sleep; a pending one ends it all the same. */
static void sleep_until_interrupt(void) {
  __asm volatile("cpsid i\n\tdsb\n\twfi\n\tcpsie i" ::: "memory");
}

int main(void) {
  stm32_record_init();
  const stm32_clocks_t clocks = stm32_clocks_init();
  stm32_watchdog_start();
  stm32_usart_init(clocks.apb2_hz, BAUD);
  SYST_RVR = clocks.core_hz / 1000u - 1u; /* a tick of 1 ms wakes the loop */
  SYST_CVR = 0;
  SYST_CSR = 7u;
  port.serial_read = port_serial_read;
  port.serial_write = port_serial_write;
  port.time_us = port_time_us;
  port.watchdog = port_watchdog;
  port.reboot = port_reboot;
  port.n_watchdog_resets = stm32_record()->n_watchdog_resets;
  port.is_watchdog_reset = stm32_was_watchdog();
  board_init(&port, &board, &clocks);
  if (imucal_app_init(&app, &port, &board) != IMUCAL_OK) cortexm_reset(); /* a board that cannot be: see board_*.c */
  for (;;) {
    if (imucal_app_step(&app) || app.tx_at != app.tx_end || app.is_reboot_due) continue;
    sleep_until_interrupt();
  }
}
