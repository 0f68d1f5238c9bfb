// SPDX-License-Identifier: MIT
/* Purpose: the devices of QEMU's RISC-V `virt` machine that the port needs: a 16550 UART, the machine timer, reset.
 * Source: hw/riscv/virt.c of QEMU (memory map); TL16C550 data sheet (registers); RISC-V privileged architecture 1.10
 * (mtime). Polled, interrupts masked. */
#ifndef IMUCAL_PORT_VIRT_H
#define IMUCAL_PORT_VIRT_H
#include <stddef.h>
#include <stdint.h>

#define REG8(address) (*(volatile uint8_t*)(address))
#define REG32(address) (*(volatile uint32_t*)(address))
#define UART_DATA REG8(0x10000000u)
#define UART_FIFO REG8(0x10000002u)
#define UART_STATUS REG8(0x10000005u) /* bit 0: a byte has come; bit 5: room for one */
#define MTIME_LOW REG32(0x0200BFF8u)  /* 10 MHz */
#define MTIME_HIGH REG32(0x0200BFFCu)
#define TEST_DEVICE REG32(0x00100000u)

__attribute__((noreturn)) static inline void virt_reset(void) {
  TEST_DEVICE = 0x7777u;
  for (;;) {
  }
}
#endif
