// SPDX-License-Identifier: MIT
/* The temperature between the steps of a coarse thermometer: ramps followed, soaks in the middle, nothing
 * lost. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "track.h"

#define COUNT 65536

/* A second's mean of 100 readings of a thermometer in whole counts, with noise of 0.02 counts (a fixed
 * pattern). */
static int64_t reading(double temp) {
  int64_t sum = 0;
  for (int i = 0; i < 100; i++) {
    double noise = 0.02 * sqrt(3.0) * (2.0 * ((i * 61) % 100 + 0.5) / 100.0 - 1.0);
    sum += (int64_t)floor(temp + noise + 0.5);
  }
  return sum * COUNT / 100;
}

static double track_to(imucal_track_t* track, double temp) {
  return (double)imucal_track_update(track, reading(temp)) / COUNT;
}

/* GIVEN a ramp of 0.01 counts per second, up or down; WHEN two steps were seen; THEN the error is that of the
 * timing: a second of 100, twice, over one step. */
static void test_track_ramp_is_followed(void** state) {
  (void)state;
  for (int way = -1; way <= 1; way += 2) {
    imucal_track_t track;
    imucal_track_init(&track);
    double worst = 0;
    for (int k = 0; k < 3000; k++) {
      double temp = way * (0.2 + 0.01 * k);
      double error = fabs(track_to(&track, temp) - temp);
      if (k > 140 && error > worst) worst = error;
    }
    if (worst > 0.035) fail_msg("way %d: %.3f counts", way, worst);
  }
}

static void test_track_soak_gives_the_middle(void** state) {
  (void)state;
  imucal_track_t track;
  imucal_track_init(&track);
  double last = 0;
  for (int k = 0; k < 1000; k++) last = track_to(&track, 10.3 + 0.01 * k); /* stops at 20.3 */
  for (int k = 0; k < 200; k++) last = track_to(&track, 20.3);
  assert_true(last == 20.0);
  /* The first step after the soak says nothing of the rate; the second does. */
  double worst = 0;
  for (int k = 0; k < 1000; k++) {
    double temp = 20.3 + 0.005 * k, error = fabs(track_to(&track, temp) - temp);
    if (k > 250 && error > worst) worst = error;
  }
  assert_true(worst < 0.02);
}

static void test_track_reversal_forgets_the_rate(void** state) {
  (void)state;
  imucal_track_t track;
  imucal_track_init(&track);
  double temp = 0;
  for (int k = 0; k < 1000; k++) track_to(&track, temp += 0.01);
  for (int k = 0; k < 1000; k++) {
    double found = track_to(&track, temp -= 0.01);
    assert_true(fabs(found - temp) < 1.03); /* in the bin of the reading all the while */
    if (k > 250) assert_true(fabs(found - temp) < 0.035);
  }
}

/* GIVEN a soak and a ramp; THEN the soak is sure, the bin after the first step is not, the next ones are; a
 * step that stays alone is a soak after a while. */
static void test_track_says_when_it_is_sure(void** state) {
  (void)state;
  imucal_track_t track;
  imucal_track_init(&track);
  for (int k = 0; k < 500; k++) {
    track_to(&track, 10.0);
    assert_true(track.is_sure);
  }
  int n_unsure = 0;
  for (int k = 0; k < 550; k++) {
    double temp = 10.0 + 0.01 * k, found = track_to(&track, temp);
    if (!track.is_sure)
      n_unsure++;
    else if (k > 60)
      assert_true(fabs(found - temp) < 0.06);
  }
  assert_in_range(n_unsure, 80, 102);
  for (int k = 0; k < 400; k++) track_to(&track, 15.49);
  assert_true(track.is_sure);
  for (int k = 0; k < 301; k++) {
    track_to(&track, 14.4);
    if (k > 5 && k < 299) assert_false(track.is_sure);
  }
  track_to(&track, 14.4);
  assert_true(track.is_sure);
}

static void test_track_gap_keeps_the_time(void** state) {
  (void)state;
  imucal_track_t track;
  imucal_track_init(&track);
  double temp = 0.2;
  for (int k = 0; k < 500; k++) track_to(&track, temp += 0.01);
  temp += 0.25;
  imucal_track_skip(&track, 25);
  for (int k = 0; k < 500; k++) {
    temp += 0.01;
    assert_true(fabs(track_to(&track, temp) - temp) < 0.035);
  }
}

