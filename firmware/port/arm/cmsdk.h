// SPDX-License-Identifier: MIT
/* Purpose: UART and timer of ARM's Cortex-M System Design Kit, as on the MPS2 boards. Polled.
 * Source: CMSDK technical reference manual (DDI 0479), APB UART and APB timer. */
#ifndef IMUCAL_PORT_CMSDK_H
#define IMUCAL_PORT_CMSDK_H
#include <stddef.h>
#include <stdint.h>

#define CMSDK_CLOCK_HZ 25000000u
#define CMSDK_UART0_RX_IRQ 0u /* interrupt number; pending on every byte received */

void cmsdk_uart_init(void);
size_t cmsdk_uart_read(uint8_t* data, size_t capacity);      /* bytes taken, 0 where none waits */
size_t cmsdk_uart_write(const uint8_t* data, size_t length); /* bytes accepted, 0 where the register is full */

#define CMSDK_TIMER0_IRQ 8u /* pending whenever the timer wraps */

/* Timer 0 counts down from 2^32 - 1 at the clock, never stopped; differences wrap after 171 s. */
void cmsdk_timer_init(void);
void cmsdk_timer_clear_wrap(void); /* after its interrupt */
uint32_t cmsdk_timer_ticks(void);  /* counts up */
#endif
