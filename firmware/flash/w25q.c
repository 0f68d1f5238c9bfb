// SPDX-License-Identifier: MIT
#include "flash/w25q.h"

#include <string.h>

/* Instructions and status bits: confirmed where the table in firmware/port/stm32f405/README.md says. */
#define WRITE_ENABLE 0x06u
#define READ_STATUS_1 0x05u
#define READ_STATUS_2 0x35u
#define READ_STATUS_3 0x15u /* unknown to BV, CV and DV types: the line stays undriven */
#define READ_DATA 0x03u
#define PAGE_PROGRAM 0x02u
#define SECTOR_ERASE 0x20u
#define RELEASE_POWER_DOWN 0xABu
#define READ_JEDEC_ID 0x9Fu

#define SR1_BUSY 0x01u
#define SR1_WEL 0x02u
#define SR1_BLOCK_PROTECT 0x1Cu /* BP2 BP1 BP0 */
#define SR2_COMPLEMENT 0x40u    /* CMP: protects what BP does not */
#define SR2_SUSPENDED 0x80u     /* SUS, by somebody else: erases are ignored, and BUSY is 0 */
#define SR3_INDIVIDUAL 0x04u    /* WPS: a lock for each sector, all set after power-up */
#define SR3_ABSENT 0xFFu        /* pulled up */

#define MAKER_WINBOND 0xEFu
#define MIN_CAPACITY 0x13u /* 2^19 bytes: W25Q40 */
#define MAX_CAPACITY 0x18u /* 2^24 bytes: W25Q128, the last with addresses of 3 bytes */
#define WAKE_US 30u        /* tRES1 is 3 us */
#define POLL_US 100u
#define PIECE_BYTES 64u /* of a page, in one instruction */

static bool ask(imucal_w25q_t* flash, uint8_t instruction, uint8_t* in, size_t n_in) {
  const bool is_good = flash->bus->transfer(flash->bus->ctx, &instruction, 1, in, n_in) == IMUCAL_OK;
  flash->n_bus_errors += !is_good;
  return is_good;
}

static void put_address(uint8_t* at, uint8_t instruction, uint32_t address) {
  at[0] = instruction;
  at[1] = (uint8_t)(address >> 16);
  at[2] = (uint8_t)(address >> 8);
  at[3] = (uint8_t)address;
}

static imucal_status lose(imucal_w25q_t* flash, imucal_w25q_state_t why) {
  flash->state = why;
  return IMUCAL_ERR_FLASH;
}

/* Until BUSY is 0.  All ones: nobody drives the line, no use waiting. */
static imucal_status wait_idle(imucal_w25q_t* flash, uint32_t limit_us) {
  for (uint32_t waited_us = 0;; waited_us += POLL_US) {
    uint8_t status = 0;
    if (!ask(flash, READ_STATUS_1, &status, 1) || status == 0xFFu) return lose(flash, IMUCAL_W25Q_ABSENT);
    if (!(status & SR1_BUSY)) return IMUCAL_OK;
    if (waited_us >= limit_us) break;
    flash->bus->delay_us(flash->bus->ctx, POLL_US);
  }
  flash->n_timeouts++;
  return lose(flash, IMUCAL_W25Q_BUSY);
}

static bool is_capacity(const imucal_w25q_t* flash, uint8_t power) {
  return power >= MIN_CAPACITY && power <= MAX_CAPACITY &&
         flash->base <= ((uint32_t)1 << power) - 2u * IMUCAL_W25Q_SECTOR_BYTES;
}

/* Who it is; asked before every operation, so that a bus that died since is not taken for erased flash. */
static imucal_status identify(imucal_w25q_t* flash) {
  uint8_t id[3] = {0, 0, 0};
  if (!ask(flash, READ_JEDEC_ID, id, sizeof id)) return lose(flash, IMUCAL_W25Q_ABSENT);
  memcpy(flash->id, id, sizeof id);
  const uint8_t all = id[0] & id[1] & id[2], any = id[0] | id[1] | id[2];
  if (any == 0 || all == 0xFFu) return lose(flash, IMUCAL_W25Q_ABSENT);
  if (id[0] != MAKER_WINBOND || !is_capacity(flash, id[2])) return lose(flash, IMUCAL_W25Q_FOREIGN);
  flash->capacity_bytes = (uint32_t)1 << id[2];
  return IMUCAL_OK;
}

