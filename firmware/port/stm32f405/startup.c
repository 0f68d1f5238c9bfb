// SPDX-License-Identifier: MIT
/* Vector table and reset.  Unlike the emulated ports this one takes interrupts, and a fault leaves a record. */
#include "port/arm/cortexm.h"
#include "stm32f405.h"

extern uint32_t link_data_load[], link_data_start[], link_data_end[], link_bss_start[], link_bss_end[];
extern uint32_t link_stack_top[];

__attribute__((noreturn)) void reset_handler(void);
void fault_handler(void);
void fault_from_stack(const uint32_t* frame, uint32_t exception);
void tick_handler(void);

static uint32_t address_of(const uint32_t* word) {
  return (uint32_t)(uintptr_t)word;
}

__attribute__((noreturn)) void cortexm_reset(void) {
  __asm volatile("dsb" ::: "memory");
  SCB_AIRCR = 0x05FA0004u;
  for (;;) __asm volatile("dsb");
}

/* The exception's frame: r0 r1 r2 r3 r12 lr pc xpsr (ARMv7-M ARM, B1.5.6). */
__attribute__((used)) void fault_from_stack(const uint32_t* frame, uint32_t exception) {
  const bool has_frame = address_of(frame) >= 0x20000000u && address_of(frame) <= 0x2001FFE0u;
  const stm32_fault_t fault = {.exception = exception & 0x1FFu,
                               .pc = has_frame ? frame[6] : 0,
                               .lr = has_frame ? frame[5] : 0,
                               .cfsr = REG32(0xE000ED28u),
                               .address = REG32(0xE000ED38u)};
  stm32_record_fault(&fault);
}

/* Nothing here may touch the stack before the frame is found. */
__attribute__((naked)) void fault_handler(void) {
  __asm volatile("tst lr, #4\n\t"
                 "ite eq\n\t"
                 "mrseq r0, msp\n\t"
                 "mrsne r0, psp\n\t"
                 "mrs r1, ipsr\n\t"
                 "b fault_from_stack");
}

/* Only wakes the main loop. */
void tick_handler(void) {}

__attribute__((noreturn)) void reset_handler(void) {
  SCB_CPACR |= 0xFu << 20; /* the FPU */
  __asm volatile("dsb\n\tisb" ::: "memory");
  const uint32_t* from = link_data_load;
  for (uint32_t at = address_of(link_data_start); at < address_of(link_data_end); at += 4) REG32(at) = *from++;
  for (uint32_t at = address_of(link_bss_start); at < address_of(link_bss_end); at += 4) REG32(at) = 0;
  (void)main();
  cortexm_reset();
}

typedef union {
  void (*handler)(void);
  uint32_t* stack_top;
} vector_entry_t;

#define F                                                                                                              \
  { .handler = fault_handler }
/* 16 of the core, 82 of the chip (RM0090 table 61).  An interrupt nobody asked for is a fault with its number. */
__attribute__((section(".vectors"), used))
const vector_entry_t vector_table[16 + 82] = {{.stack_top = link_stack_top},
                                              {.handler = reset_handler},
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              {.handler = tick_handler},
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F, /* 0 ... */
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              {.handler = usart1_handler}, /* 20 ... 37 */
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F, /* 38 ... */
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F,
                                              F}; /* ... 81 */
