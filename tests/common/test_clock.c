// SPDX-License-Identifier: MIT
// clock: one wrong stamp, a clock that is set, a clock that wraps; what each costs and that it is counted.
#include "unit.h"

#include "clock.h"

#define PERIOD_US 10000u
#define HOUR_US 3600000000u

static imucal_clock_t timing;
static uint64_t newest_us; /* continuous, of the last sample taken */
static uint32_t n_taken, n_lost;

static int start(void** state) {
  (void)state;
  imucal_clock_init(&timing);
  newest_us = n_taken = n_lost = 0;
  return 0;
}

/* One stamp; the continuous time must never run backwards. */
static bool put(uint64_t stamp_us) {
  uint64_t t_us = UINT64_MAX;
  if (!imucal_clock_take(&timing, stamp_us, &t_us)) {
    assert_true(t_us == UINT64_MAX);
    n_lost++;
    return false;
  }
  if (timing.has_released) {
    assert_true(timing.released_us >= newest_us && timing.released_us < t_us);
    n_lost--;
    n_taken++;
  }
  assert_true(n_taken == 0 || t_us >= newest_us);
  newest_us = t_us;
  n_taken++;
  return true;
}

/* n samples from `from_us` on, 100 a second; the stamp behind the last. */
static uint64_t put_run(uint64_t from_us, uint32_t n) {
  for (uint32_t i = 0; i < n; i++, from_us += PERIOD_US) (void)put(from_us);
  return from_us;
}

static void test_take_good_stamps_pass_unchanged(void** state) {
  (void)state;
  put_run(123456789, 1000);
  assert_int_equal(n_lost, 0);
  assert_true(newest_us == 123456789 + 999u * PERIOD_US);
  assert_int_equal(timing.n_ahead + timing.n_behind + timing.n_set + timing.n_wrapped, 0);
}

static void test_take_equal_stamp_passes_for_sum_to_count(void** state) {
  (void)state;
  assert_true(put(5000000) && put(5000000) && put(5010000));
}

static void test_take_one_stamp_an_hour_ahead_costs_that_sample(void** state) {
  (void)state;
  const uint64_t next_us = put_run(1000000, 500);
  assert_false(put(next_us + HOUR_US));
  put_run(next_us + PERIOD_US, 500);
  assert_int_equal(n_lost, 1);
  assert_int_equal(timing.n_ahead, 1);
  assert_true(newest_us == next_us + 500u * PERIOD_US);
}

static void test_take_one_stamp_behind_costs_that_sample(void** state) {
  (void)state;
  const uint64_t next_us = put_run(HOUR_US, 500);
  assert_false(put(17));
  put_run(next_us + PERIOD_US, 500);
  assert_int_equal(n_lost, 1);
  assert_int_equal(timing.n_behind, 1);
}

/* It looks like the next sample, so it is taken; the true ones wait behind it, and the time is theirs. */
static void test_take_one_stamp_a_little_ahead_costs_until_the_clock_has_caught_up(void** state) {
  (void)state;
  for (uint64_t ahead_us = PERIOD_US; ahead_us <= IMUCAL_CLOCK_MAX_STEP_US; ahead_us += 90000) {
    start(state);
    const uint64_t next_us = put_run(1000000, 500);
    assert_true(put(next_us + ahead_us - PERIOD_US));
    put_run(next_us + PERIOD_US, 1000);
    assert_in_range(n_lost, 0, ahead_us / PERIOD_US);
    assert_int_equal(timing.n_behind + timing.n_ahead, n_lost);
    assert_int_equal(timing.n_set, 0);
    assert_true(newest_us == next_us + 1000u * PERIOD_US);
  }
}

static void test_take_one_stamp_ahead_a_minute_leaves_the_time_right(void** state) {
  (void)state;
  uint64_t t_us = 1000000;
  for (uint32_t minute = 0; minute < 60; minute++) {
    t_us = put_run(t_us, 5999);
    assert_true(put(t_us + 1900000));
    t_us += PERIOD_US;
  }
  t_us = put_run(t_us, 5999);
  assert_int_equal(timing.n_set, 0);
  assert_in_range(n_lost, 60, 60 * 190);
  assert_true(newest_us == t_us - PERIOD_US);
}

