// SPDX-License-Identifier: MIT
/* Purpose: the recursive Kalman filter that learns the thermal polynomial of one channel (paper, Section III).
 * Data: once, the normalisation of temperature and the error model from the host; then one 1-s mean and its
 * temperature per second; out, at any time, coefficients, covariance, predicted calibration error.
 * Order: init; then per second update (or skip); read functions any time.  One struct per channel.
 * Memory: sizeof(imucal_kf_t), of it 192 bytes of filter state at order 5; no heap.  Time: p(p-1)/2 inner steps
 * and p + 1 divisions per update, p = order + 1.  Thread: one context per struct.
 *
 * Model.  M = order, e first-order Gauss-Markov, the coefficients constant:
 *   z = e + b0 + b1 Tn + .. + bM Tn^M + v,  Tn = (T - t0)/range,  var v = r = (60 arw)^2/dt,
 *   e' = (1 - m) e + w,  var w = q,  m = 1 - exp(-dt/tau),  q = sigma^2 (1 - exp(-2 dt/tau)),  dt = 1 s.
 * The host computes m, q, r in double and sends them: no libm here.  m instead of phi = 1 - m, so that long time
 * constants lose nothing in float32.
 *
 * Two filters in a row, together exactly the augmented one (Friedland 1969, "separate bias estimation").  The first,
 * scalar, follows e as though z held no polynomial: its innovation is (h + V)' c + white noise, with V the response of
 * its estimate to the coefficients c, V <- (1 - m) V - K (h + V).  The second learns the constants c from it.
 *
 * The polynomial is kept in Chebyshev's, B = sum c_k T_k(Tn) = sum b_k Tn^k: they are nearly uncorrelated where powers
 * are not, so that R stays small and its rounding with it.  The prior is on b_k, exactly; imucal_kf_coefficient gives b_k.
 *
 * Numerics.  The information on c is R' D R, R unit upper triangular, D > 0, R c = x: a measurement joins by
 * square-root-free Givens rotations (Gentleman 1973), one pass that leaves the innovation and its variance behind.
 * Measurements only add to D: the covariance R^-1 D^-1 R^-T cannot become indefinite.
 * D, x and 1 + V0 are kept as unevaluated sums hi + lo, made tidy every 256 measurements: over 10 days a single
 * update changes D by one part in a million, close to the last bit of float32.  Rounding errors then do not add up
 * (measured: tests/common/test_kf.c).
 *
 * The unit of a channel is generic: dph for gyros, mg for accelerometers. */
#ifndef IMUCAL_KF_H
#define IMUCAL_KF_H

#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_KF_MAX_STATES (IMUCAL_MAX_ORDER + 2)
#define IMUCAL_KF_MAX_R (IMUCAL_MAX_COEFF * IMUCAL_MAX_ORDER / 2) /* above R's diagonal */
#define IMUCAL_KF_MAX_U (IMUCAL_MAX_COEFF + IMUCAL_KF_MAX_R)
#define IMUCAL_KF_MAX_RATE 1e7f         /* |z|, unit; beyond it is refused */
#define IMUCAL_KF_MAX_TN 1.5f           /* |Tn| of a measurement; beyond it is refused */
#define IMUCAL_KF_MAX_R_RATIO 1024.0f   /* of imucal_kf_update_scaled, and its reciprocal the least */
#define IMUCAL_KF_MAX_GAP_S 0x7FFFFFFFu /* of one imucal_kf_skip */

/* What the host decides. */
typedef struct imucal_kf_config {
  uint8_t order;         /* M, 1..IMUCAL_MAX_ORDER */
  float t0_degc;         /* centre of the temperature normalisation, -1000..1000 */
  float range_degc;      /* 1e-3..2000: Tn = (T - t0)/range; the span of interest should be |Tn| <= 1 */
  float m;               /* 1 - exp(-dt/tau), 1e-30..1; 1: e is white too */
  float q;               /* unit^2, 0..1e14 */
  float r;               /* unit^2, 1e-12..1e14 */
  float markov_variance; /* initial variance of e: its stationary sigma^2, unit^2, 0..1e14 */
  float prior_sigma;     /* initial standard deviation of every coefficient b_i, unit, 1e-6..1e6 (usual: 1e4) */
} imucal_kf_config_t;

