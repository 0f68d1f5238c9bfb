// SPDX-License-Identifier: MIT
/* Scaling, overflow and error of the run-time part.  L = one LSB of the output = 2^-out_frac_bits counts.
 *
 * Given by prepare (checked there, else refused):
 *   (a) sum |c_i| <= 2^30, c_i = b_i in units of 2^-6 L, rounded: the bias is at most 2^24 L;
 *   (b) (full_scale counts + bias) (1 + sum|m_i|) < 2^31 L: the result fits int32;
 *   (c) sum |k_i| <= 2^30, k_i = m_i in units of 2^-scale_shift, and > 2^29 unless scale_shift is at its cap;
 *       sum|m_i| times the largest |rate| <= 2^24.5 L;
 *   (d) the clamped temperature counts give |tn| <= 2^30, and (counts - mid) gain < 2^62.
 * Temperature: gain is off by at most half in 2^30, tn_mid by half a unit, the product's rounding by half a
 * unit: |tn - 2^30 Tn| <= 1.5 units.  Moves B by at most 1.5 2^-30 sum i|b_i| <= 1.5 2^-30 5 2^24 L   = 0.118
 * L. Horner: |acc| <= sum|c_i| + order/2 < 2^31, acc tn < 2^61.  Coefficients rounded: 6 halves; steps
 * rounded: 5 halves of 2^-6 L (later roundings are multiplied by |tn| <= 1):  5.5 / 64 = 0.086 L. counts
 * 2^(frac + 6): |.| <= 2^45, exact.  Bias taken off exactly.  Without scale factor the last rounding is 0.5
 * L: total <= 0.71 L. Scale factor: correction = rate M.  rate is rounded to L before the product: 0.5 |M| <=
 * 1/32        = 0.032 L; M: 3 halves for coefficients, 2 for steps = 2.5 units of 2^-scale_shift <= 2.5 2^-29
 * sum|m|, times the rate
 *   <= 2.5 2^-29 2^24.5 L                                                                             = 0.111
 * L (at the cap of scale_shift 2.5 2^-44 2^31 L is far less); tn in M: 1.5 2^-30 2 sum|m| rate <= 3 2^-30
 * 2^24.5 L                                              = 0.067 L; product < 2^31 2^30 = 2^61, its rounding
 * 0.5 in 64 = 0.008 L; the bias errors grow by 1 + 1/16: 0.013 L. the last rounding 0.5 L: total <= 0.5 +
 * 0.118 + 0.086 + 0.032 + 0.111 + 0.067 + 0.008 + 0.013                              = 0.94 L. */
#include "comp.h"

#include "num.h"

#define GUARD_BITS 6
#define MAX_OUT_FRAC_BITS 8
#define MAX_COEFF_SUM (((int64_t)1 << 30) + 2) /* 2: three roundings up at the very limit */
#define MIN_SCALE_SHIFT 34                     /* sum |m| <= 1/16 */
#define MAX_SCALE_SHIFT 44
#define MAX_SCALE_EFFECT 23726566 /* 2^24.5 L */
#define MAX_TN_SHIFT 30           /* at most 2^30 counts from the middle to an end of the span */
#define MIN_RANGE_DEGC                                                                                       \
  0.0625f /* keeps the rounding of the 2^-40 degC arithmetic far below 2^-31 of the range */
#define ONE_Q30 ((int32_t)1 << 30)

/* The arithmetic right shift of negative numbers, as every compiler in use does it. */
typedef char shifts_keep_the_sign[(-5 >> 1) == -3 ? 1 : -1];

/* ---- prepare: exact quotients of floats by integers ---- */

/* value = mantissa 2^exponent, exact; finite input. */
IMUCAL_COLD static int64_t split(float value, int32_t* exponent) {
  uint32_t bits = imucal_bits_from_float(value);
  int32_t biased = (int32_t)(bits >> 23 & 0xFFu);
  int64_t mantissa = (int64_t)(bits & 0x7FFFFFu);
  if (biased == 0)
    biased = 1;
  else
    mantissa |= 0x800000;
  *exponent = biased - 150;
  return bits >> 31 != 0 ? -mantissa : mantissa;
}

static int64_t absolute(int64_t value) {
  return value < 0 ? -value : value;
}

#define TOO_LARGE ((int64_t)1 << 62)

