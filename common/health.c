// SPDX-License-Identifier: MIT
#include "health.h"

#include "num.h"
#include "sum.h"

#define MAX_VARIANCE 1e14f
#define BLOCK_N 256u       /* innovations per block of `slow`, steps per partial sum */
#define STAND_BLOCK_N 128u /* seconds per mean of the rate while the temperature stands */
#define SEEN_BLOCK_N 8u
#define RAMP_BLOCK_S 64u
#define LONG_GAP_S 60u /* after it any temperature may follow */

#define MAX_RUN IMUCAL_HEALTH_MOST_REPEATED
#define MIN_NOISE 0.05f
#define MAX_SHARE 0.01f
#define MAX_MOVE 6.0f
#define MAX_RAMP (64.0f / 300.0f)
#define MIN_SPAN 0.5f
#define MIN_NIS IMUCAL_HEALTH_LEAST_NIS
#define MAX_NIS IMUCAL_HEALTH_MOST_NIS
#define MAX_LAG1 0.1f
#define MAX_SLOW IMUCAL_HEALTH_MOST_SLOW
#define MIN_SLOW_BLOCKS 4u

static float magnitude(float value) {
  return value < 0.0f ? -value : value;
}

IMUCAL_COLD imucal_status imucal_health_init(imucal_health_t* health, const imucal_health_config_t* config) {
  if (health == NULL || config == NULL) return IMUCAL_ERR_ARGUMENT;
  if (!imucal_is_within(config->r, 0.0f, MAX_VARIANCE) ||
      !imucal_is_within(config->markov_variance, 0.0f, MAX_VARIANCE))
    return IMUCAL_ERR_MODEL;
  if (!imucal_is_within(config->lo_degc, -3000.0f, 3000.0f) || !imucal_is_within(config->hi_degc, -3000.0f, 3000.0f) ||
      !imucal_is_within(config->temp_step_degc, 0.0f, 100.0f))
    return IMUCAL_ERR_SPAN;
  *health = (imucal_health_t){0};
  health->config = *config;
  return IMUCAL_OK;
}

/* ---- the temperature ---- */

static void take_level(imucal_health_t* h, float temp_degc) {
  h->temp = temp_degc;
  h->since_s = 0;
  h->n_candidate = 0;
  h->ramp_from = temp_degc;
  h->ramp_s = 0;
  h->has_temp = true;
}

static void follow_ramp(imucal_health_t* h, float temp_degc, uint32_t elapsed_s) {
  h->ramp_s += elapsed_s;
  if (h->ramp_s < RAMP_BLOCK_S) return;
  const float change = magnitude(temp_degc - h->ramp_from) * (float)RAMP_BLOCK_S / (float)h->ramp_s;
  if (change > h->worst_ramp) h->worst_ramp = change;
  h->ramp_from = temp_degc;
  h->ramp_s = 0;
}

/* True where the reading may follow the last good one.  Readings that may not, but agree with each other,
 * become the new level; that counts as a jump where the old level was one. */
static bool is_plausible(imucal_health_t* h, float temp_degc) {
  const float step = IMUCAL_HEALTH_TEMP_STEP_DEGC + h->config.temp_step_degc;
  const float reach = step + IMUCAL_HEALTH_TEMP_RATE_DEGC_PER_S * (float)h->since_s;
  if (!h->has_temp || h->since_s > LONG_GAP_S) {
    h->n_level = 1;
    take_level(h, temp_degc);
    return true;
  }
  const float change = magnitude(temp_degc - h->temp);
  if (change <= reach) {
    const uint32_t elapsed_s = h->since_s;
    if (h->n_candidate >= 2 && change > step) h->n_jumps++; /* a small one, that time made plausible */
    h->temp = temp_degc;
    h->since_s = 0;
    h->n_candidate = 0;
    if (h->n_level < IMUCAL_HEALTH_LEVEL_N) h->n_level++;
    follow_ramp(h, temp_degc, elapsed_s);
    return true;
  }
  h->n_spikes++;
  const bool agrees = h->n_candidate > 0 && magnitude(temp_degc - h->candidate) <= step;
  h->n_candidate = agrees ? h->n_candidate + 1u : 1u;
  h->candidate = temp_degc;
  if (h->n_candidate < IMUCAL_HEALTH_LEVEL_N) return false;
  if (h->n_level >= IMUCAL_HEALTH_LEVEL_N) h->n_jumps++;
  h->n_level = IMUCAL_HEALTH_LEVEL_N;
  take_level(h, temp_degc);
  return false;
}

