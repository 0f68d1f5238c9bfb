// SPDX-License-Identifier: MIT
/* Purpose: drivers of the nRF51822 that the port needs: UART0, the flash controller (NVMC), TIMER0, the
 * serial number of the chip. Polled, interrupts masked. Source: nRF51 Series Reference Manual 3.0, chapters 6
 * (NVMC), 7 (FICR), 18 (TIMER), 28 (UART). */
#ifndef IMUCAL_PORT_NRF51_H
#define IMUCAL_PORT_NRF51_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define NRF51_PAGE_BYTES 1024u
#define NRF51_UART_IRQ 2u

/* 115200 baud, 8N1, no flow control; TXD and RXD pins of the micro:bit (24, 25). */
void nrf51_uart_init(void);
size_t nrf51_uart_read(uint8_t* data, size_t capacity);
size_t nrf51_uart_write(const uint8_t* data, size_t length);

/* Erases the page that begins at `address`; the core stands still for 21 ms on the chip. */
void nrf51_flash_erase_page(uint32_t address);

/* Programs `length` bytes (multiple of 4) at a word address. */
void nrf51_flash_program(uint32_t address, const uint8_t* data, size_t length);

#define NRF51_TIMER0_IRQ 8u /* pending whenever the timer wraps */

/* TIMER0: 32 bits at 16 MHz; differences wrap after 268 s. */
void nrf51_timer_init(void);
void nrf51_timer_clear_wrap(void); /* after its interrupt */
uint32_t nrf51_timer_ticks(void);

/* From the random number generator. */
uint32_t nrf51_random(void);
#endif
