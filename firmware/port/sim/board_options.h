// SPDX-License-Identifier: MIT
/* Purpose: the board of an emulated device from text options, the same for every emulated port. */
#ifndef IMUCAL_PORT_SIM_BOARD_OPTIONS_H
#define IMUCAL_PORT_SIM_BOARD_OPTIONS_H
#include "app/board.h"

/* Serial "0001", three gyros gx_dph gy_dph gz_dph (then ax_mg ay_mg az_mg) of 1 dph (0.01 mg) per count, 24
 * bits, 100 Hz, 0.01 degC per count from 25 degC. */
void board_options_default(imucal_board_t* board);

/* Sets one option; the value ends at a zero or a blank.
 *   serial=TEXT  channels=1..6  rate=HZ  temp-scale=DEGC_PER_COUNT  temp-zero=DEGC
 *   names=NAME,…  scale=UNIT_PER_COUNT,…  full-scale=COUNTS,…     (the last of a list holds for the rest, but
 * names) True where it is one of these and its value can be read; the ranges are imucal_board_check's. */
bool board_options_set(imucal_board_t* board, const char* name, const char* value);

/* Decimal number ("-1.25e-3") nearest to float32; *end: what follows.  False: no number. */
bool board_options_number(const char* text, float* value, const char** end);
#endif
