// SPDX-License-Identifier: MIT
// sum: exactness against integers wide enough, the cut by time stamps, and everything odd that time can do.
#include "unit.h"

#include "sum.h"

static imucal_sample_t sample_at(uint64_t t_us, int32_t counts) {
  imucal_sample_t s = {.t_us = t_us, .temp_counts = counts / 2, .n_channels = 2};
  s.counts[0] = counts;
  s.counts[1] = -counts;
  return s;
}

static imucal_status add(imucal_sum_t* sum, uint64_t t_us, int32_t counts, imucal_second_t* second) {
  imucal_sample_t s = sample_at(t_us, counts);
  return imucal_sum_add(sum, &s, second);
}

static void start(imucal_sum_t* sum) {
  assert_int_equal(imucal_sum_init(sum, 2, 100), IMUCAL_OK);
}

static void test_init_refuses_nonsense(void** state) {
  (void)state;
  imucal_sum_t sum;
  assert_int_equal(imucal_sum_init(&sum, 0, 100), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_sum_init(&sum, 7, 100), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_sum_init(&sum, 1, 0), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_sum_init(&sum, 1, IMUCAL_SUM_MAX_RATE_HZ + 1), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_sum_init(NULL, 1, 100), IMUCAL_ERR_ARGUMENT);
}

static void test_add_second_is_cut_by_time_stamps(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  /* WHEN samples of second 7 (7000000 <= t < 8000000), then the first of second 8 */
  for (int i = 0; i < 100; i++) assert_int_equal(add(&sum, 7000000u + 10000u * (unsigned)i, 3, &second), IMUCAL_OK);
  assert_int_equal(add(&sum, 8000000, 1000, &second), IMUCAL_SECOND_READY);
  /* THEN it holds exactly these, ends at 8 s and has no flag */
  assert_int_equal(second.t_s, 8);
  assert_int_equal(second.n_samples, 100);
  assert_true(second.sum[0] == 300 && second.sum[1] == -300 && second.temp_sum == 100);
  assert_int_equal(second.flags[0] | second.flags[1], 0);
  assert_false(second.is_gap);
}

static void test_add_extreme_counts_sum_is_exact(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  unit_rng_t rng = {unit_seed()};
  assert_int_equal(imucal_sum_init(&sum, 6, 10000), IMUCAL_OK);
  for (int run = 0; run < 50; run++) {
    int64_t expected[6] = {0}, temp = 0; /* 10^4 times 2^31 */
    for (int i = 0; i < 10000; i++) {
      imucal_sample_t s = {.t_us = (uint64_t)run * 1000000u + 100u * (uint64_t)i, .n_channels = 6};
      s.temp_counts = run == 0 ? INT32_MAX : (int32_t)unit_bits(&rng);
      temp += s.temp_counts;
      for (int c = 0; c < 6; c++) {
        s.counts[c] = run == 0 ? INT32_MIN : (int32_t)unit_bits(&rng);
        expected[c] += s.counts[c];
      }
      imucal_status status = imucal_sum_add(&sum, &s, &second);
      assert_int_equal(status, i == 0 && run > 0 ? IMUCAL_SECOND_READY : IMUCAL_OK);
    }
    imucal_sum_t copy = sum;
    assert_int_equal(imucal_sum_flush(&copy, &second), IMUCAL_SECOND_READY);
    for (int c = 0; c < 6; c++) assert_true(second.sum[c] == expected[c]);
    assert_true(second.temp_sum == temp);
  }
}

static void test_add_any_phase_and_jitter_no_missing_flag(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (int run = 0; run < 20; run++) {
    imucal_sum_t sum;
    imucal_second_t second;
    start(&sum);
    double period_us = unit_between(&rng, 9900, 10100); /* a sample clock 1 % off */
    double phase_us = unit_between(&rng, 0, period_us);
    int n_seconds = 0;
    for (int i = 0; i < 1000; i++) {
      double t_us = phase_us + period_us * i + unit_between(&rng, -0.2, 0.2) * period_us + 3000;
      if (add(&sum, (uint64_t)t_us, 1, &second) != IMUCAL_SECOND_READY) continue;
      n_seconds++;
      assert_int_equal(second.flags[0], 0);
      assert_in_range(second.n_samples, 98, 102);
    }
    assert_in_range(n_seconds, 9, 10);
  }
}

