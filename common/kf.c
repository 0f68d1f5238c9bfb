// SPDX-License-Identifier: MIT
#include "kf.h"

#include "num.h"

#define MAX_VARIANCE 1e14f
#define MAX_PRIOR 1e6f

/* |value| <= limit, false for NaN: magnitudes of floats are ordered as their bits. */
static inline bool is_at_most(float value, float limit) {
  return imucal_bits_from_float(value) << 1 <= imucal_bits_from_float(limit) << 1;
}

static inline bool is_r_ratio(float value) {
  const uint32_t least = imucal_bits_from_float(1.0f / IMUCAL_KF_MAX_R_RATIO);
  return imucal_bits_from_float(value) - least <= imucal_bits_from_float(IMUCAL_KF_MAX_R_RATIO) - least;
}

IMUCAL_COLD static imucal_status check_config(const imucal_kf_config_t* c) {
  if (c->order < 1 || c->order > IMUCAL_MAX_ORDER) return IMUCAL_ERR_ORDER;
  if (!imucal_is_within(c->t0_degc, -1000.0f, 1000.0f)) return IMUCAL_ERR_SPAN;
  if (!imucal_is_within(c->range_degc, 1e-3f, 2000.0f)) return IMUCAL_ERR_SPAN;
  if (!imucal_is_within(c->m, 1e-30f, 1.0f)) return IMUCAL_ERR_MODEL;
  if (!imucal_is_within(c->q, 0.0f, MAX_VARIANCE)) return IMUCAL_ERR_MODEL;
  if (!imucal_is_within(c->r, 1e-12f, MAX_VARIANCE)) return IMUCAL_ERR_MODEL;
  if (!imucal_is_within(c->markov_variance, 0.0f, MAX_VARIANCE)) return IMUCAL_ERR_MODEL;
  if (!imucal_is_within(c->prior_sigma, 1e-6f, MAX_PRIOR)) return IMUCAL_ERR_RANGE;
  return IMUCAL_OK;
}

/* T_k = sum_i t_ki Tn^i; here t_ki/t_ii, i < k, in the order of kf_t.r, and t_kk = 2^(k-1), t_00 = 1. */
static const int8_t chebyshev[IMUCAL_KF_MAX_R] = {0, -1, 0, 1, 0, 0, -3, 0, 5, 0, -4, 0, 0, -5, 0};

/* Where R_ik stands in kf_t.r, i < k: after i rows of 5, 4, .. entries. */
static uint32_t place_of(uint32_t i, uint32_t k) {
  return i * IMUCAL_MAX_ORDER - i * (i + 1) / 2 + k - 1;
}

static float leading(uint32_t k) {
  return (float)(((1u << k) + 1u) >> 1);
}

/* The prior is independent b_i of one variance, b_i = sum_k t_ki c_k: one measurement each, already
 * triangular. */
IMUCAL_COLD static void set_prior(imucal_kf_t* kf) {
  for (uint32_t i = 0; i < IMUCAL_KF_MAX_R; i++) kf->r[i] = (float)chebyshev[i];
  for (uint32_t k = 0; k <= kf->config.order; k++) {
    const float weight = leading(k) / kf->config.prior_sigma;
    kf->row[k].d.hi = weight * weight;
  }
}

