// SPDX-License-Identifier: MIT
/* RM0090 chapter 3: unlock (3.6.1), erase (3.6.3), program (3.6.4), option bytes (3.7). */
#include "stm32f405.h"

#define KEY1 0x45670123u
#define KEY2 0xCDEF89ABu
#define OPTION_KEY1 0x08192A3Bu
#define OPTION_KEY2 0x4C5D6E7Fu
#define ERASE_LIMIT_US 1000000u /* a 16-KB sector: at most 500 ms (DS8626, flash memory characteristics) */
#define PROGRAM_LIMIT_US 1000u  /* a word: at most 100 us */
#define DATA_CACHE (1u << 10)   /* FLASH_ACR: enable, reset */
#define DATA_CACHE_RESET (1u << 12)

static uint32_t n_supply_refused;

static imucal_status wait_idle(uint32_t limit_us) {
  const uint64_t end_us = stm32_time_us() + limit_us;
  while (reg_read(FLASH_SR) & FLASH_SR_BSY)
    if (stm32_time_us() > end_us) return IMUCAL_ERR_FLASH;
  return IMUCAL_OK;
}

/* Old errors are cleared by writing ones, else they would be taken for this operation's. */
static imucal_status unlock(void) {
  if (!stm32_supply_is_good()) {
    n_supply_refused++;
    return IMUCAL_ERR_SUPPLY;
  }
  if (wait_idle(ERASE_LIMIT_US) != IMUCAL_OK) return IMUCAL_ERR_FLASH;
  if (reg_read(FLASH_CR) & FLASH_CR_LOCK) {
    reg_write(FLASH_KEYR, KEY1);
    reg_write(FLASH_KEYR, KEY2);
  }
  if (reg_read(FLASH_CR) & FLASH_CR_LOCK) return IMUCAL_ERR_FLASH; /* a wrong key locks it until the next reset */
  reg_write(FLASH_SR, FLASH_SR_ERRORS | FLASH_SR_EOP);
  return IMUCAL_OK;
}

static imucal_status finish(uint32_t limit_us) {
  if (wait_idle(limit_us) != IMUCAL_OK) return IMUCAL_ERR_FLASH;
  return reg_read(FLASH_SR) & FLASH_SR_ERRORS ? IMUCAL_ERR_FLASH : IMUCAL_OK;
}

/* The data cache may hold what was there before (3.5.2): it is emptied while it is off. */
static void lock(void) {
  reg_write(FLASH_CR, FLASH_CR_LOCK);
  const uint32_t acr = reg_read(FLASH_ACR);
  if (!(acr & DATA_CACHE)) return;
  reg_write(FLASH_ACR, acr & ~DATA_CACHE);
  reg_write(FLASH_ACR, (acr & ~DATA_CACHE) | DATA_CACHE_RESET);
  reg_write(FLASH_ACR, acr & ~DATA_CACHE);
  reg_write(FLASH_ACR, acr);
}

imucal_status stm32_flash_erase(uint32_t slot) {
  if (slot > 1) return IMUCAL_ERR_ARGUMENT;
  imucal_status status = unlock();
  if (status == IMUCAL_OK) {
    const uint32_t what = FLASH_CR_PSIZE_32 | FLASH_CR_SER | FLASH_CR_SNB(STM32_SLOT_SECTOR(slot));
    reg_write(FLASH_CR, what);
    reg_write(FLASH_CR, what | FLASH_CR_STRT);
    status = finish(ERASE_LIMIT_US);
  }
  lock();
  return status;
}

imucal_status stm32_flash_program(uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  if (slot > 1 || offset % 4 || len % 4 || offset > STM32_SLOT_BYTES || len > STM32_SLOT_BYTES - offset)
    return IMUCAL_ERR_ARGUMENT;
  imucal_status status = unlock();
  if (status == IMUCAL_OK) reg_write(FLASH_CR, FLASH_CR_PSIZE_32 | FLASH_CR_PG);
  for (uint32_t at = 0; at < len && status == IMUCAL_OK; at += 4) {
    const uint8_t* b = data + at;
    const uint32_t word = (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
    reg_write(STM32_SLOT_ADDRESS(slot) + offset + at, word);
    status = finish(PROGRAM_LIMIT_US);
  }
  lock();
  return status;
}

/* ---- supply ---- */

bool stm32_supply_is_good(void) {
  return !(reg_read(PWR_CSR) & PWR_CSR_PVDO);
}

uint32_t stm32_supply_refused(void) {
  return n_supply_refused;
}

imucal_status stm32_supply_init(void) {
  reg_set(RCC_APB1ENR, 1u << 28); /* PWR */
  reg_set(PWR_CR, PWR_CR_PLS_2V9 | PWR_CR_PVDE);
  if (!(reg_read(FLASH_OPTCR) & FLASH_OPTCR_BOR_LEV)) return IMUCAL_OK;
  if (!stm32_supply_is_good() || wait_idle(ERASE_LIMIT_US) != IMUCAL_OK) return IMUCAL_ERR_FLASH;
  reg_write(FLASH_OPTKEYR, OPTION_KEY1);
  reg_write(FLASH_OPTKEYR, OPTION_KEY2);
  reg_clear(FLASH_OPTCR, FLASH_OPTCR_BOR_LEV);
  reg_set(FLASH_OPTCR, FLASH_OPTCR_OPTSTRT);
  const imucal_status status = wait_idle(ERASE_LIMIT_US);
  reg_set(FLASH_OPTCR, FLASH_OPTCR_OPTLOCK);
  return status == IMUCAL_OK && !(reg_read(FLASH_OPTCR) & FLASH_OPTCR_BOR_LEV) ? IMUCAL_OK : IMUCAL_ERR_FLASH;
}
