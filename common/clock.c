// SPDX-License-Identifier: MIT
#include "clock.h"

#define WRAP_US 4294967296u       /* a 32-bit count of us */
#define WRAP_MS_US 4294967296000u /* a 32-bit count of ms, in us */

void imucal_clock_init(imucal_clock_t* clock) {
  *clock = (imucal_clock_t){0};
}

void imucal_clock_restart(imucal_clock_t* clock) {
  clock->has_last = clock->has_candidate = clock->has_released = false;
  clock->offset_us = 0;
}

void imucal_clock_forget_doubted(imucal_clock_t* clock) {
  clock->has_candidate = false;
}

static bool is_neighbour(uint64_t from_us, uint64_t to_us) {
  return to_us > from_us && to_us - from_us <= IMUCAL_CLOCK_MAX_STEP_US;
}

/* Does `width_us` later make the stamp the next one?  Only of a clock that has been near its end. */
static bool is_wrapped(const imucal_clock_t* clock, uint64_t stamp_us, uint64_t width_us) {
  return clock->last_us < width_us && stamp_us < clock->last_us && is_neighbour(clock->last_us, stamp_us + width_us);
}

static bool is_sure(const imucal_clock_t* clock) {
  if (clock->candidate_us > clock->last_us) return true;
  /* They go on where the stamp before the last good one was: that last one was wrong, and they are about to pass it. */
  if (is_neighbour(clock->before_us, clock->first_us)) return false;
  return clock->candidate_us - clock->first_us >= IMUCAL_CLOCK_AGREEMENT_US;
}

/* The stamps since `first_us` are followed.  Ahead: the first of the two that agree was good.  Behind: what they lasted
 * has passed since the last good sample. */
static void follow(imucal_clock_t* clock) {
  if (clock->candidate_us > clock->last_us) {
    clock->released_us = clock->first_us + clock->offset_us;
    clock->has_released = true;
    clock->n_ahead--;
    return;
  }
  clock->offset_us += clock->last_us - clock->first_us;
  clock->n_set++;
}

/* A stamp that does not follow the last good one; true where it is followed all the same: the one before it, with which it
 * agrees, is the last good one then. */
static bool doubt(imucal_clock_t* clock, uint64_t stamp_us) {
  const uint64_t previous_us = clock->candidate_us;
  const bool agrees = clock->has_candidate && is_neighbour(previous_us, stamp_us);
  if (!agrees) clock->first_us = stamp_us;
  clock->candidate_us = stamp_us;
  clock->has_candidate = true;
  if (agrees && is_sure(clock)) {
    follow(clock);
    clock->last_us = previous_us;
    return true;
  }
  if (stamp_us > clock->last_us)
    clock->n_ahead++;
  else
    clock->n_behind++;
  return false;
}

bool imucal_clock_take(imucal_clock_t* clock, uint64_t stamp_us, uint64_t* t_us) {
  clock->has_released = false;
  if (clock->has_last && stamp_us != clock->last_us && !is_neighbour(clock->last_us, stamp_us)) {
    const uint64_t width_us = is_wrapped(clock, stamp_us, WRAP_US)      ? WRAP_US
                              : is_wrapped(clock, stamp_us, WRAP_MS_US) ? WRAP_MS_US
                                                                        : 0;
    if (width_us != 0) {
      clock->offset_us += width_us;
      clock->n_wrapped++;
    } else if (!doubt(clock, stamp_us)) {
      return false;
    }
  }
  if (!clock->has_last)
    clock->before_us = stamp_us;
  else if (stamp_us != clock->last_us)
    clock->before_us = clock->last_us;
  clock->last_us = stamp_us;
  clock->has_last = true;
  clock->has_candidate = false;
  *t_us = stamp_us + clock->offset_us;
  return true;
}
