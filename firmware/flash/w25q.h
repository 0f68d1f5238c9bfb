// SPDX-License-Identifier: MIT
/* Purpose: two table slots in an external SPI flash of Winbond's W25Q series (W25Q40 to W25Q128, 3-byte addresses), as
 * common/store.h wants them.  Nothing here knows a processor: transfer and delay are callbacks.
 * Data: imucal_flash_t out of imucal_w25q_flash.  Order: imucal_w25q_start once; a chip that does not answer then is looked for
 * again by each call.
 * Memory: the caller's struct; no heap, no globals; 68 bytes of stack for a piece of a page.
 * Time: an erase 30 ms to 0.4 s, 64 bytes of a table at most 3 ms (data sheet); every wait has an end: a chip that stays
 * busy costs IMUCAL_W25Q_BUSY_LIMIT_US once, then each call looks once and fails until it answers again.
 * Thread/ISR: one context; nobody else may talk to the chip between calls that write.
 * Source: Winbond's data sheets and four drivers of others, line by line in firmware/port/stm32f405/README.md. */
#ifndef IMUCAL_FLASH_W25Q_H
#define IMUCAL_FLASH_W25Q_H
#include "store.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_W25Q_SECTOR_BYTES 4096u
#define IMUCAL_W25Q_PAGE_BYTES 256u
#define IMUCAL_W25Q_BUSY_LIMIT_US 500000u /* the longest erase of a sector takes 400 ms (tSE) */

typedef struct imucal_w25q_bus {
  void* ctx;
  /* One chip select around all: n_out >= 1 bytes out, then n_in in; mode 0 or 3, at most 20 MHz (read data, 03h, of the oldest).  IMUCAL_OK, or what
   * was wrong; then `in` may hold anything. */
  imucal_status (*transfer)(void* ctx, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in);
  void (*delay_us)(void* ctx, uint32_t us); /* waits at least so long */
  bool (*is_supply_good)(void* ctx);        /* may be null: always; below 2.7 V nothing may be erased or programmed */
} imucal_w25q_bus_t;

/* What the newest look at the chip has found. */
typedef enum imucal_w25q_state {
  IMUCAL_W25Q_READY,
  IMUCAL_W25Q_ABSENT,  /* bus failed, all zeros or all ones */
  IMUCAL_W25Q_FOREIGN, /* another maker, or a size that needs addresses of 4 bytes or does not hold the slots */
  IMUCAL_W25Q_BUSY,    /* did not end what it was doing in time */
  IMUCAL_W25Q_PROTECTED /* block protect, complement, individual locks or a suspended erase: nothing can be written; reads work */
} imucal_w25q_state_t;

/* Readable by anybody, written only by the functions below. */
typedef struct imucal_w25q {
  const imucal_w25q_bus_t* bus;
  uint32_t base; /* address of slot 0; slot 1 follows at base + 4096 */
  imucal_w25q_state_t state;
  uint8_t id[3];           /* maker, type, capacity as 2^n bytes */
  uint32_t capacity_bytes; /* 0: unknown */
  uint32_t n_bus_errors, n_timeouts, n_not_enabled, n_protected, n_supply_refused;
} imucal_w25q_t;

/* Wakes the chip (release from power-down), waits for what it may still be doing since before a reset, and asks who it
 * is.  base: multiple of 4096.  IMUCAL_OK also where it is protected; IMUCAL_ERR_FLASH: see state; IMUCAL_ERR_ARGUMENT. */
IMUCAL_MUST_USE imucal_status imucal_w25q_start(imucal_w25q_t* flash, const imucal_w25q_bus_t* bus, uint32_t base);

/* slot 0 or 1; IMUCAL_ERR_ARGUMENT outside of it.  IMUCAL_ERR_SUPPLY: nothing was touched.  IMUCAL_ERR_FLASH: the chip is not
 * READY, the write enable latch did not set, or the chip stayed busy. */
IMUCAL_MUST_USE imucal_status imucal_w25q_erase(imucal_w25q_t* flash, uint32_t slot);
IMUCAL_MUST_USE imucal_status imucal_w25q_program(imucal_w25q_t* flash, uint32_t slot, uint32_t offset,
                                                  const uint8_t* data, uint32_t len);
IMUCAL_MUST_USE imucal_status imucal_w25q_read(imucal_w25q_t* flash, uint32_t slot, uint32_t offset, uint8_t* data,
                                               uint32_t len);

/* The three as the store takes them; *flash must stay valid. */
imucal_flash_t imucal_w25q_flash(imucal_w25q_t* flash);

#if defined(__cplusplus)
}
#endif
#endif
