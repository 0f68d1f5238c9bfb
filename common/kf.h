// SPDX-License-Identifier: MIT
/* Purpose: the recursive Kalman filter that learns the thermal polynomial of one channel (paper, Section III).
 * Data: once, the normalisation of temperature and the error model from the host; then one 1-s mean and its
 * temperature per second; out, at any time, coefficients, covariance, predicted calibration error.
 * Order: init; then per second update (or skip); read functions any time.  One struct per channel.
 * Memory: sizeof(imucal_kf_t), of it 196 bytes of filter state at order 5; no heap.  Time: n(n+1)/2 inner steps
 * and n divisions per update, n = order + 2.  Thread: one context per struct.
 *
 * Model.  M = order, e first-order Gauss-Markov, the coefficients constant:
 *   z = e + b0 + b1 Tn + .. + bM Tn^M + v,  Tn = (T - t0)/range,  var v = r = (60 arw)^2/dt,
 *   e' = (1 - m) e + w,  var w = q,  m = 1 - exp(-dt/tau),  q = sigma^2 (1 - exp(-2 dt/tau)),  dt = 1 s.
 * The host computes m, q, r in double and sends them: no libm here.  m instead of phi = 1 - m, so that long time
 * constants lose nothing in float32.
 *
 * The state is kept in Chebyshev's polynomials, s = [e, c0 .. cM], sum c_k T_k(Tn) = sum b_k Tn^k: they are nearly
 * uncorrelated where powers are not, so that U stays small and its rounding with it (10 days, order 5: predicted sigma
 * off by 6e-6 instead of 1.4e-3 with powers).  The prior is on b_k, exactly; imucal_kf_coefficient gives b_k.
 *
 * Numerics.  P = U D U' (U unit upper triangular, packed by columns).  With e as the first state the time update
 * is exact and nearly free: row 0 of U times phi, D0 <- phi^2 D0 + q.  Measurement update: Bierman 1976.
 * D and the state are kept as unevaluated sums hi + lo: over 10 days a single update changes D by one part in a
 * million, close to the last bit of float32.  Rounding errors then do not add up (measured: tests/common/test_kf.c).
 * Known limit: where the prior is over 1000 times the noise (1e4 over 3 dph), order 5, sigma is off by up to 0.2 % while
 * the span is half explored; at the end by 1e-4.
 *
 * The unit of a channel is generic: dph for gyros, mg for accelerometers. */
#ifndef IMUCAL_KF_H
#define IMUCAL_KF_H

#include "status.h"

