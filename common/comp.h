// SPDX-License-Identifier: MIT
/* Purpose: take the thermal bias (and scale-factor change) out of every sample, integers only, full rate.
 *   out = (counts - B(T)) (1 + M(T)),   in units of 2^-out_frac_bits counts.
 * Data: a table channel once (prepare, float and integer arithmetic, not time critical); then per sample
 * temperature counts and sensor counts in, compensated value out.
 * Memory: sizeof(imucal_comp_t) per channel.  Time per sample: order + 2 multiplications
 * 32x32->64, three more with a scale factor.
 *
 * Why fractional bits: a coarse sensor (ADIS16405: 180 dph per count) must not get a bias rounded to its counts.
 * prepare chooses the largest number of fractional bits, 0..8, for which nothing can overflow and the error bound
 * holds; IMUCAL_ERR_PRECISION when there is none.
 *
 * Error: against exact real arithmetic on the table's float32 values, at most one LSB of the output (2^-out_frac_bits
 * counts) for every int32 temperature, clamped to the counts nearest to the ends of the valid span (where such a count lies
 * outside t0 +- range, the next inside), and every |counts| <= full_scale_counts; proof in comp.c.  Beyond full scale the
 * result saturates at int32 and is flagged. */
#ifndef IMUCAL_COMP_H
#define IMUCAL_COMP_H

#include "status.h"
#include "table.h"

#if defined(__cplusplus)
extern "C" {
#endif

enum { IMUCAL_COMP_TEMP_CLAMPED = 1, IMUCAL_COMP_SATURATED = 2 };

typedef struct imucal_comp {
  int32_t temp_lo_counts, temp_hi_counts; /* valid span */
  int32_t temp_mid_counts;                /* Tn is computed from the distance to it: near t0, or inside the span */
  int32_t tn_mid_q30;                     /* Tn at temp_mid_counts */
  int32_t tn_gain;                        /* Tn per count in units of 2^-(61 - tn_shift) */
  uint8_t tn_shift;                       /* the distance shifted left so far uses all its 31 bits */
  uint8_t order;
  uint8_t out_frac_bits;                     /* LSB of the output = 2^-out_frac_bits counts */
  uint8_t scale_shift;                       /* scale coefficients are in units of 2^-scale_shift */
  bool has_scale;                            /* some m_i is not zero */
  int32_t coeff[IMUCAL_MAX_COEFF];           /* b_i in units of 2^-(out_frac_bits + 6) counts */
  int32_t scale_coeff[IMUCAL_TABLE_SCALE_N]; /* m_i */
  float unit_per_lsb;                        /* unit of the channel per LSB of the output */
} imucal_comp_t;

/* Prepare channel i of a valid table.  IMUCAL_ERR_PRECISION: no fixed-point form within the bound (the sum of
 * |b_i| exceeds 2^24 counts, the thermometer has too few or too many counts over the range, …);
 * IMUCAL_ERR_ARGUMENT: no such channel.  A channel of order 0 has B = 0; where its scale factor is 0 too (uncalibrated)
 * it passes counts through, with out_frac_bits as for a table of zeros, and has no span: no temperature is clamped. */
IMUCAL_MUST_USE imucal_status imucal_comp_prepare(imucal_comp_t* comp, const imucal_table_t* table, uint32_t i_channel);

/* The same of a channel alone: valid, in a table with this thermometer. */
IMUCAL_MUST_USE imucal_status imucal_comp_prepare_channel(imucal_comp_t* comp, const imucal_table_channel_t* channel,
                                                          float degc_per_count, float degc_at_zero);

/* Pass-through without a table: B = 0, M = 0. */
IMUCAL_MUST_USE imucal_status imucal_comp_pass(imucal_comp_t* comp, float unit_per_count, int32_t full_scale_counts);

/* Normalised temperature in units of 2^-30, |Tn| <= 1 within a unit, of temperature counts clamped to the valid span; adds
 * IMUCAL_COMP_TEMP_CLAMPED to *flags when clamped. */
int32_t imucal_comp_tn_q30(const imucal_comp_t* comp, int32_t temp_counts, uint32_t* flags);

/* Compensate one sample.  Returns the value in units of 2^-out_frac_bits counts; *flags collects IMUCAL_COMP_*. */
int32_t imucal_comp_apply(const imucal_comp_t* comp, int32_t temp_counts, int32_t counts, uint32_t* flags);

#if defined(__cplusplus)
}
#endif
#endif