/* e anew: its stationary variance, and no dependence on what was seen (V = 0). */
IMUCAL_COLD static void forget_markov(imucal_kf_t* kf) {
  kf->e = 0.0f;
  kf->e_variance = kf->config.markov_variance;
  kf->one_plus_v0 = (imucal_kf_pair_t){1.0f, 0.0f};
  for (uint32_t k = 0; k < IMUCAL_MAX_ORDER; k++) kf->v[k] = 0.0f;
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

/* ---- one second ----
 *
 * From the paper's filter to this one.  Section III has the state [b_0 .. b_M  e]' and the measurement
 *   z = b_0 + b_1 Tn + .. + b_M Tn^M + e + v,   var v = r,
 *   e <- (1 - m) e + w, var w = q,   b_i constant.
 * With c_k of Chebyshev's T_k in place of b_i of Tn^i, z = T' c + e + v, T = [T_0(Tn) .. T_M(Tn)]'.  That is a filter
 * for e alone, disturbed by constants c; Friedland (1969) takes the two apart without approximation:
 *   first filter   Kalman's for e, as though z were e + v.  Its estimate depends on the c that it does not know of as
 *                  e(c) = e + V' c, so that its innovation is
 *                    z - e = (T + V)' c + white noise of variance S.                               [F]
 *   second filter  [F] is a linear regression of the constants c with white noise: recursive least squares, here by
 *                  rotations (Gentleman 1973).
 * With order 3 these are the paper's five states: e, and c_0 .. c_3.
 *
 * Up to the next section floats meet + - * / and a choice of two only: Monte Carlo compiles this very text with eight
 * floats side by side in place of each (host/lib/analysis/montecarlo/lanes.h). */

#define FOLD_N 256u /* measurements between two folds; a power of two */

static inline float sum_of(imucal_kf_pair_t pair) {
  return pair.hi + pair.lo;
}

/* hi + lo -> the same sum with hi as large as can be (fast two-sum).  Between two folds terms are added to lo
 * alone: lo stays small beside hi and loses nothing, except before the first fold, where it is the whole
 * history. */
IMUCAL_COLD static void fold(float* hi, float* lo) {
  const float sum = *hi + *lo;
  *lo -= sum - *hi;
  *hi = sum;
}

IMUCAL_COLD static void fold_all(imucal_kf_t* kf) {
  fold(&kf->one_plus_v0.hi, &kf->one_plus_v0.lo);
  for (uint32_t k = 0; k <= kf->config.order; k++) {
    fold(&kf->row[k].d.hi, &kf->row[k].d.lo);
    fold(&kf->row[k].x.hi, &kf->row[k].x.lo);
  }
  for (uint32_t i = 0; i < IMUCAL_KF_N_SUMS; i++) fold(&kf->stats.sum[i], &kf->stats.sum_lo[i]);
}

/* First filter.  Takes z; gives h = T + V of [F], and 1/S.  Returns the left-hand side of [F]. */
static inline float follow_markov(imucal_kf_t* kf, float z, float tn, float r, float* h, float* weight) {
  const float m = kf->config.m;
  /* Time update: e <- (1 - m) e,  P <- (1 - m)^2 P + q. */
  const float e = kf->e - m * kf->e;
  const float variance = kf->e_variance + (kf->config.q - kf->forgotten * kf->e_variance);
  /* Measurement update: S = P + r,  K = P/S,  e <- e + K (z - e),  P <- (1 - K) P = r K. */
  const float w = 1.0f / (variance + r);
  const float gain = variance * w;
  const float innovation = z - e;
  kf->e = e + gain * innovation;
  kf->e_variance = r * gain;
  /* V goes with e, for z less T' c: time update V <- (1 - m) V, then h = T + V, measurement update V <- V - K h.
   * For k = 0, T_0 = 1: h_0 = 1 + V_0 <- 1 + (1 - m) V_0 = (1 + V_0) + m - m (1 + V_0). */
  const float h_0 = sum_of(kf->one_plus_v0);
  const float forgotten = m - m * h_0;
  h[0] = h_0 + forgotten;
  kf->one_plus_v0.lo += forgotten - gain * h[0];
  /* T_k+1 = T_k + step_k,  step_k = step_k-1 + 2 (Tn - 1) T_k (Reinsch's form of T_k+1 = 2 Tn T_k - T_k-1). */
  float step = tn - 1.0f, t_k = tn;
  const float slope = step + step;
  for (uint32_t k = 1; k <= kf->config.order; k++) {
    float* v_k = &kf->v[k - 1];
    const float followed = *v_k - m * *v_k;
    h[k] = t_k + followed;
    *v_k = followed - gain * h[k];
    if (k == kf->config.order) break; /* the next step is of no use, and dear without an FPU */
    step += slope * t_k;
    t_k += step;
  }
  *weight = w;
  return innovation;
}

/* Second filter: the equation h' c = y, of weight w = 1/variance, joins R c = x, of weights D.  Row after row takes its
 * part (Gentleman 1973, eqs. for the square-root-free rotation of row k with the new row):
 *   D_k <- D_k + w h_k^2 =: D',   gain = w h_k/D',   w <- w D_k/D',
 *   y <- y - h_k x_k,  x_k <- x_k + gain y,          h_j <- h_j - h_k R_kj,  R_kj <- R_kj + gain h_j   (j > k).
 * What is left of y is the innovation of both filters, what is left of w the reciprocal of its variance. */
static inline float join(imucal_kf_t* kf, float* h, float y, float* weight) {
  const uint32_t order = kf->config.order;
  float w = *weight;
  float* r_kj = kf->r;
  for (uint32_t k = 0; k <= order; k++) {
    imucal_kf_row_t* row = &kf->row[k];
    const float h_k = h[k];
    const float wh = w * h_k;
    const float d_before = sum_of(row->d);
    row->d.lo += wh * h_k;
    const float inverse = 1.0f / sum_of(row->d);
    const float gain = wh * inverse;
    w *= d_before * inverse;
    y -= h_k * sum_of(row->x);
    row->x.lo += gain * y;
    for (uint32_t j = k + 1; j <= order; j++) {
      h[j] -= h_k * *r_kj;
      *r_kj++ += gain * h[j];
    }
    r_kj += IMUCAL_MAX_ORDER - order;
  }
  *weight = w;
  return y;
}

/* Both filters.  Returns the innovation; *weight: the reciprocal of its variance. */
static inline float learn(imucal_kf_t* kf, float z, float tn, float r, float* weight) {
  float h[IMUCAL_MAX_COEFF];
  const float y = follow_markov(kf, z, tn, r, h, weight);
  return join(kf, h, y, weight);
}

static inline void count_innovation(imucal_kf_stats_t* s, float innovation, float weight) {
  const float normalised = innovation * weight;
  s->sum_lo[IMUCAL_KF_NIS] += innovation * normalised;
  s->sum_lo[IMUCAL_KF_WEIGHTED] += normalised;
  s->sum_lo[IMUCAL_KF_INVERSE] += weight;
  /* The smaller weight of the two: the first innovation, as large as what was not known beforehand, counts little. */
  const float least = weight < s->innovation_weight ? weight : s->innovation_weight;
  s->sum_lo[IMUCAL_KF_LAG1] += s->innovation * innovation * least;
  s->innovation = innovation;
  s->innovation_weight = weight;
}

/* A second that was found good. */
static inline void take_second(imucal_kf_t* kf, float z, float tn, float r) {
  float weight;
  const float innovation = learn(kf, z, tn, r, &weight);
  count_innovation(&kf->stats, innovation, weight);
  if (++kf->stats.n % FOLD_N == 0) fold_all(kf);
}

/* ---- what callers ask for ---- */

imucal_status imucal_kf_update_scaled(imucal_kf_t* kf, float z, float temp_degc, float r_ratio) {
  if (!kf->is_ready) return IMUCAL_ERR_STATE;
  const float tn = (temp_degc - kf->config.t0_degc) * kf->inv_range;
  if (!is_at_most(z, IMUCAL_KF_MAX_RATE) || !is_at_most(tn, IMUCAL_KF_MAX_TN) || !is_r_ratio(r_ratio)) {
    kf->stats.n_refused++;
    return imucal_is_finite(z) && imucal_is_finite(temp_degc) && imucal_is_finite(r_ratio) ? IMUCAL_ERR_RANGE
                                                                                           : IMUCAL_ERR_NOT_FINITE;
  }
  take_second(kf, z, tn, kf->config.r * r_ratio);
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
  kf->e -= m * kf->e;
  kf->e_variance += kf->config.q * (forgotten / kf->forgotten) - forgotten * kf->e_variance;
  kf->one_plus_v0.lo += m - m * sum_of(kf->one_plus_v0);
  for (uint32_t k = 0; k < kf->config.order; k++) kf->v[k] -= m * kf->v[k];
  return IMUCAL_OK;
}

IMUCAL_COLD imucal_status imucal_kf_new_run(imucal_kf_t* kf, float turn_on_sigma) {
  if (!kf->is_ready) return IMUCAL_ERR_STATE;
  if (!imucal_is_within(turn_on_sigma, 0.0f, MAX_PRIOR)) return IMUCAL_ERR_RANGE;
  forget_markov(kf);
  /* Row 0 is c0 given the others, of variance 1/D: it takes the added variance alone. */
  const float widened = 1.0f + turn_on_sigma * turn_on_sigma * sum_of(kf->row[0].d);
  kf->row[0].d.hi /= widened;
  kf->row[0].d.lo /= widened;
  return IMUCAL_OK;
}

/* Solve R' y = h in place, h[0 .. order]: then h' c = sum y_j x_j and var(h' c) = sum y_j^2/D_j. */
static void solve(const imucal_kf_t* kf, float* h) {
  const uint32_t order = kf->config.order;
  const float* r_jk = kf->r;
  for (uint32_t j = 0; j < order; j++, r_jk += IMUCAL_MAX_ORDER - order) {
    const float h_j = h[j];
    for (uint32_t k = j + 1; k <= order; k++) h[k] -= *r_jk++ * h_j;
  }
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
  for (uint32_t k = kf->config.order + 1u; k-- > 0;) sum += y[k] * sum_of(kf->row[k].x);
  return sum;
}

IMUCAL_COLD float imucal_kf_coefficient(const imucal_kf_t* kf, uint32_t i) {
  if (i > kf->config.order) return 0.0f;
  float h[IMUCAL_MAX_COEFF];
  for (uint32_t k = 0; k <= kf->config.order; k++)
    h[k] = k < i ? 0.0f : k == i ? 1.0f : (float)chebyshev[place_of(i, k)];
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
  for (uint32_t k = 0; k <= kf->config.order; k++) variance[k] = 1.0f / sum_of(kf->row[k].d);
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

/* ---- the filter's numbers as the link carries them ---- */

IMUCAL_COLD float imucal_kf_r(const imucal_kf_t* kf, uint32_t i, uint32_t k) {
  return kf->r[place_of(i, k)];
}

IMUCAL_COLD void imucal_kf_get_state(const imucal_kf_t* kf, imucal_kf_state_t* state) {
  float* u = state->u;
  state->x[0] = kf->one_plus_v0.hi;
  state->x_lo[0] = kf->one_plus_v0.lo;
  state->d[0] = kf->e_variance;
  state->d_lo[0] = 0.0f;
  *u++ = kf->e;
  for (uint32_t k = 0; k < IMUCAL_MAX_ORDER; k++) *u++ = kf->v[k];
  for (uint32_t k = 0; k <= IMUCAL_MAX_ORDER; k++) {
    state->x[k + 1] = kf->row[k].x.hi;
    state->x_lo[k + 1] = kf->row[k].x.lo;
    state->d[k + 1] = kf->row[k].d.hi;
    state->d_lo[k + 1] = kf->row[k].d.lo;
    for (uint32_t i = 0; i < k; i++) *u++ = kf->r[place_of(i, k)];
  }
}

IMUCAL_COLD void imucal_kf_set_state(imucal_kf_t* kf, const imucal_kf_state_t* state) {
  const float* u = state->u;
  kf->one_plus_v0 = (imucal_kf_pair_t){state->x[0], state->x_lo[0]};
  kf->e_variance = state->d[0];
  kf->e = *u++;
  for (uint32_t k = 0; k < IMUCAL_MAX_ORDER; k++) kf->v[k] = *u++;
  for (uint32_t k = 0; k <= IMUCAL_MAX_ORDER; k++) {
    kf->row[k].x = (imucal_kf_pair_t){state->x[k + 1], state->x_lo[k + 1]};
    kf->row[k].d = (imucal_kf_pair_t){state->d[k + 1], state->d_lo[k + 1]};
    for (uint32_t i = 0; i < k; i++) kf->r[place_of(i, k)] = *u++;
  }
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