#if defined(__cplusplus)
extern "C" {
#endif

#define IMUCAL_KF_MAX_STATES (IMUCAL_MAX_ORDER + 2)
#define IMUCAL_KF_MAX_UD (IMUCAL_KF_MAX_STATES * (IMUCAL_KF_MAX_STATES - 1) / 2)
#define IMUCAL_KF_MAX_RATE 1e7f          /* |z|, unit; beyond it is refused */
#define IMUCAL_KF_MAX_TN 1.5f            /* |Tn| of a measurement; beyond it is refused */
#define IMUCAL_KF_MAX_GAP_S 0x7FFFFFFFu

/* What the host decides. */
typedef struct imucal_kf_config {
  uint8_t order;    /* M, 1..IMUCAL_MAX_ORDER */
  float t0_degc;    /* centre of the temperature normalisation, -273..1000 */
  float range_degc; /* > 0: Tn = (T - t0)/range; the span of interest should be |Tn| <= 1 */
  float m;          /* 1 - exp(-dt/tau), (0, 1] */
  float q;          /* unit^2, >= 0 */
  float r;          /* unit^2, > 0 */
  float markov_variance;   /* initial variance of e: its stationary sigma^2, unit^2, >= 0 */
  float prior_sigma;       /* initial standard deviation of every coefficient, unit, > 0, <= 1e6 (usual: 1e4) */
} imucal_kf_config_t;

/* Running statistics of the innovations nu with predicted variance S: a first sign on the device that the model
 * is wrong.  With a right model nis_sum/n -> 1, weighted_sum/sqrt(inverse_sum) ~ N(0,1), lag1_sum/n -> 0.
 * All are compensated sums, good for 1e7 terms. */
typedef struct imucal_kf_stats {
  uint32_t n;                            /* measurements taken */
  uint32_t n_missed;                     /* seconds bridged by the time update alone */
  uint32_t n_refused;                    /* inputs refused, state unchanged */
  float nis_sum, nis_lo;                 /* sum nu^2/S */
  float weighted_sum, weighted_lo;       /* sum nu/S */
  float inverse_sum, inverse_lo;         /* sum 1/S */
  float lag1_sum, lag1_lo;               /* sum nu(k) nu(k-1)/S(k) over consecutive seconds */
  float innovation, innovation_variance; /* the last one; 0 before the first */
} imucal_kf_stats_t;

/* Readable by anybody, written only by the functions below. */
typedef struct imucal_kf {
  float x[IMUCAL_KF_MAX_STATES];    /* e, c0 .. cM: leading part */
  float x_lo[IMUCAL_KF_MAX_STATES]; /* trailing part */
  float d[IMUCAL_KF_MAX_STATES];    /* D: leading part, > 0 (d[0] >= 0) */
  float d_lo[IMUCAL_KF_MAX_STATES]; /* trailing part */
  float u[IMUCAL_KF_MAX_UD];        /* U above its diagonal, column j at j(j-1)/2: U01 U02 U12 U03 U13 U23 .. */
  float inv_range;
  imucal_kf_config_t config;
  imucal_kf_stats_t stats;
  bool is_last_missing; /* the second before was bridged: the lag-1 product is left out */
  bool is_ready;
} imucal_kf_t;

/* Start.  IMUCAL_ERR_ORDER, IMUCAL_ERR_SPAN (t0, range), IMUCAL_ERR_MODEL (m, q, r, variance),
 * IMUCAL_ERR_RANGE (prior): refused, *kf unchanged. */
IMUCAL_MUST_USE imucal_status imucal_kf_init(imucal_kf_t* kf, const imucal_kf_config_t* config);

/* Time update by one second and measurement of it.
 * z: 1-s mean, |z| <= IMUCAL_KF_MAX_RATE; temp_degc: |Tn| <= IMUCAL_KF_MAX_TN.
 * IMUCAL_ERR_NOT_FINITE, IMUCAL_ERR_RANGE: refused, n_refused + 1, state unchanged (then call skip for the
 * second); IMUCAL_ERR_STATE: before init. */
IMUCAL_MUST_USE imucal_status imucal_kf_update(imucal_kf_t* kf, float z, float temp_degc);

/* Time update alone over n_s seconds without a usable measurement (gap, saturated, sensor fault): m and q of n_s
 * steps are composed by binary powering, at most 31 rounds.  n_s = 0 does nothing. */
IMUCAL_MUST_USE imucal_status imucal_kf_skip(imucal_kf_t* kf, uint32_t n_s);

/* The device was switched off and on: e starts anew (variance markov_variance, uncorrelated) and the constant
 * term becomes less certain by turn_on_sigma (>= 0; 0: no turn-on variation).  Exact, no approximation. */
IMUCAL_MUST_USE imucal_status imucal_kf_new_run(imucal_kf_t* kf, float turn_on_sigma);

/* Coefficient i (0..order) in the channel's unit; 0 above the order. */
float imucal_kf_coefficient(const imucal_kf_t* kf, uint32_t i);

/* B(T) of the estimate. */
float imucal_kf_bias(const imucal_kf_t* kf, float temp_degc);

/* Predicted variance (unit^2) of the calibration error B(T) at a temperature: sum_j d_j (u_j' h)^2 with
 * h = [0 T_0(Tn) .. T_M(Tn)]: a sum of squares, never negative. */
float imucal_kf_bias_variance(const imucal_kf_t* kf, float temp_degc);

/* Its square root: the predicted one-sigma calibration error. */
float imucal_kf_bias_sigma(const imucal_kf_t* kf, float temp_degc);

/* Worst predicted one-sigma calibration error over lo..hi on a grid of n_grid >= 2 temperatures (ends included);
 * where it is, if worst_temp_degc is not null. */
float imucal_kf_worst_sigma(const imucal_kf_t* kf, float lo_degc, float hi_degc, uint32_t n_grid,
                            float* worst_temp_degc);

/* sum nu^2/S over n; 0 before the first.  1 with a right model, standard error sqrt(2/n). */
float imucal_kf_mean_nis(const imucal_kf_t* kf);
/* Lag-1 correlation of the innovations; 0 with a right model, standard error 1/sqrt(n). */
float imucal_kf_lag1(const imucal_kf_t* kf);

#if defined(__cplusplus)
}
#endif
#endif
