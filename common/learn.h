// SPDX-License-Identifier: MIT
/* Purpose: what is done with a second that has come: bridge the time before it, read the thermometer, update
 * the filter or say why not, count.  Every program that learns (firmware, offline fit, Monte Carlo, checks)
 * does it here.
 * Data: a finished second of sum.h in; the filter's state and one count per outcome out.
 * Order: imucal_thermometer_init and imucal_learn_init; then for every second imucal_thermometer_read once, and
 * imucal_learn_second (or imucal_learn_checked of imucal_learn_input_of) for every channel that learns.
 * Memory: sizeof(imucal_learn_t) per channel, sizeof(imucal_thermometer_t) per device; no heap.
 * Time: that of imucal_track_update once, of imucal_kf_skip and imucal_kf_update_scaled per channel.
 * Thread: one context per struct.
 *
 * The rule of a second.  Whole seconds without a sample are bridged by the time update.  A second is a
 * measurement unless too few samples, a fault, the rail or an unsure thermometer spoil it, or the filter
 * refuses it; then it is bridged too.  A second with lost samples counts less: its white variance is that of
 * the samples it has.
 *
 * Where a new rule goes.  A rule that looks at a second alone, or at the seconds before it: into `verdict_of` in
 * learn.c, with its own outcome.  A rule that looks at the innovation: into imucal_learn_take, before the
 * update.  A rule about the thermometer: into imucal_thermometer_read.  What a rule remembers goes into the
 * struct beside the counts. */
#ifndef IMUCAL_LEARN_H
#define IMUCAL_LEARN_H

#include "health.h"
#include "kf.h"
#include "status.h"
#include "sum.h"
#include "track.h"

#if defined(__cplusplus)
extern "C" {
#endif

/* ---- the thermometer: one per device ---- */

typedef struct imucal_thermometer {
  float degc_per_count, degc_at_zero; /* degC = counts * degc_per_count + degc_at_zero */
  bool is_tracked;                    /* the temperature is followed between the steps (track.h) */
  bool is_sure;                       /* the last second's temperature is good enough to learn from */
  float temp_degc;                    /* of the last second: what the filters learn with */
  imucal_track_t track;
} imucal_thermometer_t;

/* Start: nothing read yet.  Tracked when a count is more than IMUCAL_TRACK_COARSE_DEGC; who wants it
 * otherwise sets is_tracked after this. */
void imucal_thermometer_init(imucal_thermometer_t* thermometer, float degc_per_count, float degc_at_zero);

/* The temperature of a finished second.  Call it for every second, in order of time, also when no channel
 * learns. */
void imucal_thermometer_read(imucal_thermometer_t* thermometer, const imucal_second_t* second);

/* ---- a channel that learns ---- */

/* What became of a second.  Each has its count; all but USED were bridged. */
typedef enum imucal_learn_outcome {
  IMUCAL_LEARN_USED,        /* the filter learnt from it */
  IMUCAL_LEARN_MISSING,     /* fewer than half of its samples, or no value at all */
  IMUCAL_LEARN_FAULT,       /* the sensor reported a fault */
  IMUCAL_LEARN_SATURATED,   /* a sample was at its rail */
  IMUCAL_LEARN_TEMPERATURE, /* the temperature is not known well enough (track.h) */
  IMUCAL_LEARN_REFUSED,     /* the filter refused it: not finite or out of range */
  IMUCAL_LEARN_KNOCK,       /* the gate left it out: its innovation is beyond what noise makes (health.h) */
  IMUCAL_LEARN_N_OUTCOMES
} imucal_learn_outcome_t;

/* One channel.  Readable by anybody, written only by the functions below. */
typedef struct imucal_learn {
  imucal_kf_t kf;
  uint32_t n[IMUCAL_LEARN_N_OUTCOMES]; /* seconds, by outcome */
  uint32_t n_gap_s;                    /* whole seconds without any sample, bridged */
} imucal_learn_t;

/* A second as one channel sees it: for callers without samples.  The others use imucal_learn_second. */
typedef struct imucal_learn_input {
  float value; /* 1-s mean, unit */
  float temp_degc;
  float noise_ratio; /* white variance of this mean over that of a whole second (imucal_kf_update_scaled) */
  uint32_t gap_s;    /* whole seconds without data just before it; more than IMUCAL_KF_MAX_GAP_S are as many */
  imucal_learn_outcome_t verdict; /* IMUCAL_LEARN_USED: a measurement; else why it is none */
} imucal_learn_input_t;

/* Start with the status of imucal_kf_init; refused: *learn unchanged. */
IMUCAL_MUST_USE imucal_status imucal_learn_init(imucal_learn_t* learn, const imucal_kf_config_t* config);

/* Bridge, update, count.  Returns what became of the second, and counts it; after IMUCAL_LEARN_USED the
 * innovation and its weight stand in learn->kf.stats.  Before imucal_learn_init: IMUCAL_LEARN_REFUSED. */
imucal_learn_outcome_t imucal_learn_take(imucal_learn_t* learn, const imucal_learn_input_t* input);

/* The same through the rules of health.h: a temperature out of reach is IMUCAL_LEARN_TEMPERATURE, an
 * innovation that the gate leaves out IMUCAL_LEARN_KNOCK; the filter then is as though the second had been
 * bridged.  flags: IMUCAL_FLAG_*. Stack: a copy of the filter. */
imucal_learn_outcome_t imucal_learn_checked(imucal_learn_t* learn, imucal_health_t* health,
                                            const imucal_learn_input_t* input, uint32_t flags);

/* Channel i_channel of a finished second of `sum` as an input, with the temperature that `thermometer` has read of it.
 * value: the channel's mean of this second, unit (imucal_unit_from_q16).  Pre: i_channel < second->n_channels. */
imucal_learn_input_t imucal_learn_input_of(const imucal_thermometer_t* thermometer, const imucal_sum_t* sum,
                                           const imucal_second_t* second, uint32_t i_channel, float value);

/* imucal_learn_take of that input: without rules. */
imucal_learn_outcome_t imucal_learn_second(imucal_learn_t* learn, const imucal_thermometer_t* thermometer,
                                           const imucal_sum_t* sum, const imucal_second_t* second, uint32_t i_channel,
                                           float value);

#if defined(__cplusplus)
}
#endif
#endif