/* numerator 2^exponent / denominator, rounded to nearest; relative error of the quotient before rounding
 * below 2^-36; |result| >= 2^37: TOO_LARGE.  Pre: |numerator| < 2^62, denominator normal and positive. */
IMUCAL_COLD static int64_t quotient(int64_t numerator, int32_t exponent, float denominator) {
  if (numerator == 0) return 0;
  int32_t denominator_exponent = 0;
  int64_t mantissa = split(denominator, &denominator_exponent);
  while (absolute(numerator) < (int64_t)1 << 61) { /* at most 61 rounds */
    numerator *= 2;
    exponent--;
  }
  int64_t ratio = numerator / mantissa; /* 37 to 39 bits */
  int32_t shift = denominator_exponent - exponent;
  if (shift < 0) return TOO_LARGE;
  if (shift > 61) return 0;
  return imucal_divide_rne(ratio, (int64_t)1 << shift);
}

/* A float times 2^fraction_bits over a denominator. */
IMUCAL_COLD static int64_t float_quotient(float numerator, int32_t fraction_bits, float denominator) {
  int32_t exponent = 0;
  int64_t mantissa = split(numerator, &exponent);
  return quotient(mantissa, exponent + fraction_bits, denominator);
}

/* degC in units of 2^-40; |temp_degc| <= 1e6 < 2^20. */
IMUCAL_COLD static int64_t q40_from_degc(int64_t mantissa, int32_t exponent) {
  int32_t shift = exponent + 40;
  if (shift >= 0) return mantissa * ((int64_t)1 << shift);
  return shift < -61 ? 0 : imucal_divide_rne(mantissa, (int64_t)1 << -shift);
}
IMUCAL_COLD static int64_t q40_from_float(float temp_degc) {
  int32_t exponent = 0;
  int64_t mantissa = split(temp_degc, &exponent);
  return q40_from_degc(mantissa, exponent);
}

/* Counts nearest to a temperature; false beyond int32. */
IMUCAL_COLD static bool counts_from_q40(int64_t temp_q40, const imucal_table_t* table, int32_t* counts) {
  int64_t wide = quotient(temp_q40 - q40_from_float(table->degc_at_zero), -40, table->degc_per_count);
  *counts = (int32_t)wide;
  return absolute(wide) <= INT32_MAX;
}

static int64_t multiply_q(int64_t a, int64_t b, uint32_t shift) {
  return (a * b + ((int64_t)1 << (shift - 1))) >> shift;
}

/* ((p >> (s-1)) + 1) >> 1 is (p + 2^(s-1)) >> s for every p: one shift by a variable instead of two. */
static inline int64_t tn_of_product(const imucal_comp_t* comp, int64_t product) {
  if (comp->tn_shift != 0) product = ((product >> (comp->tn_shift - 1)) + 1) >> 1;
  return comp->tn_mid_q30 + product;
}

static int64_t tn_unclamped(const imucal_comp_t* comp, int32_t temp_counts) {
  return tn_of_product(comp, ((int64_t)temp_counts - comp->temp_mid_counts) * comp->tn_gain);
}

