// SPDX-License-Identifier: MIT
/* Vector table and reset for the Cortex-M ports: linker symbols come from port/<name>/link.ld. */
#include "cortexm.h"

#define STACK_PAINT 0xA5C35A3Cu

extern uint32_t link_data_load[], link_data_start[], link_data_end[], link_bss_start[], link_bss_end[];
extern uint32_t link_stack_limit[], link_stack_top[];

void port_fault(void);
__attribute__((noreturn)) void reset_handler(void);
void fault_handler(void);

/* Word compares are made on addresses: the two symbols of a region are different objects to the compiler. */
static uint32_t address_of(const uint32_t* word) {
  return (uint32_t)(uintptr_t)word;
}

static void paint_to(uint32_t end) {
  for (uint32_t at = address_of(link_stack_limit); at < end; at += 4) REG32(at) = STACK_PAINT;
}

__attribute__((noreturn)) void cortexm_reset(void) {
  __asm volatile("dsb" ::: "memory");
  SCB_AIRCR = 0x05FA0004u;
  for (;;) __asm volatile("dsb");
}

void cortexm_wait(uint32_t irq_mask) {
  __asm volatile("dsb\n\twfi" ::: "memory");
  NVIC_ICPR0 = irq_mask;
}

uint32_t cortexm_stack_free_bytes(void) {
  uint32_t at = address_of(link_stack_limit);
  while (at < address_of(link_stack_top) && REG32(at) == STACK_PAINT) at += 4;
  return at - address_of(link_stack_limit);
}

uint32_t cortexm_stack_size_bytes(void) {
  return address_of(link_stack_top) - address_of(link_stack_limit);
}

void cortexm_stack_paint(void) {
  uint32_t stack_pointer;
  __asm volatile("mov %0, sp" : "=r"(stack_pointer));
  paint_to(stack_pointer - 32);
}

/* Where a fault must not go unnoticed: the port reports it and never returns. */
void fault_handler(void) {
  port_fault();
  for (;;) __asm volatile("wfi");
}

__attribute__((noreturn)) void reset_handler(void) {
  __asm volatile("cpsid i" ::: "memory");
#if defined(__ARM_FP)
  SCB_CPACR |= 0xFu << 20; /* full access to CP10 and CP11 */
  __asm volatile("dsb\n\tisb" ::: "memory");
#endif
  const uint32_t* from = link_data_load;
  for (uint32_t at = address_of(link_data_start); at < address_of(link_data_end); at += 4) REG32(at) = *from++;
  for (uint32_t at = address_of(link_bss_start); at < address_of(link_bss_end); at += 4) REG32(at) = 0;
  cortexm_stack_paint();
  (void)main();
  cortexm_reset();
}

typedef void (*vector_t)(void);
typedef union {
  vector_t handler;
  uint32_t* stack_top;
} vector_entry_t;

/* Interrupts are never taken (PRIMASK stays set), so the table ends after the system exceptions. */
__attribute__((section(".vectors"), used)) const vector_entry_t vector_table[16] = {
    {.stack_top = link_stack_top}, {.handler = reset_handler}, {.handler = fault_handler}, {.handler = fault_handler},
    {.handler = fault_handler},    {.handler = fault_handler}, {.handler = fault_handler}, {.handler = fault_handler},
    {.handler = fault_handler},    {.handler = fault_handler}, {.handler = fault_handler}, {.handler = fault_handler},
    {.handler = fault_handler},    {.handler = fault_handler}, {.handler = fault_handler}, {.handler = fault_handler},
};
