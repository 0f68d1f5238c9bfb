// SPDX-License-Identifier: MIT
/* Purpose: exact sums of raw samples over seconds cut by the samples' own time stamps.
 * Data: imucal_sample_t in, in any rhythm; one imucal_second_t out when the first sample of a later second
 * arrives.  Order: init, add for every sample, flush at the end.
 * Memory: sizeof(imucal_sum_t), no heap.  Time: one 64-bit add per channel and sample, and what tells that the sample is
 * the next of the running second; once a second a division.
 * Thread/ISR: one context at a time per imucal_sum_t.
 *
 * Second k holds the samples with k*1e6 <= t_us < (k+1)*1e6 and is reported as ending at t_s = k+1.
 * Scaling and overflow: counts are int32, sums int64.  Time stamps of samples taken rise by a microsecond or more, so that
 * a second holds at most 10^6 samples: 2^31 counts times 2^20 is 2^51, so that a sum is exact, always. */
#ifndef IMUCAL_SUM_H
#define IMUCAL_SUM_H

#include "sample.h"
#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_SUM_MAX_SAMPLES 1000000u /* in a second */
#define IMUCAL_SUM_MAX_RATE_HZ 100000u

/* Bits of the flags of a second (host/formats.md, Log, columns *_flags). */
enum { IMUCAL_FLAG_SATURATED = 1, IMUCAL_FLAG_MISSING = 2, IMUCAL_FLAG_FAULT = 4 };

/* A finished second. */
typedef struct imucal_second {
  int64_t temp_sum;                 /* counts */
  int64_t sum[IMUCAL_MAX_CHANNELS]; /* counts */
  uint32_t t_s;                     /* the second's end */
  uint32_t n_samples;               /* >= 1 */
  uint32_t n_skipped;               /* whole seconds without any sample before this one */
  uint8_t n_channels;
  uint8_t flags[IMUCAL_MAX_CHANNELS]; /* IMUCAL_FLAG_* per channel */
  bool is_gap;                        /* fewer than half of the nominal samples: no measurement */
} imucal_second_t;

typedef struct imucal_sum {
  uint64_t end_us;    /* end of the running second; 0 before the first sample */
  uint64_t last_us;   /* newest time stamp taken */
  uint32_t hole_us;   /* two samples further apart than this: samples are missing (1.5 nominal periods) */
  uint32_t period_us; /* nominal, between two samples */
  imucal_second_t run;
  uint8_t saturated, fault; /* channel bits seen in the running second */
  uint32_t nominal_n;       /* samples per second expected */
  uint32_t last_t_s;        /* end of the last second handed out; 0: none */
  /* What was dropped or odd, readable by anybody. */
  uint32_t n_handed_out; /* samples of the seconds handed out */
  uint32_t n_duplicate;  /* same time stamp as the one before: left out */
  uint32_t n_backward;   /* time stamp before the newest one: left out */
  uint32_t n_jump;       /* at least one whole second without a sample */
  uint32_t n_refused;    /* other number of channels, time beyond 2^32 s */
} imucal_sum_t;

/* rate_hz: nominal samples per second, 1..IMUCAL_SUM_MAX_RATE_HZ; n_channels: 1..IMUCAL_MAX_CHANNELS.
 * IMUCAL_ERR_ARGUMENT otherwise. */
IMUCAL_MUST_USE imucal_status imucal_sum_init(imucal_sum_t* sum, uint32_t n_channels, uint32_t rate_hz);

/* Take a sample.  IMUCAL_OK: taken; IMUCAL_SECOND_READY: taken, and *second holds the second before it;
 * IMUCAL_ERR_PERIOD: duplicate or backward time, counted and left out; IMUCAL_ERR_RANGE: refused and counted.
 * A second is flagged missing when two neighbouring samples lie more than 1.5 nominal periods apart and one was due in
 * it: by time and not by number, so that a slow sample clock, or jitter below half a period, raises no flag. */
IMUCAL_MUST_USE imucal_status imucal_sum_add(imucal_sum_t* sum, const imucal_sample_t* sample, imucal_second_t* second);

/* Samples taken so far. */
static inline uint32_t imucal_sum_n_taken(const imucal_sum_t* sum) {
  return sum->n_handed_out + sum->run.n_samples;
}

/* Hand out the running second, if any: IMUCAL_SECOND_READY, else IMUCAL_OK.  The next sample starts anew; one
 * of the second handed out counts as backward. */
IMUCAL_MUST_USE imucal_status imucal_sum_flush(imucal_sum_t* sum, imucal_second_t* second);

/* Mean of n values in units of 2^-16 count, rounded to nearest even.
 * Pre: 1 <= n <= IMUCAL_SUM_MAX_SAMPLES, |sum| <= 2^31 n.  Post: |mean| <= 2^47. */
int64_t imucal_mean_q16_rne(int64_t sum, uint32_t n);

/* Fixed point to physical unit: (float)mean_q16 rounded to nearest even (24 bits), times 2^-16 (exact), times
 * scale (one rounding), plus offset (one rounding).  Relative error at most 2^-23 of the product. */
float imucal_unit_from_q16(int64_t mean_q16, float scale_unit_per_count, float offset_unit);

/* White variance of the second's mean of channel i over that of a whole second: nominal over taken samples, at least 1,
 * where samples are missing; else 1 (a sample clock off its nominal rate is no loss). */
float imucal_sum_noise_ratio(const imucal_sum_t* sum, const imucal_second_t* second, uint32_t i_channel);

#if defined(__cplusplus)
}
#endif
#endif