static void take_seen(imucal_health_t* h, float temp_degc) {
  if (h->n_block == 0) h->block_lo = h->block_hi = temp_degc;
  if (temp_degc < h->block_lo) h->block_lo = temp_degc;
  if (temp_degc > h->block_hi) h->block_hi = temp_degc;
  if (++h->n_block < SEEN_BLOCK_N) return;
  h->n_block = 0;
  if (!h->has_seen || h->block_hi < h->seen_lo) h->seen_lo = h->block_hi;
  if (!h->has_seen || h->block_lo > h->seen_hi) h->seen_hi = h->block_lo;
  h->has_seen = true;
}

/* ---- the rate ---- */

static void compare_with_last(imucal_health_t* h, float rate) {
  const float step = rate - h->last_rate;
  const bool has_last = h->has_last;
  h->last_rate = rate;
  h->has_last = true;
  h->run = has_last && step == 0.0f ? h->run + 1u : 1u;
  if (h->run > h->longest_run) h->longest_run = h->run;
  if (!has_last) return;
  h->step2_block += step * step;
  if (++h->n_steps % BLOCK_N != 0) return;
  h->step2 += h->step2_block;
  h->step2_block = 0.0f;
}

/* Means of 128 s against the first of them since the temperature stands; of seconds that the gate let
 * through. */
static void watch_standing(imucal_health_t* h, float rate, float temp_degc) {
  if (h->n_stand + h->n_stand_blocks == 0 || temp_degc != h->stand_temp) {
    h->stand_temp = temp_degc;
    h->stand_sum = 0.0f;
    h->n_stand = h->n_stand_blocks = 0;
  }
  h->stand_sum += rate;
  if (++h->n_stand < STAND_BLOCK_N) return;
  const float mean = h->stand_sum / (float)STAND_BLOCK_N;
  if (h->n_stand_blocks++ == 0) h->stand_first = mean;
  const float move = magnitude(mean - h->stand_first);
  if (move > h->worst_move) h->worst_move = move;
  h->stand_sum = 0.0f;
  h->n_stand = 0;
}

bool imucal_health_second(imucal_health_t* h, float rate, float temp_degc, uint32_t flags, bool is_measured,
                          uint32_t n_skipped) {
  h->n++;
  h->since_s = h->since_s > LONG_GAP_S || n_skipped > LONG_GAP_S ? LONG_GAP_S + 1u : h->since_s + n_skipped + 1u;
  if (flags & IMUCAL_FLAG_SATURATED) h->n_saturated++;
  if (flags & IMUCAL_FLAG_FAULT) h->n_faulty++;
  if (n_skipped > 0) h->has_last = false;
  const bool is_spoilt = (flags & (IMUCAL_FLAG_SATURATED | IMUCAL_FLAG_FAULT)) != 0 || !is_measured;
  if (!imucal_is_finite(temp_degc) || !is_plausible(h, temp_degc) || is_spoilt || !imucal_is_finite(rate)) {
    h->has_last = false;
    h->last_innovation = 0.0f;
    return false;
  }
  h->n_used++;
  compare_with_last(h, rate);
  take_seen(h, temp_degc);
  return true;
}

/* ---- the innovations ---- */

static void finish_block(imucal_health_t* h) {
  h->nis += h->nis_block;
  h->lag1 += h->lag1_block;
  if (h->weight_block > 0.0f) {
    h->slow += h->weighted_block * h->weighted_block / h->weight_block;
    h->n_slow++;
  }
  h->nis_block = h->lag1_block = h->weighted_block = h->weight_block = 0.0f;
}

