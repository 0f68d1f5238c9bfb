// SPDX-License-Identifier: MIT
#include "kf.h"

#include "num.h"

#define MAX_VARIANCE 1e14f
#define MAX_PRIOR 1e6f
#define FOLD_N 256u /* measurements between two folds; a power of two */

/* hi + lo -> the same sum with hi as large as can be (fast two-sum).  Between two folds terms are added to lo
 * alone: lo stays small beside hi and loses nothing, except before the first fold, where it is the whole
 * history. */
IMUCAL_COLD static void fold(float* hi, float* lo, uint32_t n) {
  for (uint32_t i = 0; i < n; i++) {
    const float sum = hi[i] + lo[i];
    lo[i] -= sum - hi[i];
    hi[i] = sum;
  }
}

/* |value| <= limit, false for NaN: magnitudes of floats are ordered as their bits. */
static inline bool is_at_most(float value, float limit) {
  return imucal_bits_from_float(value) << 1 <= imucal_bits_from_float(limit) << 1;
}

static inline bool is_r_ratio(float value) {
  const uint32_t least = imucal_bits_from_float(1.0f / IMUCAL_KF_MAX_R_RATIO);
  return imucal_bits_from_float(value) - least <= imucal_bits_from_float(IMUCAL_KF_MAX_R_RATIO) - least;
}

/* What the numbers of a configuration may be, in the order of the struct. */
#define N_NUMBERS 7
static const struct {
  float lo, hi;
} limit[N_NUMBERS] = {{-1000.0f, 1000.0f},    {1e-3f, 2000.0f},     {1e-30f, 1.0f},    {0.0f, MAX_VARIANCE},
                      {1e-12f, MAX_VARIANCE}, {0.0f, MAX_VARIANCE}, {1e-6f, MAX_PRIOR}};
static const int8_t refusal[N_NUMBERS] = {IMUCAL_ERR_SPAN,  IMUCAL_ERR_SPAN,  IMUCAL_ERR_MODEL,
                                          IMUCAL_ERR_MODEL, IMUCAL_ERR_MODEL, IMUCAL_ERR_MODEL,
                                          IMUCAL_ERR_RANGE};
typedef char numbers_are_contiguous[sizeof(imucal_kf_config_t) ==
                                            offsetof(imucal_kf_config_t, t0_degc) + N_NUMBERS * sizeof(float)
                                        ? 1
                                        : -1];

IMUCAL_COLD static imucal_status check_config(const imucal_kf_config_t* c) {
  if (c->order < 1 || c->order > IMUCAL_MAX_ORDER) return IMUCAL_ERR_ORDER;
  const float* number = (const float*)(const void*)((const char*)c + offsetof(imucal_kf_config_t, t0_degc));
  for (uint32_t i = 0; i < N_NUMBERS; i++)
    if (!imucal_is_within(number[i], limit[i].lo, limit[i].hi)) return (imucal_status)refusal[i];
  return IMUCAL_OK;
}

/* T_k = sum_i t_ki Tn^i; here t_ki/t_ii, i < k, by columns as in kf_t.u, and t_kk = 2^(k-1), t_00 = 1. */
static const int8_t chebyshev[] = {0, -1, 0, 0, -3, 0, 1, 0, -4, 0, 0, 5, 0, -5, 0};

static float leading(uint32_t k) {
  return (float)(((1u << k) + 1u) >> 1);
}

/* The prior is independent b_i of one variance, b_i = sum_k t_ki c_k: one measurement each, already
 * triangular. */
IMUCAL_COLD static void set_prior(imucal_kf_t* kf) {
  for (uint32_t i = 0; i < sizeof chebyshev; i++) kf->u[IMUCAL_MAX_COEFF + i] = (float)chebyshev[i];
  for (uint32_t k = 0; k <= kf->config.order; k++) {
    const float weight = leading(k) / kf->config.prior_sigma;
    kf->d[k + 1] = weight * weight;
  }
}

