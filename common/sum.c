// SPDX-License-Identifier: MIT
#include "sum.h"

#include "num.h"

#define US_PER_S 1000000u
#define NO_SECOND_YET 0u

IMUCAL_COLD imucal_status imucal_sum_init(imucal_sum_t* sum, uint32_t n_channels, uint32_t rate_hz) {
  if (sum == NULL || n_channels < 1 || n_channels > IMUCAL_MAX_CHANNELS) return IMUCAL_ERR_ARGUMENT;
  if (rate_hz < 1 || rate_hz > IMUCAL_SUM_MAX_RATE_HZ) return IMUCAL_ERR_ARGUMENT;
  *sum = (imucal_sum_t){0};
  sum->run.n_channels = (uint8_t)n_channels;
  sum->nominal_n = rate_hz;
  sum->period_us = US_PER_S / rate_hz;
  sum->hole_us = sum->period_us + US_PER_S / (2 * rate_hz);
  return IMUCAL_OK;
}

IMUCAL_COLD static void mark_missing(imucal_sum_t* sum) {
  for (uint32_t i = 0; i < sum->run.n_channels; i++)
    sum->run.flags[i] = (uint8_t)(sum->run.flags[i] | IMUCAL_FLAG_MISSING);
}

/* Hand out the running second and leave the sums empty. */
IMUCAL_COLD static void close_second(imucal_sum_t* sum, imucal_second_t* second) {
  for (uint32_t i = 0; i < sum->run.n_channels; i++) {
    if (((uint32_t)sum->saturated >> i) & 1u) sum->run.flags[i] |= IMUCAL_FLAG_SATURATED;
    if (((uint32_t)sum->fault >> i) & 1u) sum->run.flags[i] |= IMUCAL_FLAG_FAULT;
  }
  sum->run.is_gap = 2 * (uint64_t)sum->run.n_samples < sum->nominal_n;
  sum->n_handed_out += sum->run.n_samples;
  *second = sum->run;
  sum->last_t_s = sum->run.t_s;
  uint8_t n_channels = sum->run.n_channels;
  sum->run = (imucal_second_t){0};
  sum->run.n_channels = n_channels;
  sum->saturated = 0;
  sum->fault = 0;
}

/* A hole over the edge of two seconds belongs to the one a sample was due in: a nominal period after the last sample,
 * a nominal period before the next. */
static bool is_due_before_end(const imucal_sum_t* sum) {
  return sum->last_us + sum->period_us < sum->end_us;
}
static bool is_due_after_start(const imucal_sum_t* sum, uint64_t next_us) {
  return next_us - sum->period_us >= sum->end_us - US_PER_S;
}

/* Begin the second that holds t_us.  Pre: t_us / 1e6 + 1 fits 32 bits. */
static void open_second(imucal_sum_t* sum, uint64_t t_us) {
  uint64_t start_s = t_us / US_PER_S;
  sum->end_us = (start_s + 1) * US_PER_S;
  sum->run.t_s = (uint32_t)(start_s + 1);
  if (sum->last_t_s != NO_SECOND_YET) sum->run.n_skipped = sum->run.t_s - sum->last_t_s - 1;
  if (sum->run.n_skipped != 0) sum->n_jump++;
}

/* A sample of a later second came: hand out the running one, if it has samples, and begin the sample's. */
IMUCAL_COLD static imucal_status turn_second(imucal_sum_t* sum, uint64_t t_us, imucal_second_t* second) {
  imucal_status status = IMUCAL_OK;
  const bool is_first = sum->end_us == 0;
  const bool is_hole = !is_first && t_us - sum->last_us > sum->hole_us;
  if (sum->run.n_samples != 0) {
    if (is_hole && is_due_before_end(sum)) mark_missing(sum);
    close_second(sum, second);
    status = IMUCAL_SECOND_READY;
  }
  open_second(sum, t_us);
  if (is_first ? t_us - (sum->end_us - US_PER_S) > sum->hole_us : is_hole && is_due_after_start(sum, t_us))
    mark_missing(sum);
  return status;
}