bool imucal_health_gate(imucal_health_t* h, float innovation, float weight) {
  const float normalised = innovation * weight;
  const float nis = innovation * normalised;
  const bool fits = ++h->n_gated <= IMUCAL_HEALTH_UNGATED_N || nis <= IMUCAL_HEALTH_GATE;
  const bool is_open = h->reject_run >= IMUCAL_HEALTH_MAX_REJECT_RUN;
  if (!fits && !is_open) {
    h->n_rejected++;
    if (++h->reject_run == IMUCAL_HEALTH_MAX_REJECT_RUN) h->has_opened = true;
    if (!h->config.is_ungated) {
      h->last_innovation = 0.0f;
      return false;
    }
  }
  if (fits) h->reject_run = 0; /* while it stands open it closes behind the first that fits */
  watch_standing(h, h->last_rate, h->temp);
  h->nis_block += nis;
  h->lag1_block += h->last_innovation * normalised;
  h->weighted_block += normalised;
  h->weight_block += weight;
  /* The first innovations have the variance of what was not known beforehand, say (1e4)^2: beside one of r such a product
   * would outweigh all others.  Settled is a variance within four times that of the noise. */
  const float settled = 0.25f / (h->config.r + h->config.markov_variance);
  h->last_innovation = weight >= settled ? innovation : 0.0f;
  if (++h->n_innovations % BLOCK_N == 0) finish_block(h);
  return true;
}

void imucal_health_new_run(imucal_health_t* h) {
  h->has_last = h->has_temp = false; /* the first reading begins level, ramp and candidates anew */
  h->n_block = h->n_stand = h->n_stand_blocks = 0;
  h->last_innovation = 0.0f;
  h->reject_run = h->n_gated = 0;
}

/* ---- the verdict ---- */

enum { ABOVE, BELOW };

static void judge(imucal_health_verdict_t* v, uint32_t rule, float value, float limit, int side) {
  v->judged |= 1u << rule;
  v->value[rule] = value;
  v->limit[rule] = limit;
  const bool holds = side == ABOVE ? value <= limit : value >= limit;
  if (!holds) v->bits |= 1u << rule;
}

/* Quantile of chi-square over its n degrees of freedom at IMUCAL_HEALTH_Z (Wilson and Hilferty 1931); at 4
 * degrees and more within 3 % of the exact one. */
static float chi2_ratio(float n) {
  const float spread = 2.0f / (9.0f * n);
  const float root = 1.0f - spread + IMUCAL_HEALTH_Z * imucal_sqrtf(spread);
  return root * root * root;
}

static float share(uint32_t part, uint32_t all) {
  return (float)part / (float)all;
}

static void judge_rate(const imucal_health_t* h, imucal_health_verdict_t* v) {
  judge(v, IMUCAL_HEALTH_REPEATED, (float)h->longest_run, MAX_RUN, ABOVE);
  if (h->n < IMUCAL_HEALTH_MIN_N) return;
  judge(v, IMUCAL_HEALTH_SATURATED, share(h->n_saturated, h->n), MAX_SHARE, ABOVE);
  judge(v, IMUCAL_HEALTH_FAULTY, share(h->n_faulty, h->n), MAX_SHARE, ABOVE);
  if (h->n_steps < IMUCAL_HEALTH_MIN_N) return;
  const float mean_step2 = (h->step2 + h->step2_block) / (float)h->n_steps;
  if (h->config.r > 0.0f) {
    judge(v, IMUCAL_HEALTH_NO_NOISE, mean_step2 / (2.0f * h->config.r), MIN_NOISE, BELOW);
  } else {
    judge(v, IMUCAL_HEALTH_NO_NOISE, mean_step2, 0.0f, BELOW);
    if (mean_step2 == 0.0f) v->bits |= 1u << IMUCAL_HEALTH_NO_NOISE;
  }
}

static void judge_temperature(const imucal_health_t* h, imucal_health_verdict_t* v) {
  judge(v, IMUCAL_HEALTH_TEMP_JUMP, (float)h->n_jumps, 0.0f, ABOVE);
  if (h->n >= IMUCAL_HEALTH_MIN_N) judge(v, IMUCAL_HEALTH_TEMP_SPIKES, share(h->n_spikes, h->n), MAX_SHARE, ABOVE);
  const float variance = 2.0f * (h->config.markov_variance + h->config.r / (float)STAND_BLOCK_N);
  if (h->config.r > 0.0f && h->config.temp_step_degc <= IMUCAL_HEALTH_COARSE_DEGC)
    judge(v, IMUCAL_HEALTH_TEMP_STUCK, h->worst_move / imucal_sqrtf(variance), MAX_MOVE, ABOVE);
  const float wanted = h->config.hi_degc - h->config.lo_degc;
  if (!(wanted > 0.0f)) return;
  judge(v, IMUCAL_HEALTH_TEMP_RAMP, h->worst_ramp / wanted, MAX_RAMP, ABOVE);
  if (!h->has_seen) return;
  const float lo = h->seen_lo > h->config.lo_degc ? h->seen_lo : h->config.lo_degc;
  const float hi = h->seen_hi < h->config.hi_degc ? h->seen_hi : h->config.hi_degc;
  judge(v, IMUCAL_HEALTH_SPAN, hi > lo ? (hi - lo) / wanted : 0.0f, MIN_SPAN, BELOW);
}

