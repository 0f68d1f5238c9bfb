// SPDX-License-Identifier: MIT
/* Purpose: the few registers of the Cortex-M system block that the ports touch, and the start-up hook.
 * Source: ARM v6-M and v7-M Architecture Reference Manuals, system control space. */
#ifndef IMUCAL_PORT_CORTEXM_H
#define IMUCAL_PORT_CORTEXM_H
#include <stdint.h>

#define REG32(address) (*(volatile uint32_t*)(address))

#define SCB_AIRCR REG32(0xE000ED0Cu)
#define SCB_CPACR REG32(0xE000ED88u)
#define NVIC_ISER0 REG32(0xE000E100u)
#define NVIC_ICPR0 REG32(0xE000E280u)
#define SYST_CSR REG32(0xE000E010u)
#define SYST_RVR REG32(0xE000E014u)
#define SYST_CVR REG32(0xE000E018u)

/* Called by the start-up code with data and bss set up, the FPU on and interrupts masked. */
int main(void);

/* Resets the whole chip (AIRCR.SYSRESETREQ); does not return. */
__attribute__((noreturn)) void cortexm_reset(void);

/* Sleeps until an interrupt of the mask is pending (or at once where one is), then clears it in the NVIC.
 * Interrupts stay masked all the time: no handler runs, the drivers are polled. */
void cortexm_wait(uint32_t irq_mask);

/* Bytes of the stack never written since reset (the start-up code paints it), and its whole size. */
uint32_t cortexm_stack_free_bytes(void);
uint32_t cortexm_stack_size_bytes(void);

/* Paints the unused stack again, to measure one call rather than the whole life. */
void cortexm_stack_paint(void);
#endif