static void test_add_one_sample_lost_anywhere_is_flagged_in_its_second(void** state) {
  (void)state;
  for (int lost = 100; lost < 300; lost++) {
    imucal_sum_t sum;
    imucal_second_t second;
    start(&sum);
    int flagged = 0, owner = 0;
    for (int i = 0; i < 401; i++) {
      if (i == lost) continue;
      if (add(&sum, 5000u + 10000u * (unsigned)i, 1, &second) != IMUCAL_SECOND_READY) continue;
      if (second.flags[0] & IMUCAL_FLAG_MISSING) {
        flagged++;
        if (second.t_s == (uint32_t)(lost / 100) + 1) owner = 1;
        assert_false(second.is_gap);
      }
    }
    assert_in_range(flagged, 1, 2); /* a sample at the edge may flag both neighbours */
    assert_int_equal(owner, 1);
  }
}

static void test_add_half_of_a_second_is_no_gap_one_less_is(void** state) {
  (void)state;
  for (unsigned n = 49; n <= 50; n++) {
    imucal_sum_t sum;
    imucal_second_t second;
    start(&sum);
    for (unsigned i = 0; i < n; i++) assert_int_equal(add(&sum, 10000u * i, 1, &second), IMUCAL_OK);
    assert_int_equal(add(&sum, 1000000, 1, &second), IMUCAL_SECOND_READY);
    assert_int_equal(second.is_gap, n == 49);
    assert_int_equal(second.flags[0], IMUCAL_FLAG_MISSING);
  }
}

static void test_add_jump_over_seconds_is_reported(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  assert_int_equal(add(&sum, 500000, 1, &second), IMUCAL_OK);
  assert_int_equal(add(&sum, 7500000, 2, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.t_s, 1);
  assert_int_equal(second.n_skipped, 0);
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.t_s, 8);
  assert_int_equal(second.n_skipped, 6);
  assert_int_equal(sum.n_jump, 1);
}

static void test_add_duplicate_and_backward_are_left_out_and_counted(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  assert_int_equal(add(&sum, 20000, 5, &second), IMUCAL_OK);
  assert_int_equal(add(&sum, 20000, 70, &second), IMUCAL_ERR_PERIOD);
  assert_int_equal(add(&sum, 10000, 70, &second), IMUCAL_ERR_PERIOD);
  assert_int_equal(add(&sum, 30000, 6, &second), IMUCAL_OK);
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
  assert_true(second.sum[0] == 11);
  assert_int_equal(second.n_samples, 2);
  assert_int_equal(sum.n_duplicate, 1);
  assert_int_equal(sum.n_backward, 1);
  assert_int_equal(imucal_sum_n_taken(&sum), 2);
}

static void test_add_first_sample_at_time_zero_is_taken(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  assert_int_equal(add(&sum, 0, 5, &second), IMUCAL_OK);
  assert_int_equal(add(&sum, 0, 5, &second), IMUCAL_ERR_PERIOD);
  assert_int_equal(imucal_sum_n_taken(&sum), 1);
}

static void test_flush_second_handed_out_takes_no_more(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_OK);
  assert_int_equal(add(&sum, 100000, 5, &second), IMUCAL_OK);
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_OK);
  assert_int_equal(add(&sum, 200000, 5, &second), IMUCAL_ERR_PERIOD);
  assert_int_equal(add(&sum, 1000000, 5, &second), IMUCAL_OK);
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.t_s, 2);
  assert_int_equal(second.n_skipped, 0);
}

