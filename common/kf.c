// SPDX-License-Identifier: MIT
#include "kf.h"

#include "num.h"

/* A second copy of the update for this number of states (5: order 3), for compilers that unroll its loops
 * when asked to: faster, 1.2 kB larger.  0: none. */
#ifndef IMUCAL_KF_UNROLLED_STATES
#define IMUCAL_KF_UNROLLED_STATES 0
#endif
#if IMUCAL_KF_UNROLLED_STATES != 0 && (IMUCAL_KF_UNROLLED_STATES < 3 || IMUCAL_KF_UNROLLED_STATES > 7)
#error "IMUCAL_KF_UNROLLED_STATES: 0, or 3 to 7"
#endif
#if defined(__GNUC__)
#define ALWAYS_INLINE inline __attribute__((always_inline))
#else
#define ALWAYS_INLINE inline
#endif

#define MAX_GAP_ROUNDS 31
#define MAX_VARIANCE 1e14f
#define MAX_PRIOR 1e6f

/* Add `term` to the unevaluated sum hi + lo (fast two-sum; exact while |hi| >= |lo + term|, and otherwise off
 * by one rounding of the smaller number, which then is the whole history). */
static ALWAYS_INLINE void add_to(float* hi, float* lo, float term) {
  float small = *lo + term;
  float sum = *hi + small;
  *lo = small - (sum - *hi);
  *hi = sum;
}

static uint32_t n_states(const imucal_kf_t* kf) {
  return kf->config.order + 2u;
}

/* Out of line: smaller. */
IMUCAL_COLD static bool is_inside(float value, float lo, float hi) {
  return imucal_is_within(value, lo, hi);
}

IMUCAL_COLD static imucal_status check_config(const imucal_kf_config_t* c) {
  if (c->order < 1 || c->order > IMUCAL_MAX_ORDER) return IMUCAL_ERR_ORDER;
  if (!is_inside(c->t0_degc, -1000.0f, 1000.0f)) return IMUCAL_ERR_SPAN;
  if (!is_inside(c->range_degc, 1e-3f, 2000.0f)) return IMUCAL_ERR_SPAN;
  if (!is_inside(c->m, 1e-30f, 1.0f)) return IMUCAL_ERR_MODEL;
  if (!is_inside(c->q, 0.0f, MAX_VARIANCE)) return IMUCAL_ERR_MODEL;
  if (!is_inside(c->r, 1e-12f, MAX_VARIANCE)) return IMUCAL_ERR_MODEL;
  if (!is_inside(c->markov_variance, 0.0f, MAX_VARIANCE)) return IMUCAL_ERR_MODEL;
  if (!is_inside(c->prior_sigma, 1e-6f, MAX_PRIOR)) return IMUCAL_ERR_RANGE;
  return IMUCAL_OK;
}

/* Tn^k = sum_i power_in_chebyshev[k][i] T_i / 2^(k-1): the coefficients of a power series in Chebyshev's. */
static const uint8_t power_in_chebyshev[IMUCAL_MAX_COEFF][IMUCAL_MAX_COEFF] = {
    {1}, {0, 1}, {1, 0, 1}, {0, 3, 0, 1}, {3, 0, 4, 0, 1}, {0, 10, 0, 5, 0, 1}};

/* The prior is independent b_k, each of variance p: c = A b with A upper triangular, so that A's columns over
 * their diagonal are U and p over 4^(k-1) is D: exact. */
IMUCAL_COLD static void set_prior(imucal_kf_t* kf) {
  float* column = kf->u; /* of c_k: its first entry belongs to e */
  float variance = kf->config.prior_sigma * kf->config.prior_sigma;
  for (uint32_t k = 0; k <= kf->config.order; k++) {
    kf->d[k + 1] = variance;
    for (uint32_t i = 0; i < k; i++) column[i + 1] = (float)power_in_chebyshev[k][i];
    column += k + 1;
    if (k > 0) variance *= 0.25f;
  }
}

