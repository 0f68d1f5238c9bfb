// SPDX-License-Identifier: MIT
/* Tables in sectors 1 and 2 of the chip's flash. */
#include <string.h>

#include "board.h"

static imucal_status flash_erase(void* ctx, uint32_t slot) {
  (void)ctx;
  return stm32_flash_erase(slot);
}

static imucal_status flash_program(void* ctx, uint32_t slot, uint32_t offset, const uint8_t* data, uint32_t len) {
  (void)ctx;
  return stm32_flash_program(slot, offset, data, len);
}

static imucal_status flash_read(void* ctx, uint32_t slot, uint32_t offset, uint8_t* data, uint32_t len) {
  (void)ctx;
  memcpy(data, reg_memory(STM32_SLOT_ADDRESS(slot) + offset), len);
  return IMUCAL_OK;
}

board_store_t board_store_init(const stm32_clocks_t* clocks) {
  (void)clocks;
  return (board_store_t){.flash = {.erase = flash_erase,
                                   .program = flash_program,
                                   .read = flash_read,
                                   .slot_bytes = STM32_SLOT_BYTES,
                                   .erase_bytes = STM32_SLOT_BYTES,
                                   .program_bytes = 4}};
}

uint32_t board_store_supply_refused(void) {
  return stm32_supply_refused();
}