/* e anew: its stationary variance, and no dependence on what was seen (V = 0). */
IMUCAL_COLD static void forget_markov(imucal_kf_t* kf) {
  for (uint32_t k = 0; k <= IMUCAL_MAX_ORDER; k++) kf->u[k] = 0.0f;
  kf->x[0] = 1.0f;
  kf->x_lo[0] = 0.0f;
  kf->d[0] = kf->config.markov_variance;
  kf->stats.innovation = 0.0f; /* no lag-1 product */
}

IMUCAL_COLD imucal_status imucal_kf_init(imucal_kf_t* kf, const imucal_kf_config_t* config) {
  if (kf == NULL || config == NULL) return IMUCAL_ERR_ARGUMENT;
  imucal_status status = check_config(config);
  if (status != IMUCAL_OK) return status;
  *kf = (imucal_kf_t){0};
  kf->config = *config;
  kf->inv_range = 1.0f / config->range_degc;
  kf->forgotten = config->m * (2.0f - config->m);
  forget_markov(kf);
  set_prior(kf);
  kf->is_ready = true;
  return IMUCAL_OK;
}

/* One second of both filters.  Returns the innovation; *weight: the reciprocal of its variance.
 *
 * First filter: e alone, as though z held no polynomial.  What of T_k it has not followed is h_k = T_k + V_k,
 * so that z - e~ = h' c + white noise of variance 1/w.  Second filter: that joins R, D, x by Givens
 * rotations, each h_k through the rows before it.  V_0 is near -1 and T_0 never changes: 1 + V_0 is kept, and
 * loses nothing. */
static inline float learn(imucal_kf_t* kf, float z, float tn, float r, float* weight) {
  const float m = kf->config.m;
  const float variance = kf->d[0] + (kf->config.q - kf->forgotten * kf->d[0]);
  float w = 1.0f / (variance + r);
  const float gain_e = variance * w;
  kf->d[0] = r * gain_e;
  float* v = kf->u;
  const float e = *v - m * *v;
  float y = z - e;
  *v++ = e + gain_e * y;

  float h[2 * IMUCAL_MAX_COEFF]; /* h_0 .. h_M; half-way on the gains of their rows */
  float* const last = h + kf->config.order;
  float* at = h;
  float* u = kf->u + IMUCAL_MAX_COEFF;
  float step = tn - 1.0f, t_k = tn; /* T_k+1 = T_k + step_k, step_k = step_k-1 + 2 (tn - 1) T_k (Reinsch) */
  const float slope = step + step;
  const float v_0 = kf->x[0] + kf->x_lo[0];
  const float forgotten = m - m * v_0;
  float h_k = v_0 + forgotten;
  kf->x_lo[0] += forgotten - gain_e * h_k;
  for (uint32_t k = 1;; k++) {
    const float wh = w * h_k;
    const float d_before = kf->d[k] + kf->d_lo[k];
    kf->d_lo[k] += wh * h_k;
    const float inverse = 1.0f / (kf->d[k] + kf->d_lo[k]);
    const float gain = wh * inverse;
    w *= d_before * inverse;
    y -= h_k * (kf->x[k] + kf->x_lo[k]);
    kf->x_lo[k] += gain * y;
    if (at == last) break;
    at[IMUCAL_MAX_COEFF] = gain;
    *at++ = h_k;
    const float followed = *v - m * *v;
    h_k = t_k + followed;
    *v++ = followed - gain_e * h_k;
    step += slope * t_k;
    t_k += step;
    const float* before = h;
    do {
      h_k -= *before * *u;
      *u++ += before[IMUCAL_MAX_COEFF] * h_k;
    } while (++before != at);
  }
  *weight = w;
  return y;
}

static inline void count_innovation(imucal_kf_stats_t* s, float innovation, float weight) {
  const float normalised = innovation * weight;
  s->sum_lo[IMUCAL_KF_NIS] += innovation * normalised;
  s->sum_lo[IMUCAL_KF_WEIGHTED] += normalised;
  s->sum_lo[IMUCAL_KF_INVERSE] += weight;
  s->sum_lo[IMUCAL_KF_LAG1] += s->innovation * normalised;
  s->innovation = innovation;
  s->innovation_weight = weight;
}

