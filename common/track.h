// SPDX-License-Identifier: MIT
/* Purpose: the temperature between the steps of a coarse thermometer (quantum 1 degC or so), from the times
 * at which its reading changes.  On a ramp a reading is wrong by a sawtooth of half a quantum; times dB/dT
 * that is an error of the rate with the period of the steps, which the filter takes for instability of the
 * gyro.
 * Data: one 1-s mean of temperature counts in, the estimate in counts out.
 * Order: init; then per second update (or skip).
 * Memory: sizeof(imucal_track_t).  Time: bounded, at most one division.  Integers only: same bits everywhere.
 *
 * Method.  When the mean passes k + 1/2 counts (and then by 1/4, against noise), the temperature is there: a
 * known point.  Two points in the same direction give the rate; until the next one the estimate moves on at
 * that rate, inside the bin of the reading.  When the next point is overdue by an eighth of its time the ramp
 * has ended: the estimate is the bin's middle. After a single point (the first of a ramp, a reversal) the
 * rate is unknown and the middle as wrong as can be: until the next point, but no longer than
 * IMUCAL_TRACK_UNSURE_S, `is_sure` is false and a filter does better without the second (imucal_kf_skip); a
 * jump of the temperature where the gyro has none does more harm than a gap. The estimate is in the bin of
 * the reading, never more than 1 1/4 counts from the mean.
 *
 * Limit: in a soak the temperature is known to the bin only.  Soak on whole counts, where the middle is
 * right; a soak elsewhere costs dB/dT times its distance from the middle, and no estimator can know that. */
#ifndef IMUCAL_TRACK_H
#define IMUCAL_TRACK_H

#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_TRACK_COARSE_DEGC 0.1f /* thermometers with a quantum above this are worth tracking */
#define IMUCAL_TRACK_UNSURE_S 300u    /* without a second point for so long it is no ramp: a soak */

typedef struct imucal_track {
  int32_t level;       /* reading: the bin level - 1/2 .. level + 1/2 counts */
  int32_t rate_q16;    /* counts per second; 0: unknown or standing */
  int64_t edge_q16;    /* the point passed last, counts */
  uint32_t since_s;    /* seconds since then */
  uint32_t beyond_s;   /* seconds the mean is beyond the edge, not yet by the quarter */
  uint32_t interval_s; /* seconds between the last two points in one direction; 0: not known */
  int8_t direction;    /* of the last point: +1, -1; 0: none yet */
  bool has_level;
  bool is_rate_awaited; /* one point passed, the next will give the rate */
  bool is_sure;         /* the last estimate is good enough to learn from */
} imucal_track_t;

/* Start: nothing known. */
void imucal_track_init(imucal_track_t* track);

/* One second: mean temperature in units of 2^-16 count (imucal_mean_q16_rne), |mean| <= 2^47.  Returns the estimate in the
 * same unit.  A mean beyond 2^30 counts is handed back as it is, and leaves *track (is_sure too) as it was. */
int64_t imucal_track_update(imucal_track_t* track, int64_t mean_q16);

/* n_s seconds without a reading. */
void imucal_track_skip(imucal_track_t* track, uint32_t n_s);

#if defined(__cplusplus)
}
#endif
#endif
