// SPDX-License-Identifier: MIT
/* ICM-42688-P on SPI1 at 1 kHz, 20-bit data. */
#include "board.h"
#include "sensors/icm42688p.h"

#define SPI_HZ 10500000u
#define RATE_HZ 1000u
#define POLL_US 5000u

static imucal_status transfer(void* ctx, uint8_t device, const uint8_t* out, size_t n_out, uint8_t* in, size_t n_in) {
  (void)ctx, (void)device;
  return stm32_spi_transfer(STM32_SPI_PA4, out, n_out, in, n_in);
}

static void delay_us(void* ctx, uint32_t us) {
  (void)ctx;
  stm32_delay_us(us);
}

board_sensor_t board_sensor_init(const stm32_clocks_t* clocks) {
  static imucal_icm42688p_t icm;
  static const imucal_sensor_bus_t bus = {.transfer = transfer, .delay_us = delay_us, .is_spi = true};
  static const imucal_icm42688p_config_t config = {.rate_hz = RATE_HZ, .is_high_resolution = true, .filter = 1};
  stm32_spi_init(clocks->apb2_hz, SPI_HZ);
  return (board_sensor_t){.driver = &imucal_icm42688p_driver,
                          .state = &icm,
                          .config = &config,
                          .bus = &bus,
                          .poll_us = POLL_US,
                          .rate_hz = RATE_HZ,
                          .units = imucal_icm42688p_units(&config)};
}