imucal_status imucal_kf_update_scaled(imucal_kf_t* kf, float z, float temp_degc, float r_ratio) {
  if (!kf->is_ready) return IMUCAL_ERR_STATE;
  const float tn = (temp_degc - kf->config.t0_degc) * kf->inv_range;
  if (!is_at_most(z, IMUCAL_KF_MAX_RATE) || !is_at_most(tn, IMUCAL_KF_MAX_TN) || !is_r_ratio(r_ratio)) {
    kf->stats.n_refused++;
    return imucal_is_finite(z) && imucal_is_finite(temp_degc) && imucal_is_finite(r_ratio)
               ? IMUCAL_ERR_RANGE
               : IMUCAL_ERR_NOT_FINITE;
  }
  float weight;
  const float innovation = learn(kf, z, tn, kf->config.r * r_ratio, &weight);
  count_innovation(&kf->stats, innovation, weight);
  if (++kf->stats.n % FOLD_N != 0) return IMUCAL_OK;
  fold(kf->x, kf->x_lo, IMUCAL_KF_MAX_STATES);
  fold(kf->d, kf->d_lo, IMUCAL_KF_MAX_STATES);
  fold(kf->stats.sum, kf->stats.sum_lo, IMUCAL_KF_N_SUMS);
  return IMUCAL_OK;
}

imucal_status imucal_kf_skip(imucal_kf_t* kf, uint32_t n_s) {
  if (!kf->is_ready) return IMUCAL_ERR_STATE;
  if (n_s > IMUCAL_KF_MAX_GAP_S) return IMUCAL_ERR_PERIOD;
  if (n_s == 0) return IMUCAL_OK;
  kf->stats.n_missed += n_s;
  kf->stats.innovation = 0.0f; /* no lag-1 product across the gap */
  /* Steps compose: m = m1 + m2 - m1 m2; q goes with m (2 - m).  `power` doubles, m gathers the set bits of
   * n_s. */
  float m = 0.0f, power = kf->config.m;
  for (; n_s != 0; n_s >>= 1) {
    if ((n_s & 1u) != 0) m += power - m * power;
    power += power - power * power;
  }
  const float forgotten = m * (2.0f - m);
  kf->d[0] += kf->config.q * (forgotten / kf->forgotten) - forgotten * kf->d[0];
  kf->x_lo[0] += m - m * (kf->x[0] + kf->x_lo[0]);
  for (uint32_t k = 0; k <= kf->config.order; k++) kf->u[k] -= m * kf->u[k];
  return IMUCAL_OK;
}

IMUCAL_COLD imucal_status imucal_kf_new_run(imucal_kf_t* kf, float turn_on_sigma) {
  if (!kf->is_ready) return IMUCAL_ERR_STATE;
  if (!imucal_is_within(turn_on_sigma, 0.0f, MAX_PRIOR)) return IMUCAL_ERR_RANGE;
  forget_markov(kf);
  /* Row 0 is c0 given the others, of variance 1/D: it takes the added variance alone. */
  const float widened = 1.0f + turn_on_sigma * turn_on_sigma * (kf->d[1] + kf->d_lo[1]);
  kf->d[1] /= widened;
  kf->d_lo[1] /= widened;
  return IMUCAL_OK;
}

/* Solve R' y = h in place, h[0 .. order]: then h' c = sum y_j x_j and var(h' c) = sum y_j^2/D_j. */
static void solve(const imucal_kf_t* kf, float* h) {
  const float* u = kf->u + IMUCAL_MAX_COEFF;
  for (uint32_t k = 1; k <= kf->config.order; k++)
    for (uint32_t j = 0; j < k; j++) h[k] -= *u++ * h[j];
}