IMUCAL_COLD imucal_status imucal_kf_init(imucal_kf_t* kf, const imucal_kf_config_t* config) {
  if (kf == NULL || config == NULL) return IMUCAL_ERR_ARGUMENT;
  imucal_status status = check_config(config);
  if (status != IMUCAL_OK) return status;
  *kf = (imucal_kf_t){0};
  kf->config = *config;
  kf->inv_range = 1.0f / config->range_degc;
  kf->d[0] = config->markov_variance;
  set_prior(kf);
  kf->is_last_missing = true;
  kf->is_ready = true;
  return IMUCAL_OK;
}

/* h[1 .. n) = T_0(tn), T_1(tn), ..: T_k+1 = 2 tn T_k - T_k-1.  Pre: n >= 3. */
static ALWAYS_INLINE void chebyshev(float tn, uint32_t n, float* h) {
  float twice = tn + tn;
  h[1] = 1.0f;
  h[2] = tn;
  for (uint32_t i = 3; i < n; i++) h[i] = twice * h[i - 1] - h[i - 2];
}

/* e <- (1 - m) e + w.  With F = diag(1-m, 1 .. 1) and the noise along the first axis, F U D U' F' + q e0 e0'
 * keeps its factors: row 0 of U times 1-m, D0 <- (1-m)^2 D0 + q, because column 0 of U is e0. */
static ALWAYS_INLINE void predict(imucal_kf_t* kf, uint32_t n, float m, float q) {
  kf->x[0] -= m * kf->x[0];
  add_to(&kf->d[0], &kf->d_lo[0], q - m * (2.0f - m) * kf->d[0]);
  float* row0 = kf->u;
  for (uint32_t j = 1; j < n; row0 += j, j++) *row0 -= m * *row0;
}

/* D_j <- D_j alpha_before/alpha with v = D_j f, alpha = alpha_before + v f, gain = v/alpha.  Written as a
 * difference where that keeps all digits (the last million updates), as a quotient where the update takes
 * more than half of D_j (the first few). */
static ALWAYS_INLINE void shrink(float* d, float* d_lo, float f, float v, float gain, float kept_frac) {
  if (f * gain <= 0.5f) {
    add_to(d, d_lo, -v * gain);
  } else {
    *d *= kept_frac;
    *d_lo = 0.0f;
  }
}

/* Bierman's update of U and D for z = h'x + v, one column at a time.  gain[] becomes P h = S K; returns 1/S.
 */
static ALWAYS_INLINE float update_factors(imucal_kf_t* kf, uint32_t n, const float* h, float* gain,
                                          float* variance) {
  float alpha = kf->config.r;
  float inverse = 0.0f;
  float* column = kf->u;
  for (uint32_t j = 0; j < n; column += j, j++) {
    float f = h[j];
    for (uint32_t i = 0; i < j; i++) f += column[i] * h[i];
    float v = kf->d[j] * f;
    float lambda = -f * inverse;
    float before = alpha;
    alpha += v * f;
    inverse = 1.0f / alpha;
    shrink(&kf->d[j], &kf->d_lo[j], f, v, v * inverse, before * inverse);
    for (uint32_t i = 0; i < j; i++) {
      float u = column[i];
      column[i] = u + gain[i] * lambda;
      gain[i] += u * v;
    }
    gain[j] = v;
  }
  *variance = alpha;
  return inverse;
}

static void count_innovation(imucal_kf_t* kf, float innovation, float variance, float inverse) {
  imucal_kf_stats_t* s = &kf->stats;
  float normalised = innovation * inverse;
  add_to(&s->nis_sum, &s->nis_lo, innovation * normalised);
  add_to(&s->weighted_sum, &s->weighted_lo, normalised);
  add_to(&s->inverse_sum, &s->inverse_lo, inverse);
  if (!kf->is_last_missing) add_to(&s->lag1_sum, &s->lag1_lo, s->innovation * normalised);
  s->innovation = innovation;
  s->innovation_variance = variance;
  s->n++;
  kf->is_last_missing = false;
}

