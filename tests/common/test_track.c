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

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_track_ramp_is_followed),
      cmocka_unit_test(test_track_soak_gives_the_middle),
      cmocka_unit_test(test_track_reversal_forgets_the_rate),
      cmocka_unit_test(test_track_says_when_it_is_sure),
      cmocka_unit_test(test_track_gap_keeps_the_time),
      cmocka_unit_test(test_track_never_leaves_the_reading),
      cmocka_unit_test(test_track_extreme_counts_are_handed_back),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
