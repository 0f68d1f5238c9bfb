// SPDX-License-Identifier: MIT
/* Purpose: what the app must know of the board it runs on: who it is and what its sensor's counts mean.
 * A port fills it once, before imucal_app_init; it must stay valid and unchanged while the app runs. */
#ifndef IMUCAL_APP_BOARD_H
#define IMUCAL_APP_BOARD_H
#include "table.h"

#if defined(__cplusplus)
extern "C" {
#endif

typedef struct imucal_board {
  char serial[IMUCAL_SERIAL_LEN]; /* printable ASCII without blanks, padded with 0; a table names it */
  uint8_t n_channels;             /* 1..IMUCAL_MAX_CHANNELS */
  uint32_t rate_hz;               /* nominal samples per second */
  float degc_per_count;           /* thermometer: degC = counts * degc_per_count + degc_at_zero */
  float degc_at_zero;
  struct {
    /* Ends in its unit, _dph or _mg: gx_dph, ax_mg.  What stands before it is no other channel's. */
    char name[IMUCAL_NAME_LEN];
    float unit_per_count;      /* > 0 */
    int32_t full_scale_counts; /* > 0: |counts| at the rail */
  } channel[IMUCAL_MAX_CHANNELS];
} imucal_board_t;

/* Checks every field: IMUCAL_ERR_NAME, IMUCAL_ERR_CHANNELS, IMUCAL_ERR_SCALE, IMUCAL_ERR_RANGE (rate, full
 * scale). */
IMUCAL_MUST_USE imucal_status imucal_board_check(const imucal_board_t* board);

#if defined(__cplusplus)
}
#endif
#endif