/* One second.  n = n_states(kf): a constant in the copy whose loops are to be unrolled; same operations, same
 * bits. */
static ALWAYS_INLINE void measure(imucal_kf_t* kf, uint32_t n, float z, float tn) {
  predict(kf, n, kf->config.m, kf->config.q);
  float h[IMUCAL_KF_MAX_STATES];
  float gain[IMUCAL_KF_MAX_STATES];
  h[0] = 1.0f;
  chebyshev(tn, n, h);
  float innovation = z;
  for (uint32_t i = 1; i < n; i++) innovation -= h[i] * kf->x[i];
  innovation -= kf->x[0];
  float variance;
  float inverse = update_factors(kf, n, h, gain, &variance);
  float step = innovation * inverse;
  for (uint32_t i = 0; i < n; i++) add_to(&kf->x[i], &kf->x_lo[i], gain[i] * step);
  count_innovation(kf, innovation, variance, inverse);
}

imucal_status imucal_kf_update(imucal_kf_t* kf, float z, float temp_degc) {
  if (!kf->is_ready) return IMUCAL_ERR_STATE;
  float tn = (temp_degc - kf->config.t0_degc) * kf->inv_range;
  if (!imucal_is_within(z, -IMUCAL_KF_MAX_RATE, IMUCAL_KF_MAX_RATE) ||
      !imucal_is_within(tn, -IMUCAL_KF_MAX_TN, IMUCAL_KF_MAX_TN)) {
    kf->stats.n_refused++;
    return imucal_is_finite(z) && imucal_is_finite(temp_degc) ? IMUCAL_ERR_RANGE : IMUCAL_ERR_NOT_FINITE;
  }
  if (n_states(kf) == IMUCAL_KF_UNROLLED_STATES)
    measure(kf, IMUCAL_KF_UNROLLED_STATES, z, tn);
  else
    measure(kf, n_states(kf), z, tn);
  return IMUCAL_OK;
}

imucal_status imucal_kf_skip(imucal_kf_t* kf, uint32_t n_s) {
  if (!kf->is_ready) return IMUCAL_ERR_STATE;
  if (n_s > IMUCAL_KF_MAX_GAP_S) return IMUCAL_ERR_PERIOD;
  if (n_s == 0) return IMUCAL_OK;
  kf->stats.n_missed += n_s;
  kf->is_last_missing = true;
  /* Steps (m, q) compose: m = m1 + m2 - m1 m2, q = (1 - m2)^2 q1 + q2.  (total) gathers the set bits of n_s,
   * (power) doubles; both are powers of the same step, so that their order does not matter. */
  float m = 0.0f, q = 0.0f;
  float power_m = kf->config.m, power_q = kf->config.q;
  for (uint32_t round = 0; round < MAX_GAP_ROUNDS && n_s != 0; round++, n_s >>= 1) {
    if ((n_s & 1u) != 0) {
      float keep = 1.0f - power_m;
      q = keep * keep * q + power_q;
      m = m + power_m - m * power_m;
    }
    float keep = 1.0f - power_m;
    power_q = keep * keep * power_q + power_q;
    power_m = power_m + power_m - power_m * power_m;
  }
  predict(kf, n_states(kf), m, q);
  return IMUCAL_OK;
}