/* The stamp that ends a gap or makes a set clock sure may be the wrong one too. */
static void test_take_first_stamp_after_a_gap_or_a_set_ahead_leaves_the_time_right(void** state) {
  (void)state;
  uint64_t next_us = put_run(1000000, 500) + 60000000;
  assert_false(put(next_us));
  assert_true(put(next_us + PERIOD_US + 1500000)); /* agrees, and is wrong */
  put_run(next_us + 2 * PERIOD_US, 500);
  assert_true(newest_us == next_us + 501u * PERIOD_US);
  assert_int_equal(timing.n_set, 0);
  start(state);
  const uint64_t last_us = put_run(HOUR_US, 500) - PERIOD_US;
  next_us = put_run(3000000, 100);
  assert_true(put(next_us + 1500000)); /* the clock was set back: sure now */
  put_run(next_us + PERIOD_US, 500);
  assert_int_equal(timing.n_set, 1);
  assert_true(newest_us == last_us + 600u * PERIOD_US);
}

/* Set back by less than a second it has caught up before it is sure; by more it was set, also where one wrong stamp might
 * have been as far ahead. */
static void test_take_clock_set_back_a_little(void** state) {
  (void)state;
  uint64_t next_us = put_run(1000000, 500);
  put_run(next_us - 995000, 500);
  assert_int_equal(n_lost, 99);
  assert_int_equal(timing.n_set, 0);
  start(state);
  next_us = put_run(1000000, 500);
  put_run(next_us - 1500000, 500);
  assert_int_equal(timing.n_set, 1);
  assert_int_equal(n_lost, 100);
}

static void test_take_every_hundredth_stamp_wrong_costs_these(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  uint64_t t_us = 2u * (uint64_t)HOUR_US;
  for (uint32_t i = 0; i < 10000; i++, t_us += PERIOD_US) {
    const bool is_wrong = i % 100 == 50;
    put(is_wrong ? unit_bits(&rng) % HOUR_US : t_us);
  }
  assert_int_equal(n_lost, 100);
  assert_true(newest_us == t_us - PERIOD_US);
}

static void test_take_gap_costs_nothing(void** state) {
  (void)state;
  const uint64_t next_us = put_run(1000000, 500);
  put_run(next_us + 60000000, 500);
  assert_int_equal(n_lost, 0);
  assert_int_equal(timing.n_ahead, 0);
  assert_true(newest_us == next_us + 60000000 + 499u * PERIOD_US);
}

static void test_take_clock_set_forward_is_followed(void** state) {
  (void)state;
  put_run(1000000, 500);
  put_run(1700000000000000u, 500);
  assert_int_equal(n_lost, 0);
  assert_true(newest_us == 1700000000000000u + 499u * PERIOD_US);
}

static void test_take_clock_set_back_goes_on_with_a_gap_of_a_second(void** state) {
  (void)state;
  const uint64_t last_us = put_run(2u * (uint64_t)HOUR_US, 500) - PERIOD_US;
  put_run(3000000, 600);
  assert_int_equal(timing.n_set, 1);
  assert_int_equal(n_lost, 100); /* the second that made it sure */
  assert_int_equal(timing.n_behind, 100);
  assert_true(newest_us == last_us + 599u * PERIOD_US); /* no time is lost, and none is invented */
}

static void test_take_forgotten_sample_is_not_released(void** state) {
  (void)state;
  const uint64_t next_us = put_run(1000000, 500);
  assert_false(put(next_us + 60000000));
  imucal_clock_forget_doubted(&timing);
  assert_false(put(next_us + 60010000));
  assert_true(put(next_us + 60020000));
  assert_true(timing.released_us == next_us + 60010000);
  assert_int_equal(timing.n_ahead, 1);
}

static void test_take_late_burst_shorter_than_a_second_is_left_out(void** state) {
  (void)state;
  const uint64_t next_us = put_run(1000000, 500);
  put_run(1000000, 90);
  put_run(next_us, 500);
  assert_int_equal(n_lost, 90);
  assert_int_equal(timing.n_set, 0);
  assert_true(newest_us == next_us + 499u * PERIOD_US);
}