/* Running statistics of the innovations nu with predicted variance S: a first sign on the device that the model
 * is wrong (imucal_kf_sum).  Sums hi + lo, good for 1e7 terms. */
typedef enum imucal_kf_sum {
  IMUCAL_KF_NIS,      /* sum nu^2/S;                 with a right model sum/n -> 1 */
  IMUCAL_KF_WEIGHTED, /* sum nu/S;                   / sqrt(inverse) ~ N(0,1) */
  IMUCAL_KF_INVERSE,  /* sum 1/S */
  IMUCAL_KF_LAG1,     /* sum nu(k) nu(k-1)/max(S(k), S(k-1)) over consecutive seconds;  sum/n -> 0 */
  IMUCAL_KF_N_SUMS
} imucal_kf_sum_t;

typedef struct imucal_kf_stats {
  uint32_t n;         /* measurements taken */
  uint32_t n_missed;  /* seconds bridged by the time update alone */
  uint32_t n_refused; /* inputs refused, state unchanged */
  float sum[IMUCAL_KF_N_SUMS], sum_lo[IMUCAL_KF_N_SUMS];
  float innovation;        /* the last one; 0 before the first and after a bridged second */
  float innovation_weight; /* 1/S of the last one */
} imucal_kf_stats_t;

/* A number as an unevaluated sum of two floats. */
typedef struct imucal_kf_pair {
  float hi, lo;
} imucal_kf_pair_t;

/* Row k of the second filter's R c = x, and its weight: 1/D is the variance of c_k once c_k+1 .. c_M are known. */
typedef struct imucal_kf_row {
  imucal_kf_pair_t d; /* D_k > 0 */
  imucal_kf_pair_t x; /* x_k */
} imucal_kf_row_t;

/* Readable by anybody, written only by the functions below. */
typedef struct imucal_kf {
  /* first filter: e, as though z held no polynomial */
  float e;                      /* its estimate; the augmented filter's is e + V' c */
  float e_variance;             /* its variance, >= 0: that of e given c */
  imucal_kf_pair_t one_plus_v0; /* 1 + V_0 and not V_0, which is near -1: what matters is the difference */
  float v[IMUCAL_MAX_ORDER];    /* V_1 .. V_M */
  /* second filter: c */
  imucal_kf_row_t row[IMUCAL_MAX_COEFF];
  float r[IMUCAL_KF_MAX_R]; /* R above its diagonal by rows, each to IMUCAL_MAX_ORDER: R01 .. R05 R12 .. R15 R23 .. */
  float inv_range;
  float forgotten; /* m (2 - m) */
  imucal_kf_config_t config;
  imucal_kf_stats_t stats;
  bool is_ready;
} imucal_kf_t;

/* Both filters' numbers in the order in which the link carries them (CAL_FILTER in link.md): part of the protocol. */
typedef struct imucal_kf_state {
  float x[IMUCAL_KF_MAX_STATES];    /* 1 + V0, x_0 .. x_5: leading parts */
  float x_lo[IMUCAL_KF_MAX_STATES]; /* their trailing parts */
  float d[IMUCAL_KF_MAX_STATES];    /* variance of e given c, D_0 .. D_5: leading parts */
  float d_lo[IMUCAL_KF_MAX_STATES]; /* trailing parts; [0] is 0 */
  /* the first filter's e (the augmented filter's less V' c), V1 .. V5, then R above its diagonal by columns: R01 R02 R12 .. */
  float u[IMUCAL_KF_MAX_U];
} imucal_kf_state_t;

/* Start.  IMUCAL_ERR_ARGUMENT (null), IMUCAL_ERR_ORDER, IMUCAL_ERR_SPAN (t0, range), IMUCAL_ERR_MODEL (m, q, r,
 * variance), IMUCAL_ERR_RANGE (prior): refused, *kf unchanged. */
IMUCAL_MUST_USE imucal_status imucal_kf_init(imucal_kf_t* kf, const imucal_kf_config_t* config);

/* Time update by one second and measurement of it.
 * z: 1-s mean, |z| <= IMUCAL_KF_MAX_RATE; temp_degc: |Tn| <= IMUCAL_KF_MAX_TN; r_ratio: white variance of this mean
 * over r, 1/IMUCAL_KF_MAX_R_RATIO .. IMUCAL_KF_MAX_R_RATIO; 1 but for a second that lost samples (imucal_sum_noise_ratio).
 * IMUCAL_ERR_NOT_FINITE, IMUCAL_ERR_RANGE: refused, n_refused + 1, state unchanged (then call skip for the
 * second); IMUCAL_ERR_STATE: before init. */