IMUCAL_COLD static imucal_status prepare_temperature(imucal_comp_t* comp, const imucal_table_t* table,
                                                     const imucal_table_channel_t* c) {
  if (c->range_degc < MIN_RANGE_DEGC) return IMUCAL_ERR_PRECISION;
  int64_t gain = TOO_LARGE;
  for (uint32_t shift = 0; shift <= MAX_TN_SHIFT; shift++) {
    int64_t finer = float_quotient(table->degc_per_count, (int32_t)(30 + shift), c->range_degc);
    if (finer > INT32_MAX) break;
    gain = finer;
    comp->tn_shift = (uint8_t)shift;
  }
  if (gain == TOO_LARGE || gain < ONE_Q30) return IMUCAL_ERR_PRECISION;
  comp->tn_gain = (int32_t)gain;
  int64_t t0_q40 = q40_from_float(c->t0_degc);
  if (!counts_from_q40(t0_q40, table, &comp->temp_mid_counts)) return IMUCAL_ERR_PRECISION;
  int32_t exponent = 0;
  int64_t mantissa = split(table->degc_per_count, &exponent);
  int64_t mid_q40 =
      q40_from_degc(mantissa * comp->temp_mid_counts, exponent) + q40_from_float(table->degc_at_zero);
  comp->tn_mid_q30 = (int32_t)quotient(mid_q40 - t0_q40, -10, c->range_degc);
  if (!counts_from_q40(q40_from_float(c->span_lo_degc), table, &comp->temp_lo_counts) ||
      !counts_from_q40(q40_from_float(c->span_hi_degc), table, &comp->temp_hi_counts))
    return IMUCAL_ERR_PRECISION;
  /* The nearest count may lie a little outside t0 +- range. */
  for (uint32_t i = 0; i < 2 && absolute(tn_unclamped(comp, comp->temp_lo_counts)) > ONE_Q30; i++)
    comp->temp_lo_counts++;
  for (uint32_t i = 0; i < 2 && absolute(tn_unclamped(comp, comp->temp_hi_counts)) > ONE_Q30; i++)
    comp->temp_hi_counts--;
  bool is_inside = absolute(tn_unclamped(comp, comp->temp_lo_counts)) <= ONE_Q30 &&
                   absolute(tn_unclamped(comp, comp->temp_hi_counts)) <= ONE_Q30;
  return is_inside && comp->temp_lo_counts < comp->temp_hi_counts ? IMUCAL_OK : IMUCAL_ERR_PRECISION;
}

/* Coefficients over `unit` in units of 2^-fraction_bits; their sum of magnitudes, or TOO_LARGE. */
IMUCAL_COLD static int64_t quantise(const float* value, uint32_t n, int32_t fraction_bits, float unit,
                                    int32_t* coeff) {
  int64_t sum = 0;
  for (uint32_t i = 0; i < n; i++) {
    int64_t wide = float_quotient(value[i], fraction_bits, unit);
    sum += absolute(wide);
    if (sum > MAX_COEFF_SUM) return TOO_LARGE;
    coeff[i] = (int32_t)wide;
  }
  return sum;
}

IMUCAL_COLD static imucal_status prepare_scale(imucal_comp_t* comp, const imucal_table_channel_t* c) {
  comp->scale_order = c->scale_order;
  comp->has_scale = false;
  for (uint32_t i = 0; i <= c->scale_order; i++)
    if (imucal_bits_from_float(c->scale_coeff[i]) << 1 != 0) comp->has_scale = true;
  for (uint32_t shift = MAX_SCALE_SHIFT; shift >= MIN_SCALE_SHIFT; shift--) {
    comp->scale_shift = (uint8_t)shift;
    int64_t sum = quantise(c->scale_coeff, IMUCAL_TABLE_SCALE_N, (int32_t)shift, 1.0f, comp->scale_coeff);
    if (sum != TOO_LARGE) return IMUCAL_OK;
  }
  return IMUCAL_ERR_PRECISION; /* sum |m| above 1/16 */
}

/* Does everything fit with this many fractional bits?  bias_sum in units of 2^-(out_frac_bits + 6). */
IMUCAL_COLD static bool fits(const imucal_comp_t* comp, int64_t bias_sum, int32_t full_scale_counts) {
  int64_t rate = ((int64_t)full_scale_counts << comp->out_frac_bits) + (bias_sum >> GUARD_BITS) + 1;
  if (rate > INT32_MAX) return false;
  int64_t scale_sum = 0;
  for (uint32_t i = 0; i < IMUCAL_TABLE_SCALE_N; i++) scale_sum += absolute(comp->scale_coeff[i]);
  int64_t effect = (rate * scale_sum >> comp->scale_shift) + 1;
  if (!comp->has_scale) effect = 0;
  return effect <= MAX_SCALE_EFFECT && rate + effect <= INT32_MAX;
}

