// SPDX-License-Identifier: MIT
/* Purpose: is this channel fit to be calibrated, and did the filter's model hold?  One verdict for the device and for
 * logs: no table is to be made of a sick channel in silence.
 * Data: every second its 1-s mean, flags and temperature; where a filter runs also its innovation.  Out: whether the
 * second may be learnt from, and at any time a verdict: a bit, a figure and its limit for every rule.
 * Order: init; per second second(), then gate() if a filter took it (n_skipped: seconds without any sample before it).
 * Memory: sizeof(imucal_health_t) per channel, no heap.  Time: bounded, no loop longer than the rules.  No libm.
 * Thread/ISR: one context per struct.
 *
 * False alarms.  Statistical rules are judged at IMUCAL_HEALTH_Z = 4 standard deviations (3.2e-5 one-sided, per rule and
 * channel) *beyond* what a model may be wrong by without harm (the tolerances below): an identified model is never exact.
 * Rules of counts have limits that noise of any quantum up to twice its own standard deviation does not reach.
 * Checked on simulated healthy runs: tests/common/test_health.c, `make sick`.
 *
 *   rule        figure                                                           limit
 *   no-noise    mean squared step between seconds over 2 r                       below 0.05 (r unknown: 0)
 *   repeated    longest run of equal means, seconds                              40: chance 0.52^40 per second
 *   saturated   share of seconds with a sample at the rail                       0.01
 *   faulty      share of seconds with a fault of the sensor                      0.01
 *   temp-stuck  largest move of the rate (means of 128 s) while the temperature
 *               stands, over its standard deviation under the model              6
 *   temp-jump   steps of the temperature to another level that no sensor makes   0
 *   temp-spikes share of seconds with a temperature that no sensor reaches       0.01
 *   temp-ramp   largest change of temperature in 64 s over the wanted span       64/300: crossed in less than 5 min
 *   span        share of the wanted span that was seen                           below 0.5
 *   nis         mean of innovation^2/S                                           0.2 .. 1.25, + 4 sqrt(2/n)
 *   lag1        lag-1 correlation of the innovations                             +- (0.1 + 4/sqrt(n))
 *   slow        mean over blocks of 256 s of (sum nu/S)^2 / sum 1/S: the noise
 *               as slow motions of temperature see it                            1.5 times its chi-square quantile
 *   rejects     share of seconds that the gate left out, or 1 after a minute of
 *               them in a row                                                    0.01
 *
 * When a rule counts.  All are judged at any time, from what was seen so far.  `span` speaks against every run from its
 * first seconds on, until half of the span was seen: it says something of the channel only at the end.
 *
 * `slow` is what matters most: the calibration error grows with the noise at low frequency (design of the test:
 * 2 sigma^2 tau + r), of which nis says little.  The claimed error is too small by its square root
 * (imucal_health_error_factor).
 *
 * The gate.  An innovation beyond 6 standard deviations (2e-9 of healthy seconds) is left out and counted: a knock, a
 * bump of a minute.  What lasts longer is no bump: then the gate opens, and the rule speaks.  The temperature has its
 * own: a reading further from the last good one than 1 degC and 0.2 degC/s is left out; ten that agree with each other
 * are a new level. */
#ifndef IMUCAL_HEALTH_H
#define IMUCAL_HEALTH_H

#include "status.h"
#include "track.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_HEALTH_Z 4.0f
#define IMUCAL_HEALTH_MOST_REPEATED 40.0f /* seconds in a row with one value */
#define IMUCAL_HEALTH_MOST_NIS 1.25f      /* mean square of an innovation over what is believed */
#define IMUCAL_HEALTH_LEAST_NIS 0.2f
#define IMUCAL_HEALTH_MOST_SLOW 1.5f /* the same of sums over blocks of 256 s */
#define IMUCAL_HEALTH_GATE 36.0f     /* of innovation^2/S */
#define IMUCAL_HEALTH_UNGATED_N 16u  /* innovations before the gate closes: the prior is only a guess */
#define IMUCAL_HEALTH_MAX_REJECT_RUN 60u
#define IMUCAL_HEALTH_TEMP_STEP_DEGC 1.0f
#define IMUCAL_HEALTH_TEMP_RATE_DEGC_PER_S 0.2f /* 12 degC a minute */
/* A thermometer coarse enough to be tracked stands on a slow ramp too: above this quantum temp-stuck is not judged. */
#define IMUCAL_HEALTH_COARSE_DEGC IMUCAL_TRACK_COARSE_DEGC
#define IMUCAL_HEALTH_LEVEL_N 10u /* readings that make a level */
#define IMUCAL_HEALTH_MIN_N 120u  /* seconds before shares and statistics are judged */

/* Bit and index of a rule.  The numbers go over the wire: never change one, only add. */
typedef enum imucal_health_rule {
  IMUCAL_HEALTH_NO_NOISE = 0,
  IMUCAL_HEALTH_REPEATED = 1,
  IMUCAL_HEALTH_SATURATED = 2,
  IMUCAL_HEALTH_FAULTY = 3,
  IMUCAL_HEALTH_TEMP_STUCK = 4,
  IMUCAL_HEALTH_TEMP_JUMP = 5,
  IMUCAL_HEALTH_TEMP_SPIKES = 6,
  IMUCAL_HEALTH_TEMP_RAMP = 7,
  IMUCAL_HEALTH_SPAN = 8,
  IMUCAL_HEALTH_NIS = 9,
  IMUCAL_HEALTH_LAG1 = 10,
  IMUCAL_HEALTH_SLOW = 11,
  IMUCAL_HEALTH_REJECTS = 12,
  IMUCAL_HEALTH_N_RULES
} imucal_health_rule_t;