static void test_add_flags_of_channels_are_kept_apart(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  for (unsigned i = 0; i < 100; i++) {
    imucal_sample_t s = sample_at(10000u * i, 1);
    s.saturated = i == 40 ? 1 : 0;
    s.fault = i == 41 ? 2 : 0;
    assert_int_equal(imucal_sum_add(&sum, &s, &second), IMUCAL_OK);
  }
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.flags[0], IMUCAL_FLAG_SATURATED);
  assert_int_equal(second.flags[1], IMUCAL_FLAG_FAULT);
  assert_int_equal(add(&sum, 1000000, 1, &second), IMUCAL_OK);
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.flags[0], IMUCAL_FLAG_MISSING); /* the next second starts clean */
}

static void test_add_wrong_channels_or_time_beyond_range_refused(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  imucal_sample_t s = sample_at(1, 1);
  s.n_channels = 3;
  assert_int_equal(imucal_sum_add(&sum, &s, &second), IMUCAL_ERR_RANGE);
  assert_int_equal(add(&sum, (uint64_t)UINT32_MAX * 1000000u, 1, &second), IMUCAL_ERR_RANGE);
  assert_int_equal(add(&sum, (uint64_t)UINT32_MAX * 1000000u - 1, 1, &second), IMUCAL_OK);
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.t_s, UINT32_MAX);
  assert_int_equal(sum.n_refused, 2);
}