IMUCAL_COLD imucal_status imucal_comp_prepare(imucal_comp_t* comp, const imucal_table_t* table,
                                              uint32_t i_channel) {
  if (comp == NULL || table == NULL || i_channel >= table->n_channels) return IMUCAL_ERR_ARGUMENT;
  const imucal_table_channel_t* c = &table->channel[i_channel];
  imucal_comp_t made = {0};
  imucal_status status = prepare_temperature(&made, table, c);
  if (status == IMUCAL_OK) status = prepare_scale(&made, c);
  if (status != IMUCAL_OK) return status;
  made.order = c->order;
  for (uint32_t lost = 0; lost <= MAX_OUT_FRAC_BITS; lost++) {
    made.out_frac_bits = (uint8_t)(MAX_OUT_FRAC_BITS - lost);
    int64_t sum =
        quantise(c->coeff, IMUCAL_MAX_COEFF, made.out_frac_bits + GUARD_BITS, c->unit_per_count, made.coeff);
    if (sum == TOO_LARGE || !fits(&made, sum, c->full_scale_counts)) continue;
    made.unit_per_lsb = c->unit_per_count / (float)(1u << made.out_frac_bits);
    *comp = made;
    return IMUCAL_OK;
  }
  return IMUCAL_ERR_PRECISION;
}

IMUCAL_COLD imucal_status imucal_comp_pass(imucal_comp_t* comp, float unit_per_count,
                                           int32_t full_scale_counts) {
  if (comp == NULL || full_scale_counts <= 0) return IMUCAL_ERR_ARGUMENT;
  *comp = (imucal_comp_t){
      .temp_lo_counts = INT32_MIN, .temp_hi_counts = INT32_MAX, .scale_shift = MIN_SCALE_SHIFT};
  comp->out_frac_bits = MAX_OUT_FRAC_BITS;
  while (comp->out_frac_bits > 0 && !fits(comp, 0, full_scale_counts)) comp->out_frac_bits--;
  comp->unit_per_lsb = unit_per_count / (float)(1u << comp->out_frac_bits);
  return IMUCAL_OK;
}

/* ---- run time: integers only ---- */

/* The distance from the middle fits 32 bits: prepare found |tn| <= 1 at both ends of the span, and a count
 * moves tn by gain 2^-(30 + shift) >= 2^-shift, so that |distance| <= 2^MAX_TN_SHIFT + 1. */
static inline int32_t clamped_tn_q30(const imucal_comp_t* comp, int32_t temp_counts, uint32_t* flags) {
  if (temp_counts < comp->temp_lo_counts) {
    temp_counts = comp->temp_lo_counts;
    *flags |= IMUCAL_COMP_TEMP_CLAMPED;
  }
  if (temp_counts > comp->temp_hi_counts) {
    temp_counts = comp->temp_hi_counts;
    *flags |= IMUCAL_COMP_TEMP_CLAMPED;
  }
  const int32_t distance = (int32_t)((uint32_t)temp_counts - (uint32_t)comp->temp_mid_counts);
  return (int32_t)tn_of_product(comp, (int64_t)distance * comp->tn_gain);
}

int32_t imucal_comp_tn_q30(const imucal_comp_t* comp, int32_t temp_counts, uint32_t* flags) {
  return clamped_tn_q30(comp, temp_counts, flags);
}

/* Pre: sum |coeff| <= 2^30, |tn| <= 2^30.  Every partial result stays below 2^30 + order/2. */
static int32_t horner_q30(const int32_t* coeff, uint32_t order, int32_t tn_q30) {
  int32_t acc = coeff[order];
  for (uint32_t i = order; i > 0; i--) acc = (int32_t)multiply_q(acc, tn_q30, 30) + coeff[i - 1];
  return acc;
}

static int32_t saturate(int64_t value, uint32_t* flags) {
  if (value == (int32_t)value) return (int32_t)value;
  *flags |= IMUCAL_COMP_SATURATED;
  return value > 0 ? INT32_MAX : INT32_MIN;
}

int32_t imucal_comp_apply(const imucal_comp_t* comp, int32_t temp_counts, int32_t counts, uint32_t* flags) {
  int32_t tn_q30 = clamped_tn_q30(comp, temp_counts, flags);
  int64_t rate = (int64_t)counts * ((int32_t)1 << (comp->out_frac_bits + GUARD_BITS)) -
                 horner_q30(comp->coeff, comp->order, tn_q30);
  const int64_t half = (int64_t)1 << (GUARD_BITS - 1);
  if (comp->has_scale) {
    int64_t rounded = saturate((rate + half) >> GUARD_BITS, flags);
    int32_t scale = horner_q30(comp->scale_coeff, comp->scale_order, tn_q30);
    rate += multiply_q(rounded, scale, (uint32_t)comp->scale_shift - GUARD_BITS);
  }
  return saturate((rate + half) >> GUARD_BITS, flags);
}