/* Any protection counts, also of other blocks: what protects which block differs within the series. */
static imucal_status look_for_protection(imucal_w25q_t* flash) {
  uint8_t sr1 = 0, sr2 = 0, sr3 = 0;
  const bool is_good =
      ask(flash, READ_STATUS_1, &sr1, 1) && ask(flash, READ_STATUS_2, &sr2, 1) && ask(flash, READ_STATUS_3, &sr3, 1);
  if (!is_good) return lose(flash, IMUCAL_W25Q_ABSENT);
  const bool is_individual = sr3 != SR3_ABSENT && sr3 & SR3_INDIVIDUAL;
  const bool is_protected = sr1 & SR1_BLOCK_PROTECT || sr2 & (SR2_COMPLEMENT | SR2_SUSPENDED) || is_individual;
  flash->state = is_protected ? IMUCAL_W25Q_PROTECTED : IMUCAL_W25Q_READY;
  return IMUCAL_OK;
}

/* One in power-down hears nothing but its release. */
static imucal_status wake(imucal_w25q_t* flash, uint32_t limit_us) {
  uint8_t ignored[4];
  if (!ask(flash, RELEASE_POWER_DOWN, ignored, sizeof ignored)) return lose(flash, IMUCAL_W25Q_ABSENT);
  flash->bus->delay_us(flash->bus->ctx, WAKE_US);
  imucal_status status = wait_idle(flash, limit_us);
  if (status == IMUCAL_OK) status = identify(flash);
  return status == IMUCAL_OK ? look_for_protection(flash) : status;
}

static imucal_status ready(imucal_w25q_t* flash) {
  /* One that did not end in time is looked at once, not waited for again. */
  if (flash->state == IMUCAL_W25Q_BUSY) return wake(flash, 0);
  if (flash->state == IMUCAL_W25Q_ABSENT || flash->state == IMUCAL_W25Q_FOREIGN)
    return wake(flash, IMUCAL_W25Q_BUSY_LIMIT_US);
  const imucal_status status = wait_idle(flash, IMUCAL_W25Q_BUSY_LIMIT_US);
  return status == IMUCAL_OK ? identify(flash) : status;
}

imucal_status imucal_w25q_start(imucal_w25q_t* flash, const imucal_w25q_bus_t* bus, uint32_t base) {
  memset(flash, 0, sizeof *flash);
  flash->bus = bus;
  flash->base = base;
  flash->state = IMUCAL_W25Q_ABSENT;
  if (base % IMUCAL_W25Q_SECTOR_BYTES != 0) return IMUCAL_ERR_ARGUMENT;
  return wake(flash, IMUCAL_W25Q_BUSY_LIMIT_US);
}

/* ---- writing ---- */

static imucal_status may_write(imucal_w25q_t* flash) {
  if (flash->bus->is_supply_good != NULL && !flash->bus->is_supply_good(flash->bus->ctx)) {
    flash->n_supply_refused++;
    return IMUCAL_ERR_SUPPLY;
  }
  imucal_status status = ready(flash);
  if (status == IMUCAL_OK) status = look_for_protection(flash);
  if (status != IMUCAL_OK) return status;
  if (flash->state == IMUCAL_W25Q_READY) return IMUCAL_OK;
  flash->n_protected++;
  return IMUCAL_ERR_FLASH;
}

/* The latch is read back: without it the chip ignores what follows, and says nothing. */
static imucal_status enable(imucal_w25q_t* flash) {
  uint8_t status = 0;
  if (!ask(flash, WRITE_ENABLE, NULL, 0) || !ask(flash, READ_STATUS_1, &status, 1))
    return lose(flash, IMUCAL_W25Q_ABSENT);
  if (status & SR1_WEL && !(status & SR1_BUSY)) return IMUCAL_OK;
  flash->n_not_enabled++;
  return IMUCAL_ERR_FLASH;
}

