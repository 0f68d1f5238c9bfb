// SPDX-License-Identifier: MIT
/* Purpose: the filter of the reference figures (tests/README.md, A) as a host sends it to a device, for the checks on chips and
 * for tests.  Source: 0.6 deg/sqrt(h), 20 dph, 100 s in the equations of kf.h, worked out to 20 digits and rounded to the nearest
 * float32 (tests/common/test_kf.c compares): m = 1 - exp(-1/100), q = 20^2 (1 - exp(-2/100)), r = (60 0.6)^2. */
#ifndef IMUCAL_CHECK_REFERENCE_H
#define IMUCAL_CHECK_REFERENCE_H
#include "kf.h"
#include "link.h"

#define REFERENCE_M 0.00995016625f /* 0.0099501662508319464261 */
#define REFERENCE_Q 7.92053068f    /* 7.9205306772978791117 */
#define REFERENCE_R 1296.0f
#define REFERENCE_MARKOV_VARIANCE 400.0f
#define REFERENCE_PRIOR_SIGMA 1e4f

/* An initialiser of imucal_kf_config_t: temperatures 0 to 60 degC. */
#define REFERENCE_FILTER(order)                                                                                        \
  { order, 30.0f, 30.0f, REFERENCE_M, REFERENCE_Q, REFERENCE_R, REFERENCE_MARKOV_VARIANCE, REFERENCE_PRIOR_SIGMA }

/* The request that starts this filter. */
static inline imucal_link_cal_start_t reference_cal_start(uint8_t channel, uint8_t order) {
  const imucal_link_cal_start_t request = {.channel = channel,
                                           .order = order,
                                           .t0_degc = 30.0f,
                                           .range_degc = 30.0f,
                                           .m = REFERENCE_M,
                                           .q = REFERENCE_Q,
                                           .r = REFERENCE_R,
                                           .markov_variance = REFERENCE_MARKOV_VARIANCE,
                                           .prior_sigma = REFERENCE_PRIOR_SIGMA,
                                           .span_lo_degc = 0.0f,
                                           .span_hi_degc = 60.0f,
                                           .arw = 0.6f,
                                           .n_markov = 1,
                                           .markov_sigma = {20.0f},
                                           .markov_tau_s = {100.0f}};
  return request;
}
#endif