/* By channels and not in a loop: with six of them 18 instructions of 103 less on a Cortex-M4F, 47 of 201 on an M0. */
IMUCAL_STATIC_ASSERT(channels_are_at_most_six, IMUCAL_MAX_CHANNELS == 6);
static inline void add_counts(int64_t* total, const int32_t* counts, uint32_t n_channels) {
  switch (n_channels) {
  case 6:
    total[5] += counts[5]; /* fall through */
  case 5:
    total[4] += counts[4]; /* fall through */
  case 4:
    total[3] += counts[3]; /* fall through */
  case 3:
    total[2] += counts[2]; /* fall through */
  case 2:
    total[1] += counts[1]; /* fall through */
  default:
    total[0] += counts[0];
  }
}

static inline void take(imucal_sum_t* sum, const imucal_sample_t* sample) {
  sum->last_us = sample->t_us;
  sum->run.n_samples++;
  sum->run.temp_sum += sample->temp_counts;
  add_counts(sum->run.sum, sample->counts, sample->n_channels);
  if ((sample->saturated | sample->fault) == 0) return;
  sum->saturated |= sample->saturated;
  sum->fault |= sample->fault;
}

/* Any other sample than the next of the running second: refused, left out, behind a hole, the first of a later second. */
IMUCAL_APART static imucal_status add_odd(imucal_sum_t* sum, const imucal_sample_t* sample, imucal_second_t* second) {
  const uint64_t t_us = sample->t_us;
  if (t_us >= (uint64_t)UINT32_MAX * US_PER_S) {
    sum->n_refused++;
    return IMUCAL_ERR_RANGE;
  }
  if (sum->end_us != 0 && t_us <= sum->last_us) {
    if (t_us == sum->last_us)
      sum->n_duplicate++;
    else
      sum->n_backward++;
    return IMUCAL_ERR_PERIOD;
  }
  imucal_status status = IMUCAL_OK;
  if (t_us >= sum->end_us)
    status = turn_second(sum, t_us, second);
  else
    mark_missing(sum);
  take(sum, sample);
  return status;
}

/* What nearly every sample is: later than the last one, not behind a hole, of the same second.  The difference of a time
 * that is not later is beyond every hole: it is modulo 2^64. */
static inline bool is_next(const imucal_sum_t* sum, uint64_t t_us) {
  return t_us - sum->last_us - 1 < sum->hole_us && t_us < sum->end_us;
}

imucal_status imucal_sum_add(imucal_sum_t* sum, const imucal_sample_t* sample, imucal_second_t* second) {
  if (sample->n_channels != sum->run.n_channels) {
    sum->n_refused++;
    return IMUCAL_ERR_RANGE;
  }
  if (!is_next(sum, sample->t_us)) return add_odd(sum, sample, second);
  take(sum, sample);
  return IMUCAL_OK;
}

IMUCAL_COLD imucal_status imucal_sum_flush(imucal_sum_t* sum, imucal_second_t* second) {
  if (sum->run.n_samples == 0) return IMUCAL_OK;
  if (sum->end_us - sum->last_us > sum->hole_us) mark_missing(sum);
  close_second(sum, second);
  sum->last_us = sum->end_us - 1;
  return IMUCAL_SECOND_READY;
}

/* sum = n whole + rest, |rest| < n < 2^20: the mean is whole 2^16 + rest 2^16/n.  |whole| <= 2^31, so the first
 * term is at most 2^47, and |rest 2^16| < 2^36.  whole 2^16 is even, so that rounding the second term to even rounds the
 * sum to even. */
IMUCAL_COLD int64_t imucal_mean_q16_rne(int64_t sum, uint32_t n) {
  const int64_t whole = sum / (int64_t)n;
  const int64_t rest = sum % (int64_t)n;
  return whole * 65536 + imucal_divide_rne(rest * 65536, (int64_t)n);
}

float imucal_unit_from_q16(int64_t mean_q16, float scale_unit_per_count, float offset_unit) {
  float counts = (float)mean_q16 * 0x1p-16f;
  return counts * scale_unit_per_count + offset_unit;
}

IMUCAL_COLD float imucal_sum_noise_ratio(const imucal_sum_t* sum, const imucal_second_t* second, uint32_t i_channel) {
  if ((second->flags[i_channel] & IMUCAL_FLAG_MISSING) == 0 || second->n_samples >= sum->nominal_n) return 1.0f;
  return (float)sum->nominal_n / (float)second->n_samples;
}