static imucal_status write(imucal_w25q_t* flash, const uint8_t* out, size_t n_out) {
  imucal_status status = enable(flash);
  if (status != IMUCAL_OK) return status;
  if (flash->bus->transfer(flash->bus->ctx, out, n_out, NULL, 0) != IMUCAL_OK) {
    flash->n_bus_errors++;
    return lose(flash, IMUCAL_W25Q_ABSENT);
  }
  return wait_idle(flash, IMUCAL_W25Q_BUSY_LIMIT_US);
}

static bool is_inside(uint32_t slot, uint32_t offset, uint32_t len) {
  return slot < IMUCAL_STORE_SLOTS && offset <= IMUCAL_W25Q_SECTOR_BYTES && len <= IMUCAL_W25Q_SECTOR_BYTES - offset;
}

static uint32_t address_of(const imucal_w25q_t* flash, uint32_t slot, uint32_t offset) {
  return flash->base + slot * IMUCAL_W25Q_SECTOR_BYTES + offset;
}

imucal_status imucal_w25q_erase(imucal_w25q_t* flash, uint32_t slot) {
  if (!is_inside(slot, 0, 0)) return IMUCAL_ERR_ARGUMENT;
  const imucal_status status = may_write(flash);
  if (status != IMUCAL_OK) return status;
  uint8_t out[4];
  put_address(out, SECTOR_ERASE, address_of(flash, slot, 0));
  return write(flash, out, sizeof out);
}

/* Pieces that end at a page's end at the latest: beyond it the chip would go on at the page's start. */
imucal_status imucal_w25q_program(imucal_w25q_t* flash, uint32_t slot, uint32_t offset, const uint8_t* data,
                                  uint32_t len) {
  if (!is_inside(slot, offset, len)) return IMUCAL_ERR_ARGUMENT;
  imucal_status status = may_write(flash);
  for (uint32_t at = 0, n = 0; at < len && status == IMUCAL_OK; at += n) {
    uint8_t out[4 + PIECE_BYTES];
    const uint32_t address = address_of(flash, slot, offset + at);
    const uint32_t left = IMUCAL_W25Q_PAGE_BYTES - address % IMUCAL_W25Q_PAGE_BYTES;
    n = len - at < PIECE_BYTES ? len - at : PIECE_BYTES;
    if (n > left) n = left;
    put_address(out, PAGE_PROGRAM, address);
    memcpy(out + 4, data + at, n);
    status = write(flash, out, 4 + n);
  }
  return status;
}

imucal_status imucal_w25q_read(imucal_w25q_t* flash, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  if (!is_inside(slot, offset, len)) return IMUCAL_ERR_ARGUMENT;
  const imucal_status status = ready(flash);
  if (status != IMUCAL_OK) return status;
  uint8_t out[4];
  put_address(out, READ_DATA, address_of(flash, slot, offset));
  if (flash->bus->transfer(flash->bus->ctx, out, sizeof out, data, len) == IMUCAL_OK) return IMUCAL_OK;
  flash->n_bus_errors++;
  return lose(flash, IMUCAL_W25Q_ABSENT);
}

/* ---- for the store ---- */

static imucal_status store_erase(void* ctx, uint32_t slot) {
  return imucal_w25q_erase((imucal_w25q_t*)ctx, slot);
}
static imucal_status store_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  return imucal_w25q_program((imucal_w25q_t*)ctx, slot, offset, data, len);
}
static imucal_status store_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  return imucal_w25q_read((imucal_w25q_t*)ctx, slot, offset, data, len);
}

/* A byte may be programmed alone, and there is no ECC; 4: what the store aligns to anyway. */
imucal_flash_t imucal_w25q_flash(imucal_w25q_t* flash) {
  return (imucal_flash_t){.erase = store_erase,
                          .program = store_program,
                          .read = store_read,
                          .ctx = flash,
                          .slot_bytes = IMUCAL_W25Q_SECTOR_BYTES,
                          .erase_bytes = IMUCAL_W25Q_SECTOR_BYTES,
                          .program_bytes = 4};
}
