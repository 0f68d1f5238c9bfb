// SPDX-License-Identifier: MIT
// The same filter a second way: covariance form, powers of Tn, long double (64-bit mantissa on x86).  No factors, no
// Chebyshev polynomials, no compensation: nothing shared with common/kf.c but the model.
#ifndef TESTS_COMMON_REFERENCE_KF_H
#define TESTS_COMMON_REFERENCE_KF_H
#include "kf.h"

typedef struct {
  int n;
  long double x[IMUCAL_KF_MAX_STATES], p[IMUCAL_KF_MAX_STATES][IMUCAL_KF_MAX_STATES];
  long double m, q, r, t0, range;
} reference_kf_t;

static inline void reference_init(reference_kf_t* f, const imucal_kf_config_t* c) {
  memset(f, 0, sizeof *f);
  f->n = c->order + 2;
  f->m = c->m, f->q = c->q, f->r = c->r, f->t0 = c->t0_degc, f->range = c->range_degc;
  f->p[0][0] = c->markov_variance;
  for (int i = 1; i < f->n; i++) f->p[i][i] = (long double)c->prior_sigma * c->prior_sigma;
}

static inline void reference_predict(reference_kf_t* f) {
  long double phi = 1 - f->m;
  f->x[0] *= phi;
  for (int i = 0; i < f->n; i++) f->p[0][i] *= phi;
  for (int i = 0; i < f->n; i++) f->p[i][0] *= phi;
  f->p[0][0] += f->q;
}

static inline void reference_row(const reference_kf_t* f, long double temp_degc, long double* h) {
  long double tn = (temp_degc - f->t0) / f->range;
  h[0] = h[1] = 1;
  for (int i = 2; i < f->n; i++) h[i] = h[i - 1] * tn;
}

static inline void reference_update(reference_kf_t* f, float z, float temp_degc) {
  reference_predict(f);
  long double h[IMUCAL_KF_MAX_STATES], ph[IMUCAL_KF_MAX_STATES], s = f->r, nu = z;
  reference_row(f, temp_degc, h);
  for (int i = 0; i < f->n; i++) {
    ph[i] = 0;
    for (int j = 0; j < f->n; j++) ph[i] += f->p[i][j] * h[j];
    s += h[i] * ph[i];
    nu -= h[i] * f->x[i];
  }
  for (int i = 0; i < f->n; i++) {
    f->x[i] += ph[i] / s * nu;
    for (int j = 0; j < f->n; j++) f->p[i][j] -= ph[i] * ph[j] / s;
  }
}

static inline double reference_bias(const reference_kf_t* f, double temp_degc) {
  long double h[IMUCAL_KF_MAX_STATES], sum = 0;
  reference_row(f, temp_degc, h);
  for (int i = 1; i < f->n; i++) sum += h[i] * f->x[i];
  return (double)sum;
}

static inline double reference_sigma(const reference_kf_t* f, double temp_degc) {
  long double h[IMUCAL_KF_MAX_STATES], sum = 0;
  reference_row(f, temp_degc, h);
  for (int i = 1; i < f->n; i++)
    for (int j = 1; j < f->n; j++) sum += h[i] * h[j] * f->p[i][j];
  return (double)sqrtl(sum);
}
#endif
