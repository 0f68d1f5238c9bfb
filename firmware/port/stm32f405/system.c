// SPDX-License-Identifier: MIT
/* Clocks (RM0090 chapter 7), time (18), watchdog (21), random numbers (24), and what outlives a reset. */
#include "port/arm/cortexm.h"
#include "stm32f405.h"

#define HSI_HZ 16000000u
#define PLL_N 336u
#ifndef WAIT_TURNS         /* QEMU has no clock tree: there every turn is lost time */
#define WAIT_TURNS 100000u /* some 30 ms at 16 MHz: a crystal starts in 2 to 10 ms */
#endif
#define RECORD_MAGIC 0x494D4352u

/* ---- clocks ---- */

/* Bounded: a board without its crystal must still say so over the line. */
static bool wait_set(uint32_t address, uint32_t bit) {
  for (uint32_t i = 0; i < WAIT_TURNS; i++)
    if (reg_read(address) & bit) return true;
  return false;
}

static bool start_pll(void) {
  reg_set(RCC_CR, RCC_CR_HSEON);
  if (!wait_set(RCC_CR, RCC_CR_HSERDY)) return false;
  /* 1 MHz * 336 / 2 = 168 MHz, / 7 = 48 MHz for the random numbers; source: crystal. */
  reg_write(RCC_PLLCFGR, STM32_HSE_HZ / 1000000u | PLL_N << 6 | 0u << 16 | 1u << 22 | 7u << 24);
  reg_set(RCC_CR, RCC_CR_PLLON);
  if (!wait_set(RCC_CR, RCC_CR_PLLRDY)) return false;
  reg_write(FLASH_ACR, 5u | 7u << 8);            /* 5 wait states, prefetch, both caches: before the clock rises */
  reg_write(RCC_CFGR, 5u << 10 | 4u << 13);      /* APB1 / 4, APB2 / 2 */
  reg_write(RCC_CFGR, 5u << 10 | 4u << 13 | 2u); /* the PLL */
  for (uint32_t i = 0; i < WAIT_TURNS; i++)
    if ((reg_read(RCC_CFGR) >> 2 & 3u) == 2u) return true;
  return false;
}

stm32_clocks_t stm32_clocks_init(void) {
  stm32_clocks_t clocks = {
      .core_hz = HSI_HZ, .apb1_hz = HSI_HZ, .apb2_hz = HSI_HZ, .tim_hz = HSI_HZ, .is_crystal = start_pll()};
  if (clocks.is_crystal) {
    clocks.core_hz = PLL_N * 500000u;
    clocks.apb1_hz = clocks.core_hz / 4;
    clocks.apb2_hz = clocks.core_hz / 2;
    clocks.tim_hz = clocks.core_hz / 2; /* twice APB1 */
  }
  if (STM32_TIM_HZ) clocks.tim_hz = STM32_TIM_HZ;
  reg_set(RCC_APB1ENR, 1u << 0); /* TIM2 */
  reg_write(TIM2_PSC, clocks.tim_hz / 1000000u - 1u);
  reg_write(TIM2_ARR, 0xFFFFFFFFu);
  reg_write(TIM2_EGR, 1u); /* takes the prescaler over */
  reg_write(TIM2_CR1, 1u);
  return clocks;
}

uint64_t stm32_time_us(void) {
  static uint32_t last;
  static uint64_t total_us;
  const uint32_t now = reg_read(TIM2_CNT);
  total_us += now - last;
  last = now;
  return total_us;
}

void stm32_delay_us(uint32_t us) {
  const uint64_t end_us = stm32_time_us() + us + 1u;
  while (stm32_time_us() < end_us) stm32_watchdog_feed();
}

/* ---- watchdog ---- */

void stm32_watchdog_start(void) {
  reg_write(IWDG_KR, 0xCCCCu);
  reg_write(IWDG_KR, 0x5555u);
  reg_write(IWDG_PR, 4u);     /* 32 kHz / 64 */
  reg_write(IWDG_RLR, 1000u); /* 2 s */
  reg_write(IWDG_KR, 0xAAAAu);
}

void stm32_watchdog_feed(void) {
  reg_write(IWDG_KR, 0xAAAAu);
}

/* ---- what outlives a reset ---- */

__attribute__((section(".noinit"))) static stm32_record_t record;
static bool was_watchdog, was_fault;

static uint32_t check_of(const stm32_record_t* r) {
  uint32_t sum = RECORD_MAGIC;
  const uint32_t words[] = {r->n_starts, r->n_watchdog_resets, r->n_faults,   r->fault.exception,
                            r->fault.pc, r->fault.lr,          r->fault.cfsr, r->fault.address};
  for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) sum = (sum ^ words[i]) * 16777619u;
  return sum;
}

static void seal(void) {
  record.magic = RECORD_MAGIC;
  record.check = check_of(&record);
}

void stm32_record_init(void) {
  if (record.magic != RECORD_MAGIC || record.check != check_of(&record)) record = (stm32_record_t){0};
  was_watchdog = reg_read(RCC_CSR) & RCC_CSR_WATCHDOGS;
  reg_set(RCC_CSR, RCC_CSR_RMVF);
  was_fault = record.fault.exception & 0x80000000u;
  record.fault.exception &= ~0x80000000u;
  record.n_starts++;
  if (was_watchdog) record.n_watchdog_resets++;
  seal();
}

const stm32_record_t* stm32_record(void) {
  return &record;
}

bool stm32_was_watchdog(void) {
  return was_watchdog;
}

bool stm32_was_fault(void) {
  return was_fault;
}

void stm32_record_fault(const stm32_fault_t* fault) {
  record.fault = *fault;
  record.fault.exception |= 0x80000000u; /* not told yet */
  record.n_faults++;
  seal();
  cortexm_reset();
}

uint32_t stm32_random(void) {
  uint32_t value = stm32_record()->n_starts * 2654435761u ^ (uint32_t)stm32_time_us();
  reg_set(RCC_AHB2ENR, 1u << 6);
  reg_write(RNG_CR, 1u << 2);
  if (wait_set(RNG_SR, 1u)) value ^= reg_read(RNG_DR);
  reg_write(RNG_CR, 0);
  return value;
}