static void test_take_32_bit_clocks_wrap_without_loss(void** state) {
  (void)state;
  const uint64_t width_us[2] = {1ull << 32, 1000ull << 32};
  for (int k = 0; k < 2; k++) {
    start(state);
    uint64_t t_us = width_us[k] - 123u * PERIOD_US - 77;
    const uint64_t first_us = t_us;
    for (uint32_t i = 0; i < 1000; i++, t_us += PERIOD_US) put(t_us % width_us[k]);
    assert_int_equal(n_lost, 0);
    assert_int_equal(timing.n_wrapped, 1);
    assert_true(newest_us == first_us + 999u * PERIOD_US);
  }
}

static void test_take_wraps_again_and_again(void** state) {
  (void)state;
  const uint32_t n = 20000; /* 1 s apart: 4.6 wraps */
  for (uint64_t i = 1; i <= n; i++) put(i * 1000000u % (1ull << 32));
  assert_int_equal(n_lost, 0);
  assert_int_equal(timing.n_wrapped, 4);
  assert_true(newest_us == n * 1000000ull);
}

static void test_take_extreme_stamps_do_no_harm(void** state) {
  (void)state;
  const uint64_t stamps[] = {0, UINT64_MAX, 0, UINT64_MAX - 1, UINT64_MAX, 1, 1ull << 63, (1ull << 63) + 5, 2, 3};
  uint64_t t_us;
  for (size_t i = 0; i < sizeof stamps / sizeof *stamps; i++) (void)imucal_clock_take(&timing, stamps[i], &t_us);
  assert_true(timing.n_ahead + timing.n_behind <= 9);
}

static void test_init_leaves_nothing_of_before(void** state) {
  (void)state;
  const imucal_clock_t fresh = {0};
  memset(&timing, 0xA5, sizeof timing);
  imucal_clock_init(&timing);
  assert_int_equal(timing.last_us, fresh.last_us);
  assert_int_equal(timing.before_us, fresh.before_us);
  assert_int_equal(timing.offset_us, fresh.offset_us);
  assert_int_equal(timing.first_us, fresh.first_us);
  assert_int_equal(timing.candidate_us, fresh.candidate_us);
  assert_int_equal(timing.n_ahead + timing.n_behind + timing.n_set + timing.n_wrapped, 0);
  assert_false(timing.has_last || timing.has_candidate || timing.has_released);
}

/* Another stream: its first stamp passes as it is, whatever came before; the counts stay. */
static void test_restart_compares_nothing_with_before(void** state) {
  (void)state;
  put_run(HOUR_US, 100);
  put_run(1000000, 600); /* set back: the offset is an hour now */
  assert_int_equal(timing.n_set, 1);
  assert_true(timing.offset_us > 3000000000u);
  assert_false(put(2 * (uint64_t)HOUR_US)); /* a doubted one waits */
  const uint32_t n_behind = timing.n_behind;
  imucal_clock_restart(&timing);
  newest_us = n_taken = 0;
  assert_true(put(2 * (uint64_t)HOUR_US + PERIOD_US));
  assert_false(timing.has_released); /* the doubted one was of the other stream */
  assert_true(newest_us == 2 * (uint64_t)HOUR_US + PERIOD_US);
  assert_int_equal(timing.n_set, 1);
  assert_int_equal(timing.n_behind, n_behind);
  imucal_clock_restart(&timing);
  newest_us = n_taken = 0;
  assert_true(put(17)); /* far behind: passes too */
  assert_true(newest_us == 17);
}

/* Stamps that go on where the stream before it ended are no sign that this one's first stamp was wrong. */
static void test_restart_forgets_the_stamps_before(void** state) {
  (void)state;
  const uint64_t next_us = put_run(1000000, 100);
  imucal_clock_restart(&timing);
  newest_us = n_taken = 0;
  assert_true(put(HOUR_US));
  put_run(next_us, 200); /* set back */
  assert_int_equal(timing.n_set, 1);
}

static void test_take_step_of_two_seconds_is_a_neighbour_one_more_is_not(void** state) {
  (void)state;
  assert_true(put(1000000));
  assert_true(put(1000000 + IMUCAL_CLOCK_MAX_STEP_US));
  assert_int_equal(timing.n_ahead, 0);
  assert_false(put(1000000 + 2 * IMUCAL_CLOCK_MAX_STEP_US + 1));
  assert_int_equal(timing.n_ahead, 1);
}