IMUCAL_MUST_USE imucal_status imucal_kf_update_scaled(imucal_kf_t* kf, float z, float temp_degc, float r_ratio);
static inline IMUCAL_MUST_USE imucal_status imucal_kf_update(imucal_kf_t* kf, float z, float temp_degc) {
  return imucal_kf_update_scaled(kf, z, temp_degc, 1.0f);
}

/* Time update alone over n_s seconds without a usable measurement (gap, saturated, sensor fault): m and q of n_s
 * steps are composed by binary powering, at most 31 rounds.  n_s = 0 does nothing.  IMUCAL_ERR_STATE: before init;
 * IMUCAL_ERR_PERIOD: n_s above IMUCAL_KF_MAX_GAP_S. */
IMUCAL_MUST_USE imucal_status imucal_kf_skip(imucal_kf_t* kf, uint32_t n_s);

/* The device was switched off and on: e starts anew (variance markov_variance, uncorrelated) and the constant
 * term becomes less certain by turn_on_sigma (0..1e6; 0: no turn-on variation).  Exact, no approximation.
 * IMUCAL_ERR_STATE: before init; IMUCAL_ERR_RANGE: turn_on_sigma. */
IMUCAL_MUST_USE imucal_status imucal_kf_new_run(imucal_kf_t* kf, float turn_on_sigma);

/* ---- reading ----
 * At any finite temperature; where |Tn| > 1 the polynomial is extrapolated.  Not finite, or so far away that a power of Tn
 * overflows: the bias is not a number, the variance not finite, and both sigmas are 0 as imucal_sqrtf gives it; so ask for
 * temperatures that are.  Before init a struct of zeros gives 0, for the variance infinity. */

/* Coefficient i (0..order) in the channel's unit; 0 above the order. */
float imucal_kf_coefficient(const imucal_kf_t* kf, uint32_t i);

/* B(T) of the estimate. */
float imucal_kf_bias(const imucal_kf_t* kf, float temp_degc);

/* Predicted variance (unit^2) of the calibration error B(T) at a temperature: sum_j y_j^2/D_j with R' y = h,
 * h = [T_0(Tn) .. T_M(Tn)]: a sum of squares, never negative. */
float imucal_kf_bias_variance(const imucal_kf_t* kf, float temp_degc);

/* Its square root: the predicted one-sigma calibration error. */
float imucal_kf_bias_sigma(const imucal_kf_t* kf, float temp_degc);

/* Worst predicted one-sigma calibration error over lo..hi on a grid of n_grid >= 2 temperatures (ends included);
 * where it is, if worst_temp_degc is not null. */
float imucal_kf_worst_sigma(const imucal_kf_t* kf, float lo_degc, float hi_degc, uint32_t n_grid,
                            float* worst_temp_degc);

/* Copy the filter's numbers out, and into an initialised filter of the same configuration (its statistics stay).  They are not
 * checked: only what get_state gave is a filter's state.  Before init set_state leaves a filter that is still not ready. */
void imucal_kf_get_state(const imucal_kf_t* kf, imucal_kf_state_t* state);
void imucal_kf_set_state(imucal_kf_t* kf, const imucal_kf_state_t* state);
/* R_ik, i < k <= IMUCAL_MAX_ORDER; other indices are not checked. */
float imucal_kf_r(const imucal_kf_t* kf, uint32_t i, uint32_t k);

/* One of the innovations' sums so far. */
float imucal_kf_sum(const imucal_kf_t* kf, imucal_kf_sum_t which);
/* S of the last innovation, unit^2; 0 before the first. */
float imucal_kf_innovation_variance(const imucal_kf_t* kf);
/* sum nu^2/S over n; 0 before the first.  1 with a right model, standard error sqrt(2/n). */
float imucal_kf_mean_nis(const imucal_kf_t* kf);
/* Lag-1 correlation of the innovations; 0 with a right model, standard error 1/sqrt(n). */
float imucal_kf_lag1(const imucal_kf_t* kf);

#if defined(__cplusplus)
}
#endif
#endif