/* The white noise of a mean grows with the samples lost, not with a sample clock that is off. */
static void test_noise_ratio_is_of_lost_samples_only(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  for (int i = 0; i < 100; i++) /* a hole of 20 samples */
    if (i < 40 || i >= 60) assert_int_equal(add(&sum, 10000u * (unsigned)i, 3, &second), IMUCAL_OK);
  assert_int_equal(add(&sum, 1000000, 3, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.n_samples, 80);
  assert_true(imucal_sum_noise_ratio(&sum, &second, 0) == 1.25f);
  for (int i = 1; i < 90; i++) assert_int_equal(add(&sum, 1000000u + 11111u * (unsigned)i, 3, &second), IMUCAL_OK);
  assert_int_equal(add(&sum, 2000000, 3, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.n_samples, 90);
  assert_true(imucal_sum_noise_ratio(&sum, &second, 0) == 1.0f);
}

static void test_mean_q16_is_exact_rne_of_the_quotient(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (int i = 0; i < 200000; i++) {
    uint32_t n = (uint32_t)unit_integer(&rng, 1, i % 2 ? 200 : (int64_t)IMUCAL_SUM_MAX_SAMPLES);
    int64_t limit = ((int64_t)1 << 31) * n;
    int64_t sum = i < 8 ? (i % 2 ? limit : -limit) : unit_integer(&rng, -limit, limit);
    if (i % 3 == 0) sum >>= 40; /* small sums: ties are frequent */
    /* |mean n - sum 2^16| <= n/2, and even where equal: the definition; modulo 2^64, and roughly, which leaves one number */
    int64_t mean = imucal_mean_q16_rne(sum, n);
    int64_t twice_error = (int64_t)(2u * ((uint64_t)mean * n - (uint64_t)sum * 65536u));
    assert_true(fabs((double)mean - (double)sum * 65536 / n) <= 1 + fabs((double)mean) * 1e-15);
    assert_true(twice_error <= (int64_t)n && twice_error >= -(int64_t)n);
    if (twice_error == (int64_t)n || twice_error == -(int64_t)n) assert_true((mean & 1) == 0);
  }
}

static void test_unit_from_q16_within_stated_error(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (int i = 0; i < 100000; i++) {
    int64_t mean = unit_integer(&rng, -((int64_t)1 << 47), (int64_t)1 << 47) >> unit_integer(&rng, 0, 40);
    float scale = (float)unit_between(&rng, 0.001, 200);
    double exact = (double)mean * 0x1p-16 * (double)scale;
    assert_true(fabs((double)imucal_unit_from_q16(mean, scale, 0.0f) - exact) <= fabs(exact) * 0x1p-23);
  }
}

static void test_init_takes_the_limits(void** state) {
  (void)state;
  imucal_sum_t sum;
  assert_int_equal(imucal_sum_init(&sum, 1, 1), IMUCAL_OK);
  assert_int_equal(imucal_sum_init(&sum, IMUCAL_MAX_CHANNELS, IMUCAL_SUM_MAX_RATE_HZ), IMUCAL_OK);
}

/* Nothing of a channel that the device does not have is touched. */
static void test_flags_and_sums_are_of_all_channels_and_no_more(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  for (unsigned i = 0; i < 100; i++) {
    imucal_sample_t s = sample_at(10000u * i, 7);
    for (int c = 2; c < IMUCAL_MAX_CHANNELS; c++) s.counts[c] = 99;
    s.saturated = 0xFE;
    s.fault = 0xFD;
    if (i != 50) assert_int_equal(imucal_sum_add(&sum, &s, &second), IMUCAL_OK);
  }
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.flags[0], IMUCAL_FLAG_MISSING | IMUCAL_FLAG_FAULT);
  assert_int_equal(second.flags[1], IMUCAL_FLAG_MISSING | IMUCAL_FLAG_SATURATED);
  for (int c = 2; c < IMUCAL_MAX_CHANNELS; c++) assert_true(second.flags[c] == 0 && second.sum[c] == 0);
  for (unsigned i = 100; i < 200; i++) assert_int_equal(add(&sum, 10000u * i, 7, &second), IMUCAL_OK);
  assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
  assert_int_equal(second.flags[0] | second.flags[1], 0); /* neither fault nor rail is carried over */
}

/* The rules of sum.h once more, from nothing but the list of time stamps. */
typedef struct {
  uint64_t t_us[4000];
  int n, first; /* stamps so far; first one of the running second */
  uint32_t rate_hz, last_t_s, n_jump;
} stamps_t;

/* The second that holds stamps first .. n-1 is over; next_us: the stamp after it, 0: flushed. */
static void expect_second(stamps_t* m, const imucal_second_t* second, uint64_t next_us) {
  const uint64_t hole_us = 1000000 / m->rate_hz + 1000000 / (2 * m->rate_hz), period_us = hole_us - hole_us / 3;
  const uint64_t* t = m->t_us;
  const int last = m->n - 1;
  const uint64_t begin_us = t[m->first] / 1000000 * 1000000, end_us = begin_us + 1000000;
  bool is_missing = m->first == 0 && t[0] - begin_us > hole_us;
  if (m->first > 0 && t[m->first] - t[m->first - 1] > hole_us && t[m->first] - period_us >= begin_us) is_missing = true;
  for (int i = m->first + 1; i <= last; i++) is_missing = is_missing || t[i] - t[i - 1] > hole_us;
  if (next_us != 0 && next_us - t[last] > hole_us && t[last] + period_us < end_us) is_missing = true;
  if (next_us == 0 && end_us - t[last] > hole_us) is_missing = true;
  const uint32_t n = (uint32_t)(m->n - m->first), t_s = (uint32_t)(end_us / 1000000);
  const uint32_t n_skipped = m->last_t_s == 0 ? 0 : t_s - m->last_t_s - 1;
  if (second->flags[0] != (is_missing ? IMUCAL_FLAG_MISSING : 0))
    fail_msg("second ending at %u s, %u Hz: flags %u", t_s, m->rate_hz, second->flags[0]);
  assert_int_equal(second->n_samples, n);
  assert_int_equal(second->t_s, t_s);
  assert_int_equal(second->n_skipped, n_skipped);
  assert_int_equal(second->is_gap, 2 * n < m->rate_hz);
  assert_true(second->sum[0] == (int64_t)n * 3 && second->temp_sum == (int64_t)n);
  m->n_jump += n_skipped != 0;
  m->last_t_s = t_s;
  m->first = m->n;
}

static void test_add_seconds_follow_the_rule_of_time_at_every_limit(void** state) {
  (void)state;
  static stamps_t m;
  unit_rng_t rng = {unit_seed()};
  const uint32_t rates_hz[] = {1, 7, 10, 100};
  for (int run = 0; run < 1000; run++) {
    m.n = m.first = 0;
    m.last_t_s = m.n_jump = 0;
    m.rate_hz = rates_hz[run % 4];
    imucal_sum_t sum;
    imucal_second_t second;
    assert_int_equal(imucal_sum_init(&sum, 2, m.rate_hz), IMUCAL_OK);
    const uint64_t hole_us = sum.hole_us, period_us = hole_us - hole_us / 3;
    uint64_t t_us = (uint64_t)unit_integer(&rng, 0, 2) * 1000000;
    t_us +=
        (uint64_t)(run % 8 == 0 ? 0 : unit_integer(&rng, -1, 1) + (int64_t)(unit_bits(&rng) % 2 ? hole_us : period_us));
    for (int i = 0; i < 300; i++) {
      assert_int_equal(add(&sum, t_us, 3, &second),
                       m.n > m.first && t_us / 1000000 != m.t_us[m.n - 1] / 1000000 ? IMUCAL_SECOND_READY : IMUCAL_OK);
      if (m.n > m.first && t_us / 1000000 != m.t_us[m.n - 1] / 1000000) expect_second(&m, &second, t_us);
      m.t_us[m.n++] = t_us;
      if (unit_bits(&rng) % 64 == 0 && imucal_sum_flush(&sum, &second) == IMUCAL_SECOND_READY) {
        expect_second(&m, &second, 0);
        const uint64_t end_us = (t_us / 1000000 + 1) * 1000000;
        m.t_us[m.n - 1] = end_us - 1; /* the next hole is counted from the end of what was handed out */
        t_us = end_us - 1;
      }
      const uint64_t left_us = 1000000 - t_us % 1000000; /* to the next second */
      const uint64_t steps[] = {period_us,
                                period_us,
                                period_us,
                                hole_us,
                                hole_us + 1,
                                hole_us - 1,
                                2 * period_us,
                                left_us,
                                left_us + 1,
                                left_us + period_us,
                                left_us + period_us - 1,
                                left_us + period_us + 1,
                                left_us + hole_us,
                                left_us + 2000000};
      uint64_t step = steps[unit_bits(&rng) % (sizeof steps / sizeof steps[0])];
      if (unit_bits(&rng) % 8 == 0 && left_us > period_us) step = left_us - period_us + unit_bits(&rng) % 3 - 1;
      t_us += step > 0 ? step : 1;
    }
    assert_int_equal(sum.n_jump, m.n_jump + (sum.run.n_skipped != 0));
    assert_int_equal(imucal_sum_n_taken(&sum), 300);
  }
}

static void test_add_duplicates_and_backward_have_a_count_each(void** state) {
  (void)state;
  imucal_sum_t sum;
  imucal_second_t second;
  start(&sum);
  assert_int_equal(add(&sum, 20000, 5, &second), IMUCAL_OK);
  for (int i = 0; i < 3; i++) assert_int_equal(add(&sum, 20000, 5, &second), IMUCAL_ERR_PERIOD);
  assert_int_equal(add(&sum, 19999, 5, &second), IMUCAL_ERR_PERIOD);
  assert_int_equal(sum.n_duplicate, 3);
  assert_int_equal(sum.n_backward, 1);
}

static void test_unit_from_q16_adds_the_offset(void** state) {
  (void)state;
  assert_true(imucal_unit_from_q16(3 * 65536, 0.5f, 25.0f) == 26.5f);
  assert_true(imucal_unit_from_q16(-32768, 1.0f, -7.0f) == -7.5f);
}

/* As many samples as nominal, though some are missing by their times: no better than a whole second. */
static void test_noise_ratio_is_at_least_one(void** state) {
  (void)state;
  imucal_sum_t sum;
  start(&sum);
  imucal_second_t second = {.n_channels = 2, .flags = {IMUCAL_FLAG_MISSING, IMUCAL_FLAG_SATURATED}};
  second.n_samples = 101;
  assert_true(imucal_sum_noise_ratio(&sum, &second, 0) == 1.0f);
  second.n_samples = 50;
  assert_true(imucal_sum_noise_ratio(&sum, &second, 0) == 2.0f);
  assert_true(imucal_sum_noise_ratio(&sum, &second, 1) == 1.0f);
}

/* A period and a half at 100 Hz is 15,000 us: a first sample later than that in its second, or a last one earlier than
 * that before its end, leaves samples missing; 1.2 periods do not. */
static void test_first_and_last_sample_at_the_limit_of_a_hole(void** state) {
  (void)state;
  const struct {
    uint64_t first_us, last_us;
    int is_missing;
  } at[] = {{5012000, 5985001, 0}, {5015000, 5985000, 0}, {5015001, 5985000, 1}, {5000000, 5984999, 1}};
  for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
    imucal_sum_t sum;
    imucal_second_t second;
    start(&sum);
    for (uint64_t t_us = at[i].first_us; t_us < at[i].last_us; t_us += 10000)
      assert_int_equal(add(&sum, t_us, 1, &second), IMUCAL_OK);
    assert_int_equal(add(&sum, at[i].last_us, 1, &second), IMUCAL_OK);
    assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
    assert_int_equal((second.flags[0] & IMUCAL_FLAG_MISSING) != 0, at[i].is_missing);
  }
}

