// SPDX-License-Identifier: MIT
/* Reset of a RISC-V hart in machine mode (privileged architecture 1.10): stack, traps, data, bss, main. */
#include "virt.h"

extern uint32_t link_data_load[], link_data_start[], link_data_end[], link_bss_start[], link_bss_end[];

int main(void);
void port_fault(void);
__attribute__((noreturn)) void start(void);

/* The first instructions of the image. */
__attribute__((naked, section(".entry"), used)) void reset_entry(void) {
  __asm volatile("la sp, link_stack_top\n\t"
                 "la t0, trap_entry\n\t"
                 "csrw mtvec, t0\n\t"
                 "j start");
}

/* Interrupts stay masked: whatever comes here is a fault. */
__attribute__((naked, aligned(4), used)) void trap_entry(void) {
  __asm volatile("j port_fault");
}

__attribute__((noreturn, used)) void start(void) {
  volatile uint32_t* to = link_data_start;
  const uint32_t* from = link_data_load;
  while ((uintptr_t)to < (uintptr_t)link_data_end) *to++ = *from++;
  for (to = link_bss_start; (uintptr_t)to < (uintptr_t)link_bss_end;) *to++ = 0;
  (void)main();
  virt_reset();
}
