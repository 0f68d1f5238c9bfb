// SPDX-License-Identifier: MIT
/* Tables in an external W25Q SPI flash on SPI1, chip select PB0. */
#include "board.h"
#include "flash/w25q.h"

#define SPI_HZ 10500000u /* the sensor's on the same bus */
/* Where in the flash: two sectors of 4 KB. */
#ifndef STM32_W25Q_BASE
#define STM32_W25Q_BASE 0u
#endif
#if STM32_W25Q_BASE % 4096u != 0
#error "STM32_W25Q_BASE: address of two sectors, multiple of 4096"
#endif

static imucal_w25q_t w25q;

static imucal_status w25q_transfer(void* ctx, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  (void)ctx;
  return stm32_spi_transfer(STM32_SPI_PB0, out, n_out, in, n_in);
}

static void w25q_delay_us(void* ctx, uint32_t us) {
  (void)ctx;
  stm32_delay_us(us);
}

static bool w25q_is_supply_good(void* ctx) {
  (void)ctx;
  return stm32_supply_is_good();
}

static const char* trouble_of(imucal_w25q_state_t state) {
  switch (state) {
  case IMUCAL_W25Q_FOREIGN:
    return "other flash";
  case IMUCAL_W25Q_BUSY:
    return "w25q busy";
  case IMUCAL_W25Q_PROTECTED:
    return "w25q locked";
  default:
    return "no w25q";
  }
}

/* A chip that does not answer now is looked for again with every access. */
board_store_t board_store_init(const stm32_clocks_t* clocks) {
  static const imucal_w25q_bus_t bus = {
      .transfer = w25q_transfer, .delay_us = w25q_delay_us, .is_supply_good = w25q_is_supply_good};
  stm32_spi_init_pb0();
  stm32_spi_init(clocks->apb2_hz, SPI_HZ);
  const bool is_started = imucal_w25q_start(&w25q, &bus, STM32_W25Q_BASE) == IMUCAL_OK;
  const bool is_good = is_started && w25q.state == IMUCAL_W25Q_READY;
  return (board_store_t){.flash = imucal_w25q_flash(&w25q), .trouble = is_good ? NULL : trouble_of(w25q.state)};
}

uint32_t board_store_supply_refused(void) {
  return w25q.n_supply_refused;
}