/* Doubted stamps agree where the clock runs between them: a stuck one proves nothing. */
static void test_take_doubted_equal_stamps_do_not_agree(void** state) {
  (void)state;
  const uint64_t next_us = put_run(1000000, 10);
  for (uint32_t i = 0; i < 5; i++) assert_false(put(next_us + HOUR_US));
  assert_int_equal(timing.n_ahead, 5);
  assert_true(put(next_us + HOUR_US + 1));
  assert_int_equal(timing.n_ahead, 4); /* one of them is given back */
}

/* Two wrong stamps that agree, with a good one between: each costs itself. */
static void test_take_good_stamp_between_makes_doubted_ones_start_anew(void** state) {
  (void)state;
  const uint64_t next_us = put_run(1000000, 10);
  assert_false(put(next_us + HOUR_US));
  assert_true(put(next_us));
  assert_false(put(next_us + HOUR_US + PERIOD_US));
  assert_true(put(next_us + PERIOD_US));
  assert_int_equal(timing.n_ahead, 2);
}

static void test_take_released_sample_has_the_continuous_time(void** state) {
  (void)state;
  put_run(HOUR_US, 100);
  const uint64_t next_us = put_run(1000000, 600); /* set back: raw and continuous time differ */
  const uint64_t offset_us = timing.offset_us;
  assert_true(offset_us != 0);
  assert_false(put(next_us + 60000000));
  assert_true(put(next_us + 60010000));
  assert_true(timing.has_released && timing.released_us == next_us + 60000000 + offset_us);
}

/* Only a clock that was within its width wraps: 2^32 us is one count too many for 32 bits. */
static void test_take_clock_at_its_width_does_not_wrap(void** state) {
  (void)state;
  for (uint64_t last_us = (1ull << 32) - 1; last_us <= 1ull << 32; last_us++) {
    start(state);
    assert_true(put(last_us));
    assert_int_equal(put(5), last_us == (1ull << 32) - 1);
    assert_int_equal(timing.n_wrapped, last_us == (1ull << 32) - 1);
  }
}

#define TEST(name) cmocka_unit_test_setup(name, start)
int main(void) {
  const struct CMUnitTest tests[] = {
      TEST(test_take_good_stamps_pass_unchanged),
      TEST(test_take_equal_stamp_passes_for_sum_to_count),
      TEST(test_take_one_stamp_an_hour_ahead_costs_that_sample),
      TEST(test_take_one_stamp_behind_costs_that_sample),
      TEST(test_take_one_stamp_a_little_ahead_costs_until_the_clock_has_caught_up),
      TEST(test_take_one_stamp_ahead_a_minute_leaves_the_time_right),
      TEST(test_take_first_stamp_after_a_gap_or_a_set_ahead_leaves_the_time_right),
      TEST(test_take_clock_set_back_a_little),
      TEST(test_take_every_hundredth_stamp_wrong_costs_these),
      TEST(test_take_gap_costs_nothing),
      TEST(test_take_clock_set_forward_is_followed),
      TEST(test_take_clock_set_back_goes_on_with_a_gap_of_a_second),
      TEST(test_take_forgotten_sample_is_not_released),
      TEST(test_take_late_burst_shorter_than_a_second_is_left_out),
      TEST(test_take_32_bit_clocks_wrap_without_loss),
      TEST(test_take_wraps_again_and_again),
      TEST(test_take_extreme_stamps_do_no_harm),
      TEST(test_init_leaves_nothing_of_before),
      TEST(test_restart_compares_nothing_with_before),
      TEST(test_restart_forgets_the_stamps_before),
      TEST(test_take_step_of_two_seconds_is_a_neighbour_one_more_is_not),
      TEST(test_take_doubted_equal_stamps_do_not_agree),
      TEST(test_take_good_stamp_between_makes_doubted_ones_start_anew),
      TEST(test_take_released_sample_has_the_continuous_time),
      TEST(test_take_clock_at_its_width_does_not_wrap),
  };
  return cmocka_run_group_tests_name("clock", tests, NULL, NULL);
}