/* What is expected; 0 where it is not known (then rules that need it are not judged). */
typedef struct imucal_health_config {
  float r;                /* white variance of a 1-s mean, unit^2 (the filter's r), 0..1e14 */
  float markov_variance;  /* stationary, unit^2, 0..1e14 */
  float lo_degc, hi_degc; /* span the table is wanted for, -3000..3000; hi <= lo: not known */
  bool is_ungated;        /* the gate only counts: to see all of a log that contradicts its model */
  float temp_step_degc;   /* quantum of the thermometer, 0..100 */
} imucal_health_config_t;

/* Readable by anybody, written only by the functions below. */
typedef struct imucal_health {
  imucal_health_config_t config;
  uint32_t n;      /* seconds given */
  uint32_t n_used; /* of them usable: second() returned true */
  uint32_t n_saturated, n_faulty;
  uint32_t n_rejected; /* left out by the gate */
  uint32_t n_spikes;   /* seconds whose temperature was left out */
  uint32_t n_jumps;    /* changes of level */
  /* the rate */
  float last_rate;           /* unit of the channel */
  uint32_t run, longest_run; /* of equal means, seconds */
  float step2, step2_block;  /* sum of squared steps, unit^2; of the running block */
  uint32_t n_steps;
  bool has_last;
  /* the temperature */
  float temp, candidate, ramp_from; /* degC: last good reading; of another level; where the running 64 s began */
  uint32_t since_s;                 /* since the last good reading */
  uint32_t n_level;                 /* good readings of this level, up to IMUCAL_HEALTH_LEVEL_N */
  uint32_t n_candidate, ramp_s;
  float worst_ramp; /* degC in 64 s */
  bool has_temp;
  /* temperatures seen, each for at least 8 seconds */
  float seen_lo, seen_hi, block_lo, block_hi; /* degC */
  uint32_t n_block;
  bool has_seen;
  /* the rate while the temperature stands */
  float stand_temp;                         /* degC */
  float stand_first, stand_sum, worst_move; /* unit: first mean of 128 s, running sum, largest move from the first */
  uint32_t n_stand, n_stand_blocks;
  /* the innovations */
  uint32_t n_innovations, reject_run, n_gated;
  float nis, nis_block, lag1, lag1_block;   /* sums of nu^2/S, nu nu'/S; of the running block */
  float weighted_block, weight_block, slow; /* sum nu/S (1/unit) and 1/S (1/unit^2); slow: sum over finished blocks */
  uint32_t n_slow;
  float last_innovation; /* unit; 0: none just before */
  bool has_opened;       /* the gate opened after a minute of rejects */
} imucal_health_t;

typedef struct imucal_health_verdict {
  uint32_t bits;                      /* bit i: rule i speaks against the channel */
  uint32_t judged;                    /* bit i: rule i could be judged */
  float value[IMUCAL_HEALTH_N_RULES]; /* its figure */
  float limit[IMUCAL_HEALTH_N_RULES]; /* the limit it was compared with (of two the nearer one) */
} imucal_health_verdict_t;

/* Start.  IMUCAL_ERR_ARGUMENT (null), IMUCAL_ERR_MODEL (r, variance), IMUCAL_ERR_SPAN (lo, hi, step):
 * refused, *health unchanged. */
IMUCAL_MUST_USE imucal_status imucal_health_init(imucal_health_t* health, const imucal_health_config_t* config);

/* One second.  rate, temp_degc: its means; flags: IMUCAL_FLAG_* (sum.h); is_measured: false where there is no
 * usable mean (gap, missing value); n_skipped: whole seconds without any sample before it. Returns true where
 * a filter may learn from it: measured, finite, not saturated, no fault, temperature plausible. */
bool imucal_health_second(imucal_health_t* health, float rate, float temp_degc, uint32_t flags, bool is_measured,
                          uint32_t n_skipped);

/* The filter's innovation of the second just given, and 1/S.  Returns true where it may be learnt; false:
 * leave it out (the filter as it was before, imucal_kf_skip). */
bool imucal_health_gate(imucal_health_t* health, float innovation, float weight);

/* The power was cycled, or another log begins: nothing is compared with the seconds before.  Counts and sums
 * stay. */
void imucal_health_new_run(imucal_health_t* health);

/* Judge what was seen so far. */
void imucal_health_judge(const imucal_health_t* health, imucal_health_verdict_t* verdict);

/* How many times the filter's predicted error is too small, by the innovations over blocks of 256 s; 1 or
 * more.  A lower bound where the noise is slower than that. */
float imucal_health_error_factor(const imucal_health_t* health);

/* Temperatures seen, each bound for at least 8 seconds together: one bad second does not widen it.  False:
 * none yet. */
bool imucal_health_span(const imucal_health_t* health, float* lo_degc, float* hi_degc);

/* "no-noise", "temp-stuck", …: the names of --accept; never null. */
const char* imucal_health_rule_name(uint32_t rule);

#if defined(__cplusplus)
}
#endif
#endif