static void judge_innovations(const imucal_health_t* h, imucal_health_verdict_t* v) {
  if (h->n_gated == 0) return;
  const uint32_t seen = h->n_innovations + (h->config.is_ungated ? 0u : h->n_rejected);
  if (seen >= IMUCAL_HEALTH_MIN_N)
    judge(v, IMUCAL_HEALTH_REJECTS, h->has_opened ? 1.0f : share(h->n_rejected, seen), MAX_SHARE, ABOVE);
  if (h->n_innovations < IMUCAL_HEALTH_MIN_N) return;
  const float n = (float)h->n_innovations;
  const float sum = h->nis + h->nis_block, nis = sum / n;
  const float spread = IMUCAL_HEALTH_Z * imucal_sqrtf(2.0f / n);
  if (nis < 0.5f)
    judge(v, IMUCAL_HEALTH_NIS, nis, MIN_NIS * (1.0f - spread), BELOW);
  else
    judge(v, IMUCAL_HEALTH_NIS, nis, MAX_NIS * (1.0f + spread), ABOVE);
  const float lag1 = sum > 0.0f ? (h->lag1 + h->lag1_block) / sum : 0.0f;
  const float limit = MAX_LAG1 + IMUCAL_HEALTH_Z / imucal_sqrtf(n);
  if (lag1 < 0.0f)
    judge(v, IMUCAL_HEALTH_LAG1, lag1, -limit, BELOW);
  else
    judge(v, IMUCAL_HEALTH_LAG1, lag1, limit, ABOVE);
  if (h->n_slow < MIN_SLOW_BLOCKS) return;
  judge(v, IMUCAL_HEALTH_SLOW, h->slow / (float)h->n_slow, MAX_SLOW * chi2_ratio((float)h->n_slow), ABOVE);
}

IMUCAL_COLD void imucal_health_judge(const imucal_health_t* health, imucal_health_verdict_t* verdict) {
  *verdict = (imucal_health_verdict_t){0};
  judge_rate(health, verdict);
  judge_temperature(health, verdict);
  judge_innovations(health, verdict);
}

IMUCAL_COLD float imucal_health_error_factor(const imucal_health_t* h) {
  const float n = (float)h->n_innovations;
  const float nis = n > 0.0f ? (h->nis + h->nis_block) / n : 1.0f;
  const float slow = h->n_slow > 0 ? h->slow / (float)h->n_slow : 1.0f;
  const float ratio = slow > nis ? slow : nis;
  return ratio > 1.0f ? imucal_sqrtf(ratio) : 1.0f;
}

IMUCAL_COLD bool imucal_health_span(const imucal_health_t* health, float* lo_degc, float* hi_degc) {
  if (!health->has_seen) return false;
  const bool is_ordered = health->seen_lo <= health->seen_hi; /* a ramp of one block is seen the wrong way round */
  *lo_degc = is_ordered ? health->seen_lo : health->seen_hi;
  *hi_degc = is_ordered ? health->seen_hi : health->seen_lo;
  return true;
}

IMUCAL_COLD const char* imucal_health_rule_name(uint32_t rule) {
  static const char* const name[IMUCAL_HEALTH_N_RULES] = {
      "no-noise",  "repeated", "saturated", "faulty", "temp-stuck", "temp-jump", "temp-spikes",
      "temp-ramp", "span",     "nis",       "lag1",   "slow",       "rejects"};
  return rule < IMUCAL_HEALTH_N_RULES ? name[rule] : "unknown";
}