/* The estimate stays within 1 1/4 counts of the mean, whatever comes. */
static void test_track_never_leaves_the_reading(void** state) {
  (void)state;
  imucal_track_t track;
  imucal_track_init(&track);
  uint64_t random = 1;
  int64_t mean = 0;
  for (int k = 0; k < 1000000; k++) {
    random = random * 6364136223846793005u + 1442695040888963407u;
    if ((random >> 60) == 0)
      mean += (int64_t)(random >> 20) % 1000000 - 500000;
    else
      mean += (int64_t)(random >> 40) % 4001 - 2000;
    int64_t found = imucal_track_update(&track, mean);
    if (found - mean > COUNT * 5 / 4 || mean - found > COUNT * 5 / 4)
      fail_msg("step %d: %lld for %lld", k, (long long)found, (long long)mean);
    if ((random >> 50) % 1000 == 0) imucal_track_skip(&track, (uint32_t)random);
  }
}

static void test_track_extreme_counts_are_handed_back(void** state) {
  (void)state;
  imucal_track_t track;
  imucal_track_init(&track);
  const int64_t large = (int64_t)1 << 47;
  assert_true(imucal_track_update(&track, large) == large);
  assert_true(imucal_track_update(&track, -large) == -large);
  assert_true(imucal_track_update(&track, large / 2) == large / 2);
  assert_true(imucal_track_update(&track, -large / 2) == -large / 2);
}

static void test_track_limit_of_the_counts(void** state) {
  (void)state;
  const int64_t largest = (int64_t)1 << 46;
  for (int sign = -1; sign <= 1; sign += 2) {
    imucal_track_t track;
    imucal_track_init(&track);
    assert_true(imucal_track_update(&track, sign * (largest + 1)) == sign * (largest + 1));
    assert_false(track.has_level);
    assert_true(imucal_track_update(&track, sign * largest) == sign * largest);
    assert_true(track.has_level);
    assert_true((int64_t)track.level * COUNT == sign * largest);
  }
}

static void test_track_skip_stops_at_the_largest_time(void** state) {
  (void)state;
  imucal_track_t track;
  imucal_track_init(&track);
  imucal_track_skip(&track, 5);
  imucal_track_skip(&track, UINT32_MAX - 5u);
  assert_int_equal(track.since_s, UINT32_MAX);
  imucal_track_skip(&track, 1);
  assert_int_equal(track.since_s, UINT32_MAX);
  imucal_track_init(&track);
  assert_int_equal(track.since_s, 0);
}

/* The method of track.h once more, told by points in time instead of counters. */
typedef struct {
  int64_t now_s, level, edge_q16, point_s, interval_s, beyond;
  int direction, has_rate, is_awaited, has_level, is_sure;
} model_t;

static int64_t floor_of(int64_t value, int64_t by) {
  return value >= 0 ? value / by : -((by - 1 - value) / by);
}

static int64_t model_in_bin(model_t* m, int64_t mean) {
  const int64_t middle = m->level * COUNT, off = mean - middle;
  const int64_t age_s = m->now_s - m->point_s;
  if (m->has_rate && age_s > m->interval_s + m->interval_s / 8) m->has_rate = 0;
  if (m->has_rate) {
    int64_t at = m->edge_q16 + m->direction * (COUNT / m->interval_s) * age_s;
    m->is_sure = age_s <= m->interval_s;
    return at > middle + COUNT / 2 ? middle + COUNT / 2 : at < middle - COUNT / 2 ? middle - COUNT / 2 : at;
  }
  m->is_sure = 1;
  if (off > COUNT / 32 || off < -COUNT / 32) return middle + (off > 0 ? COUNT / 2 : -COUNT / 2);
  m->is_sure = !m->is_awaited || age_s > IMUCAL_TRACK_UNSURE_S;
  return middle;
}

static int64_t model_update(model_t* m, int64_t mean) {
  m->now_s++;
  const int64_t off = mean - m->level * COUNT, reading = floor_of(mean + COUNT / 2, COUNT);
  const int is_clear = 4 * llabs(off) > 3 * COUNT;
  if (!m->has_level || (is_clear && llabs(reading - m->level) > 1)) {
    *m = (model_t){.now_s = m->now_s, .point_s = m->now_s, .level = reading, .has_level = 1, .is_sure = 1};
    return mean;
  }
  if (!is_clear) {
    m->beyond = 2 * llabs(off) > COUNT ? m->beyond + 1 : 0;
    return model_in_bin(m, mean);
  }
  const int direction = reading > m->level ? 1 : -1;
  const int64_t taken_s = m->now_s - m->beyond - m->point_s;
  m->has_rate = direction == m->direction && (m->interval_s == 0 || taken_s < 2 * m->interval_s + 2);
  m->is_awaited = !m->has_rate;
  m->interval_s = m->has_rate ? taken_s : 0;
  if (m->has_rate && taken_s > COUNT) m->has_rate = 0; /* slower than the unit of the rate */
  m->edge_q16 = (m->level + reading) * COUNT / 2;
  m->direction = direction;
  m->level = reading;
  m->point_s = m->now_s - m->beyond;
  m->beyond = 0;
  return model_in_bin(m, mean);
}