static void solve_at(const imucal_kf_t* kf, float temp_degc, float* h) {
  const float tn = (temp_degc - kf->config.t0_degc) * kf->inv_range;
  float before = tn, now = 1.0f;
  for (uint32_t k = 0; k <= kf->config.order; k++) {
    h[k] = now;
    const float next = 2.0f * tn * now - before;
    before = now;
    now = next;
  }
  solve(kf, h);
}

static float estimate(const imucal_kf_t* kf, const float* y) {
  float sum = 0.0f;
  for (uint32_t k = kf->config.order + 1u; k > 0; k--) sum += y[k - 1] * (kf->x[k] + kf->x_lo[k]);
  return sum;
}

IMUCAL_COLD float imucal_kf_coefficient(const imucal_kf_t* kf, uint32_t i) {
  if (i > kf->config.order) return 0.0f;
  float h[IMUCAL_MAX_COEFF];
  for (uint32_t k = 0; k <= kf->config.order; k++)
    h[k] = k < i ? 0.0f : k == i ? 1.0f : (float)chebyshev[k * (k - 1) / 2 + i];
  solve(kf, h);
  return leading(i) * estimate(kf, h);
}

IMUCAL_COLD float imucal_kf_bias(const imucal_kf_t* kf, float temp_degc) {
  float h[IMUCAL_MAX_COEFF];
  solve_at(kf, temp_degc, h);
  return estimate(kf, h);
}

/* The variances of the rows, 1/D. */
static void invert(const imucal_kf_t* kf, float* variance) {
  for (uint32_t k = 0; k <= kf->config.order; k++) variance[k] = 1.0f / (kf->d[k + 1] + kf->d_lo[k + 1]);
}

static float variance_at(const imucal_kf_t* kf, const float* variance, float temp_degc) {
  float y[IMUCAL_MAX_COEFF];
  solve_at(kf, temp_degc, y);
  float sum = 0.0f;
  for (uint32_t k = 0; k <= kf->config.order; k++) sum += y[k] * y[k] * variance[k];
  return sum;
}

float imucal_kf_bias_variance(const imucal_kf_t* kf, float temp_degc) {
  float variance[IMUCAL_MAX_COEFF];
  invert(kf, variance);
  return variance_at(kf, variance, temp_degc);
}

float imucal_kf_bias_sigma(const imucal_kf_t* kf, float temp_degc) {
  return imucal_sqrtf(imucal_kf_bias_variance(kf, temp_degc));
}

float imucal_kf_worst_sigma(const imucal_kf_t* kf, float lo_degc, float hi_degc, uint32_t n_grid,
                            float* worst_temp_degc) {
  float row_variance[IMUCAL_MAX_COEFF];
  invert(kf, row_variance);
  float worst = -1.0f;
  float step = n_grid > 1 ? (hi_degc - lo_degc) / (float)(n_grid - 1) : 0.0f;
  for (uint32_t i = 0; i < n_grid; i++) {
    float temp_degc = lo_degc + (float)i * step;
    float variance = variance_at(kf, row_variance, temp_degc);
    if (variance <= worst) continue;
    worst = variance;
    if (worst_temp_degc != NULL) *worst_temp_degc = temp_degc;
  }
  return imucal_sqrtf(worst);
}

float imucal_kf_sum(const imucal_kf_t* kf, imucal_kf_sum_t which) {
  return kf->stats.sum[which] + kf->stats.sum_lo[which];
}

float imucal_kf_mean_nis(const imucal_kf_t* kf) {
  return kf->stats.n == 0 ? 0.0f : imucal_kf_sum(kf, IMUCAL_KF_NIS) / (float)kf->stats.n;
}

float imucal_kf_lag1(const imucal_kf_t* kf) {
  const float nis = imucal_kf_sum(kf, IMUCAL_KF_NIS);
  return nis > 0.0f ? imucal_kf_sum(kf, IMUCAL_KF_LAG1) / nis : 0.0f;
}

float imucal_kf_innovation_variance(const imucal_kf_t* kf) {
  return kf->stats.n == 0 ? 0.0f : 1.0f / kf->stats.innovation_weight;
}
