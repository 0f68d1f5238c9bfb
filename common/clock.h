// SPDX-License-Identifier: MIT
/* Purpose: one continuous time out of the time stamps of a sensor whose clock has faults: single wrong stamps, a clock
 * that is set, a clock of 32 bits that wraps.
 * Data: the stamp of every sample in, in the order of arrival; the continuous time out, or "leave this sample out".
 * Order: init, then take for every sample.  Memory: sizeof(imucal_clock_t), no heap.  Time: bounded, a few 64-bit
 * operations.  Thread/ISR: one context per struct.
 *
 * Rules, by the step from the last good stamp (raw):
 *   0 .. 2 s ahead            the next sample; equal stamps go through too (sum.h counts duplicates)
 *   wrapped                   2^32 us or 2^32 ms less, but for a step of at most 2 s: the time goes on without loss
 *   anything else             left out and counted, until the stamps agree with each other (0 < step <= 2 s):
 *     ahead                     two of them: the samples between are missing, the time is theirs; the first of the two is
 *                               given back (released_us), so that a gap costs nothing
 *     behind                    for 1 s: the clock was set; the time goes on where it was, with a gap of that second
 *     behind, but next to the   the last good one was a wrong stamp: they are left out until they have passed it, for 2 s
 *     last good one but one     at most, and the time stays theirs
 * So one wrong stamp costs its own sample; one up to 2 s ahead, which looks like the next sample, costs what comes until the
 * clock has caught up.  Neither moves the time of the samples after it.  A clock that is set back by less than a second, or
 * by less than its last two steps, has caught up before it is sure: its time lacks what it was set back by. */
#ifndef IMUCAL_CLOCK_H
#define IMUCAL_CLOCK_H

#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_CLOCK_MAX_STEP_US 2000000u  /* between neighbours that agree */
#define IMUCAL_CLOCK_AGREEMENT_US 1000000u /* stamps behind that agree for so long: the clock was set */

/* Readable by anybody, written only by the functions below. */
typedef struct imucal_clock {
  uint64_t last_us;      /* raw stamp of the last good sample */
  uint64_t before_us;    /* and of the good one before it; the same where there is none */
  uint64_t offset_us;    /* continuous time = raw + offset, modulo 2^64 */
  uint64_t first_us;     /* of those that were left out and agree: the first */
  uint64_t candidate_us; /* and the newest */
  uint64_t released_us;  /* continuous time of the sample before, that was doubted and is good; where has_released */
  bool has_last, has_candidate;
  bool has_released;          /* by the last take: the caller, who kept the sample before, takes it first */
  uint32_t n_ahead, n_behind; /* samples left out */
  uint32_t n_set;             /* times the clock was set back */
  uint32_t n_wrapped;         /* times it began anew at 0 by its width */
} imucal_clock_t;

void imucal_clock_init(imucal_clock_t* clock);

/* Another stream of samples begins: nothing is compared with the stamps before; the counts stay. */
void imucal_clock_restart(imucal_clock_t* clock);

/* The caller no longer has the sample that was doubted last: it stays left out. */
void imucal_clock_forget_doubted(imucal_clock_t* clock);

/* stamp_us: of the sample.  True: *t_us is its continuous time, not before that of any sample taken so far; false: the
 * sample is to be left out (and kept until the next, which may release it), and is counted; *t_us unchanged. */
bool imucal_clock_take(imucal_clock_t* clock, uint64_t stamp_us, uint64_t* t_us);

#if defined(__cplusplus)
}
#endif
#endif