static uint64_t next_random(uint64_t* random) {
  *random = *random * 6364136223846793005u + 1442695040888963407u;
  return *random >> 33;
}

/* Ramps, soaks and leaps whose means meet every limit of the method exactly, one beside it, and at random. */
static void test_track_follows_the_model_at_every_limit(void** state) {
  (void)state;
  const int64_t limits[] = {0, COUNT / 32, COUNT / 2, 3 * COUNT / 4, COUNT, 3 * COUNT / 2, 7 * COUNT / 4, 2 * COUNT};
  uint64_t random = 1;
  for (int run = 0; run < 1000; run++) {
    imucal_track_t track;
    model_t model = {0};
    imucal_track_init(&track);
    int64_t mean = (int64_t)(next_random(&random) % 11 - 5) * COUNT;
    for (int leg = 0; leg < 12; leg++) {
      const uint64_t kind = next_random(&random) % 8;
      const int64_t interval_s = 1 + (int64_t)(next_random(&random) % (kind == 0 ? 400 : 12));
      const int64_t slope = (next_random(&random) % 2 ? 1 : -1) * COUNT / interval_s;
      for (int t = 0; t < 3 * interval_s + 4; t++) {
        if (kind < 5) mean += slope; /* else: a soak */
        int64_t given = mean;
        if (kind >= 3 && next_random(&random) % 2) /* at a limit of the reading it has, or one beside it */
          given = model.level * COUNT + (next_random(&random) % 2 ? 1 : -1) * limits[next_random(&random) % 8] +
                  (int64_t)(next_random(&random) % 3) - 1;
        if (kind == 7) mean = given;
        if (next_random(&random) % 64 == 0) {
          const uint32_t n_s = (uint32_t)(next_random(&random) % (next_random(&random) % 2 ? 5 : 400));
          imucal_track_skip(&track, n_s);
          model.now_s += n_s;
        }
        const int64_t expected = model_update(&model, given), found = imucal_track_update(&track, given);
        if (found != expected || track.is_sure != model.is_sure)
          fail_msg("run %d, leg %d, second %d: mean %lld gives %lld, expected %lld; sure %d, expected %d", run, leg, t,
                   (long long)given, (long long)found, (long long)expected, track.is_sure, model.is_sure);
      }
    }
  }
}

/* A step may take longer than the rate's unit can say, and no longer. */
static void test_track_slowest_rate(void** state) {
  (void)state;
  for (uint32_t taken_s = COUNT - 1; taken_s <= COUNT + 1; taken_s++) {
    imucal_track_t track;
    imucal_track_init(&track);
    assert_true(imucal_track_update(&track, 0) == 0);
    assert_true(imucal_track_update(&track, COUNT) == COUNT);
    imucal_track_skip(&track, taken_s - 1);
    assert_true(imucal_track_update(&track, 2 * COUNT) == (taken_s > COUNT ? 2 * COUNT : COUNT * 3 / 2));
    assert_int_equal(track.rate_q16, taken_s > COUNT ? 0 : 1);
  }
}

static void test_init_forgets_everything(void** state) {
  (void)state;
  imucal_track_t track = {7, 7, 7, 7, 7, 7, 1, true, true, true};
  imucal_track_init(&track);
  assert_true(track.level == 0 && track.rate_q16 == 0 && track.edge_q16 == 0 && track.since_s == 0);
  assert_true(track.beyond_s == 0 && track.interval_s == 0 && track.direction == 0);
  assert_false(track.has_level || track.is_rate_awaited || track.is_sure);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_init_forgets_everything),
      cmocka_unit_test(test_track_ramp_is_followed),
      cmocka_unit_test(test_track_soak_gives_the_middle),
      cmocka_unit_test(test_track_reversal_forgets_the_rate),
      cmocka_unit_test(test_track_says_when_it_is_sure),
      cmocka_unit_test(test_track_gap_keeps_the_time),
      cmocka_unit_test(test_track_never_leaves_the_reading),
      cmocka_unit_test(test_track_extreme_counts_are_handed_back),
      cmocka_unit_test(test_track_limit_of_the_counts),
      cmocka_unit_test(test_track_skip_stops_at_the_largest_time),
      cmocka_unit_test(test_track_follows_the_model_at_every_limit),
      cmocka_unit_test(test_track_slowest_rate),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
