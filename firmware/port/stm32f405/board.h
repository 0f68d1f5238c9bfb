// SPDX-License-Identifier: MIT
/* Purpose: what differs between the image for the chip (board_chip.c with board_icm42688p.c: SPI1, or
 * board_mpu6050.c: I2C1; table in the chip's flash) and
 * the one for QEMU's netduinoplus2 (board_emulated.c: samples and flash are files; QEMU models neither SPI devices nor the
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

/* Sets samples, flash, boot_id and name of *port, and all of *board. */
void board_init(imucal_port_t* port, imucal_board_t* board, const stm32_clocks_t* clocks);
#endif
