// SPDX-License-Identifier: MIT
#include "track.h"

#define ONE_Q16 65536
#define HALF_Q16 32768
/* A mean this far from a whole count comes from samples on both sides of an edge. */
#define ON_EDGE_Q16 2048
/* The reading changes when the mean is a quarter of a count beyond the edge: noise must not send it to and
 * fro. */
#define HYSTERESIS_Q16 16384
#define LARGEST_Q16 ((int64_t)1 << 46)

void imucal_track_init(imucal_track_t* track) {
  *track = (imucal_track_t){0};
}

void imucal_track_skip(imucal_track_t* track, uint32_t n_s) {
  track->since_s = n_s > UINT32_MAX - track->since_s ? UINT32_MAX : track->since_s + n_s;
}

/* Nearest whole count, ties upwards.  Pre: |mean| <= 2^46. */
static int32_t nearest(int64_t mean_q16) {
  int64_t up = mean_q16 + HALF_Q16;
  return (int32_t)(up >= 0 ? up / ONE_Q16 : -((-up + ONE_Q16 - 1) / ONE_Q16));
}

static void forget_rate(imucal_track_t* track) {
  track->rate_q16 = 0;
  track->interval_s = 0;
}

/* The reading went one count up or down: a point of known temperature. */
static void pass_edge(imucal_track_t* track, int32_t level) {
  int8_t direction = level > track->level ? 1 : -1;
  uint32_t taken_s = track->since_s - track->beyond_s;
  bool is_same_way = direction == track->direction;
  /* Twice the time of the step before: it held a soak, and tells nothing of the rate now. */
  bool is_steady = track->interval_s == 0 || taken_s / 2 <= track->interval_s;
  track->edge_q16 = ((int64_t)track->level + level) * HALF_Q16;
  if (is_same_way && is_steady) {
    track->interval_s = taken_s; /* at least 1: every second counts in since_s, and in beyond_s from the next one on */
    track->rate_q16 = direction * (int32_t)(ONE_Q16 / taken_s);
    track->is_rate_awaited = false;
  } else {
    forget_rate(track);
    track->is_rate_awaited = true;
  }
  track->direction = direction;
  track->level = level;
  track->since_s = track->beyond_s;
  track->beyond_s = 0;
}

/* Standing, or moving at a rate not known yet. */
static int64_t estimate_without_rate(imucal_track_t* track, int64_t mean_q16) {
  int64_t middle = (int64_t)track->level * ONE_Q16;
  int64_t off = mean_q16 - middle;
  track->is_sure = true;
  if (off > ON_EDGE_Q16) return middle + HALF_Q16;
  if (off < -ON_EDGE_Q16) return middle - HALF_Q16;
  track->is_sure = !track->is_rate_awaited || track->since_s > IMUCAL_TRACK_UNSURE_S;
  return middle;
}

/* Where the temperature is inside the bin of the reading. */
static int64_t estimate(imucal_track_t* track, int64_t mean_q16) {
  if (track->rate_q16 == 0) return estimate_without_rate(track, mean_q16);
  if (track->since_s > track->interval_s + track->interval_s / 8) { /* overdue: the ramp has ended */
    track->rate_q16 = 0;
    return estimate_without_rate(track, mean_q16);
  }
  int64_t middle = (int64_t)track->level * ONE_Q16;
  int64_t at = track->edge_q16 + (int64_t)track->rate_q16 * track->since_s;
  track->is_sure = track->since_s <= track->interval_s;
  if (at > middle + HALF_Q16) return middle + HALF_Q16;
  if (at < middle - HALF_Q16) return middle - HALF_Q16;
  return at;
}

int64_t imucal_track_update(imucal_track_t* track, int64_t mean_q16) {
  if (mean_q16 > LARGEST_Q16 || mean_q16 < -LARGEST_Q16) return mean_q16;
  imucal_track_skip(track, 1);
  int32_t level = nearest(mean_q16);
  int64_t off = mean_q16 - (int64_t)track->level * ONE_Q16;
  bool is_beyond = off > HALF_Q16 || off < -HALF_Q16;
  bool is_clear = off > HALF_Q16 + HYSTERESIS_Q16 || off < -(HALF_Q16 + HYSTERESIS_Q16);
  if (track->has_level && !is_clear) level = track->level;
  int64_t step = (int64_t)level - track->level;
  if (!track->has_level || step > 1 || step < -1) { /* first reading, or too fast for steps to tell anything */
    *track = (imucal_track_t){.level = level, .has_level = true, .is_sure = true};
    return mean_q16;
  }
  if (step != 0)
    pass_edge(track, level);
  else
    track->beyond_s = is_beyond ? track->beyond_s + 1 : 0;
  return estimate(track, mean_q16);
}