IMUCAL_COLD imucal_status imucal_kf_new_run(imucal_kf_t* kf, float turn_on_sigma) {
  if (!kf->is_ready) return IMUCAL_ERR_STATE;
  if (!imucal_is_within(turn_on_sigma, 0.0f, MAX_PRIOR)) return IMUCAL_ERR_RANGE;
  /* Forget e: without row and column 0 the factors of the rest remain; e then stands alone. */
  float* row0 = kf->u;
  for (uint32_t j = 1; j < n_states(kf); row0 += j, j++) *row0 = 0.0f;
  kf->x[0] = 0.0f;
  kf->x_lo[0] = 0.0f;
  kf->d[0] = kf->config.markov_variance;
  kf->d_lo[0] = 0.0f;
  /* b0, now the first of the rest, takes added variance in its own factor. */
  add_to(&kf->d[1], &kf->d_lo[1], turn_on_sigma * turn_on_sigma);
  kf->is_last_missing = true;
  return IMUCAL_OK;
}

/* b_i = sum_k c_k (coefficient of Tn^i in T_k).  Row k from rows k-1 and k-2 by the recurrence; all integers.
 */
IMUCAL_COLD float imucal_kf_coefficient(const imucal_kf_t* kf, uint32_t i) {
  if (i > kf->config.order) return 0.0f;
  float before[IMUCAL_MAX_COEFF + 1] = {0.0f};    /* T_k-1, one place up: [p + 1] is of Tn^p */
  float row[IMUCAL_MAX_COEFF + 1] = {0.0f, 1.0f}; /* T_0 */
  float sum = 0.0f;
  for (uint32_t k = 0; k <= kf->config.order; k++) {
    sum += row[i + 1] * kf->x[k + 1];
    float factor = k == 0 ? 1.0f : 2.0f;
    for (uint32_t p = IMUCAL_MAX_COEFF; p > 0; p--) {
      float next = factor * row[p - 1] - before[p];
      before[p] = row[p];
      row[p] = next;
    }
  }
  return sum;
}

float imucal_kf_bias(const imucal_kf_t* kf, float temp_degc) {
  float h[IMUCAL_KF_MAX_STATES];
  chebyshev((temp_degc - kf->config.t0_degc) * kf->inv_range, n_states(kf), h);
  float bias = 0.0f;
  for (uint32_t i = n_states(kf) - 1; i > 0; i--) bias += h[i] * kf->x[i];
  return bias;
}

float imucal_kf_bias_variance(const imucal_kf_t* kf, float temp_degc) {
  float h[IMUCAL_KF_MAX_STATES];
  chebyshev((temp_degc - kf->config.t0_degc) * kf->inv_range, n_states(kf), h);
  float variance = 0.0f;
  const float* column = kf->u;
  for (uint32_t j = 1; j < n_states(kf); column += j, j++) {
    float projection = h[j];
    for (uint32_t i = 1; i < j; i++) projection += column[i] * h[i];
    variance += kf->d[j] * projection * projection;
  }
  return variance;
}

float imucal_kf_bias_sigma(const imucal_kf_t* kf, float temp_degc) {
  return imucal_sqrtf(imucal_kf_bias_variance(kf, temp_degc));
}

float imucal_kf_worst_sigma(const imucal_kf_t* kf, float lo_degc, float hi_degc, uint32_t n_grid,
                            float* worst_temp_degc) {
  float worst = -1.0f;
  float step = n_grid > 1 ? (hi_degc - lo_degc) / (float)(n_grid - 1) : 0.0f;
  for (uint32_t i = 0; i < n_grid; i++) {
    float temp_degc = lo_degc + (float)i * step;
    float variance = imucal_kf_bias_variance(kf, temp_degc);
    if (variance <= worst) continue;
    worst = variance;
    if (worst_temp_degc != NULL) *worst_temp_degc = temp_degc;
  }
  return imucal_sqrtf(worst);
}

float imucal_kf_mean_nis(const imucal_kf_t* kf) {
  return kf->stats.n == 0 ? 0.0f : kf->stats.nis_sum / (float)kf->stats.n;
}

float imucal_kf_lag1(const imucal_kf_t* kf) {
  return kf->stats.nis_sum > 0.0f ? kf->stats.lag1_sum / kf->stats.nis_sum : 0.0f;
}
