// SPDX-License-Identifier: MIT
/* Purpose: what differs between the images for the chip (board_chip.c with board_icm42688p.c: SPI1, or board_mpu6050.c: I2C1;
 * tables in the chip's flash: board_store_chip.c, or in a W25Q on SPI1: board_store_w25q.c) and the one for QEMU's netduinoplus2 (board_emulated.c: samples and flash are files; QEMU models neither SPI devices nor the
 * flash controller nor the clocks).  main.c and all drivers but these are the same. */
#ifndef IMUCAL_PORT_STM32F405_BOARD_H
#define IMUCAL_PORT_STM32F405_BOARD_H
#include "app/app.h"
#include "sensors/source.h"
#include "stm32f405.h"

/* The sensor of an image: its driver, where it is, and what its counts mean. */
typedef struct board_sensor {
  const imucal_sensor_driver_t* driver;
  void* state;
  const void* config;
  const imucal_sensor_bus_t* bus;
  uint32_t poll_us, rate_hz;
  imucal_sensor_units_t units;
} board_sensor_t;

/* Sets up the bus; the sensor itself is started by imucal_source_init. */
board_sensor_t board_sensor_init(const stm32_clocks_t* clocks);

/* Where the tables of an image are. */
typedef struct board_store {
  imucal_flash_t flash;
  const char* trouble; /* at most 13 characters for the device's name; null: none */
} board_store_t;

/* Before board_sensor_init: on a shared bus its chip must not listen. */
board_store_t board_store_init(const stm32_clocks_t* clocks);
uint32_t board_store_supply_refused(void); /* erases and programs refused because of a low supply */

/* Sets samples, flash, boot_id and name of *port, and all of *board. */
void board_init(imucal_port_t* port, imucal_board_t* board, const stm32_clocks_t* clocks);
#endif