/* Every number of channels: each has its own sum, and nothing is added beside them. */
static void test_sum_each_number_of_channels(void** state) {
  (void)state;
  for (uint8_t n = 1; n <= IMUCAL_MAX_CHANNELS; n++) {
    imucal_sum_t sum;
    imucal_second_t second;
    assert_int_equal(imucal_sum_init(&sum, n, 4), IMUCAL_OK);
    for (uint64_t k = 0; k < 4; k++) {
      imucal_sample_t s = {.t_us = 100 + 250000 * k, .n_channels = n};
      for (int c = 0; c < IMUCAL_MAX_CHANNELS; c++) s.counts[c] = 10 * (c + 1) + (int32_t)k;
      assert_int_equal(imucal_sum_add(&sum, &s, &second), IMUCAL_OK);
    }
    assert_int_equal(imucal_sum_flush(&sum, &second), IMUCAL_SECOND_READY);
    for (int c = 0; c < IMUCAL_MAX_CHANNELS; c++) assert_int_equal(second.sum[c], c < n ? 40 * (c + 1) + 6 : 0);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_first_and_last_sample_at_the_limit_of_a_hole),
      cmocka_unit_test(test_init_refuses_nonsense),
      cmocka_unit_test(test_add_second_is_cut_by_time_stamps),
      cmocka_unit_test(test_add_extreme_counts_sum_is_exact),
      cmocka_unit_test(test_add_any_phase_and_jitter_no_missing_flag),
      cmocka_unit_test(test_add_one_sample_lost_anywhere_is_flagged_in_its_second),
      cmocka_unit_test(test_add_half_of_a_second_is_no_gap_one_less_is),
      cmocka_unit_test(test_add_jump_over_seconds_is_reported),
      cmocka_unit_test(test_add_duplicate_and_backward_are_left_out_and_counted),
      cmocka_unit_test(test_add_first_sample_at_time_zero_is_taken),
      cmocka_unit_test(test_flush_second_handed_out_takes_no_more),
      cmocka_unit_test(test_add_flags_of_channels_are_kept_apart),
      cmocka_unit_test(test_add_wrong_channels_or_time_beyond_range_refused),
      cmocka_unit_test(test_noise_ratio_is_of_lost_samples_only),
      cmocka_unit_test(test_mean_q16_is_exact_rne_of_the_quotient),
      cmocka_unit_test(test_unit_from_q16_within_stated_error),
      cmocka_unit_test(test_init_takes_the_limits),
      cmocka_unit_test(test_flags_and_sums_are_of_all_channels_and_no_more),
      cmocka_unit_test(test_add_seconds_follow_the_rule_of_time_at_every_limit),
      cmocka_unit_test(test_add_duplicates_and_backward_have_a_count_each),
      cmocka_unit_test(test_unit_from_q16_adds_the_offset),
      cmocka_unit_test(test_noise_ratio_is_at_least_one),
      cmocka_unit_test(test_sum_each_number_of_channels),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
