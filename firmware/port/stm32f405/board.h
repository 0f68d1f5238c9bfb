// SPDX-License-Identifier: MIT
/* Purpose: what differs between the image for the chip (board_chip.c: ICM-42688-P on SPI1, table in the chip's flash) and
 * the one for QEMU's netduinoplus2 (board_emulated.c: samples and flash are files; QEMU models neither SPI devices nor the
 * flash controller nor the clocks).  main.c and all drivers but these are the same. */
#ifndef IMUCAL_PORT_STM32F405_BOARD_H
#define IMUCAL_PORT_STM32F405_BOARD_H
#include "app/app.h"
#include "stm32f405.h"

/* Sets samples, flash, boot_id and name of *port, and all of *board. */
void board_init(imucal_port_t* port, imucal_board_t* board, const stm32_clocks_t* clocks);
#endif
