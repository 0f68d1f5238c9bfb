// SPDX-License-Identifier: MIT
/* Scaling, overflow and error of the run-time part.  L = one LSB of the output = 2^-out_frac_bits counts.
 *
 * Given by prepare (checked there, else refused):
 *   (a) sum |c_i| <= 2^30 + 6, c_i = b_i in units of 2^-6 L, to the integer above (the leading one to the nearest):
 *       the bias is at most 2^24 L;
 *   (b) (full_scale counts + bias) (1 + sum|m_i|) < 2^31 L: the result fits int32;
 *   (c) sum |k_i| <= 2^30 + 6, k_i = m_i in units of 2^-scale_shift (rounded as c_i), and > 2^29 unless scale_shift is
 *       at its cap of 36;  sum|m_i| times the largest |rate| <= 2^24.5 L;
 *   (d) the clamped temperature counts have 2^30 |Tn| <= 2^30 + 1; their distance from the middle, shifted left, is
 *       -2^31 <= d' < 2^31.
 *
 * Temperature: tn = floor(d' gain 2^-31) + tn_mid in units of 2^-30.  gain is off by at most a half (by one where it
 * was cut to 2^31 - 1; then |d'| <= 2^30), so that its product is off by half a unit; the floor takes up to one unit
 * and tn_mid is the integer above, up to one unit more: |tn - 2^30 Tn| <= 1.5 units, |tn| <= 2^30 + 2.
 * (The quotients before their rounding are good to 2^-5 unit: in the margin of the totals.)
 * |d' gain| < 2^62.  Horner: |acc| <= (sum|c_i| + order + 1)(1 + 2^-26) < 2^30.01, |acc tn| < 2^61.
 *
 * Error, without scale factor:
 *   tn: 1.5 2^-30 sum i|b_i| <= 1.5 2^-30 5 2^24 L                                            = 0.118 L
 *   Horner: each step's floor takes up to one unit, the coefficient it joins is up to one unit too large: together less
 *     than one; the leading coefficient half a unit (later errors are multiplied by |tn| <= 1): 5.5/64 = 0.086 L
 *   counts 2^frac is exact; adding floor((32 - acc)/64) to it rounds the difference to the nearest L:     0.5 L
 *                                                                                      total <= 0.71 L
 * With scale factor, correction = rate M:
 *   rate is rounded to L before the product: 0.5 |M| <= 1/32                                  = 0.032 L
 *   M: 2.5 units of 2^-scale_shift (two steps) <= 2.5 2^-29 sum|m|, times the rate <= 2.5 2^-29 2^24.5 L = 0.111 L
 *     (at the cap of scale_shift 2.5 2^-36 2^31 L                                              = 0.079 L)
 *   tn in M: 1.5 2^-30 2 sum|m| rate <= 3 2^-30 2^24.5 L                                      = 0.067 L
 *   |product| < 2^31 2^30.01 < 2^62; its floor to 2^-6 L                                      = 0.016 L
 *   the bias errors above grow by 1 + 1/16                                                    = 0.013 L
 *                                               total <= 0.71 + these five, rounded up = 0.95 L */
#include "comp.h"

#include "num.h"

#define GUARD_BITS 6
#define MAX_OUT_FRAC_BITS 8
#define MAX_COEFF_SUM (((int32_t)1 << 30) + 6) /* 6: each to the integer above, at the very limit */
#define NO_SUM (-1)                            /* of magnitudes: above MAX_COEFF_SUM */
#define MIN_SCALE_SHIFT 34                     /* sum |m| <= 1/16 */
#define MAX_SCALE_SHIFT 36
#define MAX_SCALE_EFFECT 23726566       /* 2^24.5 L */
#define MAX_DISTANCE ((int64_t)1 << 30) /* counts from the middle to an end of the span */
/* Keeps the rounding of the 2^-40 degC arithmetic far below 2^-31 of the range. */
#define MIN_RANGE_DEGC 0.0625f
#define ONE_Q30 ((int32_t)1 << 30)

/* The arithmetic right shift of negative numbers, as every compiler in use does it. */
IMUCAL_STATIC_ASSERT(shifts_keep_the_sign, (-5 >> 1) == -3);

/* ---- prepare: exact quotients of floats by integers ---- */

/* value = mantissa 2^exponent, exact, |mantissa| < 2^24; finite input. */
IMUCAL_COLD static int32_t split(float value, int32_t* exponent) {
  uint32_t bits = imucal_bits_from_float(value);
  int32_t biased = (int32_t)(bits >> 23 & 0xFFu);
  int32_t mantissa = (int32_t)(bits & 0x7FFFFFu);
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
enum { TO_NEAREST = 1, TO_ABOVE = 2 }; /* halves added before the floor */

/* numerator 2^exponent / denominator, rounded; relative error of the quotient before rounding
 * below 2^-36; |result| >= 2^37: TOO_LARGE.  Pre: |numerator| < 2^62, denominator normal and positive. */
IMUCAL_COLD static int64_t quotient(int64_t numerator, int32_t exponent, float denominator, int32_t halves) {
  int32_t denominator_exponent = 0;
  const int32_t mantissa = split(denominator, &denominator_exponent);
  int32_t shift = denominator_exponent - exponent;
  if (numerator != 0)
    for (; absolute(numerator) < (int64_t)1 << 61; shift++) numerator *= 2; /* at most 61 rounds */
  int64_t ratio = numerator / mantissa;                                     /* 37 to 39 bits, or 0 */
  if (shift < 1) return ratio == 0 ? halves >> 1 : TOO_LARGE;
  if (shift > 61) shift = 61;
  return (ratio + halves * ((int64_t)1 << (shift - 1))) >> shift;
}

/* A float times 2^fraction_bits over a denominator. */
IMUCAL_COLD static int64_t float_quotient(float numerator, int32_t fraction_bits, float denominator, int32_t halves) {
  int32_t exponent = 0;
  const int32_t mantissa = split(numerator, &exponent);
  return quotient(mantissa, exponent + fraction_bits, denominator, halves);
}

/* degC in units of 2^-40; |temp_degc| <= 1e6 < 2^20.  Apart: it has two callers, and 64-bit shifts are long. */
IMUCAL_APART static int64_t q40_from_degc(int64_t mantissa, int32_t exponent) {
  int32_t shift = exponent + 40;
  if (shift >= 0) return mantissa * ((int64_t)1 << shift);
  return shift < -61 ? 0 : (mantissa + ((int64_t)1 << (-shift - 1))) >> -shift;
}
IMUCAL_COLD static int64_t q40_from_float(float temp_degc) {
  int32_t exponent = 0;
  const int32_t mantissa = split(temp_degc, &exponent);
  return q40_from_degc(mantissa, exponent);
}

/* degC = counts * degc_per_count + degc_at_zero. */
typedef struct thermometer {
  float degc_per_count, degc_at_zero;
} thermometer_t;

/* Counts nearest to a temperature; TOO_LARGE or beyond int32 where there are none. */
IMUCAL_COLD static int64_t counts_from_degc(float temp_degc, const thermometer_t* thermometer) {
  return quotient(q40_from_float(temp_degc) - q40_from_float(thermometer->degc_at_zero), -40,
                  thermometer->degc_per_count, TO_NEAREST);
}

/* Tn of temperature counts in units of 2^-30, to the integer above. */
IMUCAL_COLD static int64_t tn_of_counts(const thermometer_t* thermometer, const imucal_table_channel_t* c,
                                        int64_t temp_counts) {
  int32_t exponent = 0;
  const int32_t mantissa = split(thermometer->degc_per_count, &exponent);
  int64_t temp_q40 = q40_from_degc(mantissa * temp_counts, exponent) + q40_from_float(thermometer->degc_at_zero);
  return quotient(temp_q40 - q40_from_float(c->t0_degc), -10, c->range_degc, TO_ABOVE);
}

IMUCAL_COLD static imucal_status prepare_temperature(imucal_comp_t* comp, const thermometer_t* thermometer,
                                                     const imucal_table_channel_t* c) {
  /* A step of more than 4 ranges leaves no two counts in the span; below, all temperatures fit 2^-40 degC. */
  if (c->range_degc < MIN_RANGE_DEGC || thermometer->degc_per_count > 4.0f * c->range_degc) return IMUCAL_ERR_PRECISION;
  const float at_degc[3] = {c->t0_degc, c->span_lo_degc, c->span_hi_degc};
  int64_t counts[3];
  for (uint32_t i = 0; i < 3; i++) {
    counts[i] = counts_from_degc(at_degc[i], thermometer);
    if (absolute(counts[i]) > INT32_MAX) return IMUCAL_ERR_PRECISION;
  }
  int64_t mid = counts[0];
  int64_t lo = counts[1], hi = counts[2];
  /* The nearest count may lie a little outside t0 +- range. */
  for (uint32_t i = 0; tn_of_counts(thermometer, c, lo) < -ONE_Q30; i++, lo++)
    if (i == 2) return IMUCAL_ERR_PRECISION;
  for (uint32_t i = 0; tn_of_counts(thermometer, c, hi) > ONE_Q30 + 1; i++, hi--)
    if (i == 2) return IMUCAL_ERR_PRECISION;
  const int64_t reach = mid - lo > hi - mid ? mid - lo : hi - mid;
  if (lo >= hi || reach > MAX_DISTANCE) return IMUCAL_ERR_PRECISION;
  uint32_t distance = (uint32_t)reach; /* 1 .. 2^30, since lo < hi: at most 30 rounds, and none overflows */
  /* The far end 2^k counts off, by the rounding of the middle perhaps, where the range may be less: from lo + 2^k the distances fill
   * all 32 bits, -2^31 .. 2^31 - 1. */
  if (distance > 1 && (distance & (distance - 1)) == 0 && (uint32_t)(hi - lo) < 2 * distance) {
    mid = lo + distance;
    distance--;
  }
  while (distance << (comp->tn_shift + 1) <= (uint32_t)INT32_MAX) comp->tn_shift++;
  const int64_t gain = float_quotient(thermometer->degc_per_count, 61 - comp->tn_shift, c->range_degc, TO_NEAREST);
  if (gain > (int64_t)INT32_MAX + 1) return IMUCAL_ERR_PRECISION; /* a range below one count */
  comp->tn_gain = gain > INT32_MAX ? INT32_MAX : (int32_t)gain;
  comp->tn_mid_q30 = (int32_t)tn_of_counts(thermometer, c, mid);
  comp->temp_mid_counts = (int32_t)mid;
  comp->temp_lo_counts = (int32_t)lo;
  comp->temp_hi_counts = (int32_t)hi;
  return IMUCAL_OK;
}

/* Coefficients 0 .. order over `unit` in units of 2^-fraction_bits, as horner_q30 wants them; their sum of
 * magnitudes, at most MAX_COEFF_SUM, or NO_SUM. */
IMUCAL_COLD static int32_t quantise(const float* value, uint32_t order, int32_t fraction_bits, float unit,
                                    int32_t* coeff) {
  int32_t left = MAX_COEFF_SUM;
  for (uint32_t i = 0; i <= order; i++) {
    const int64_t wide = float_quotient(value[i], fraction_bits, unit, i < order ? TO_ABOVE : TO_NEAREST);
    if (absolute(wide) > left) return NO_SUM;
    coeff[i] = (int32_t)wide;
    left -= (int32_t)absolute(wide);
  }
  return MAX_COEFF_SUM - left;
}

IMUCAL_COLD static imucal_status prepare_scale(imucal_comp_t* comp, const imucal_table_channel_t* c) {
  for (uint32_t i = 0; i <= c->scale_order; i++)
    if (imucal_bits_from_float(c->scale_coeff[i]) << 1 != 0) comp->has_scale = true;
  for (uint32_t shift = MAX_SCALE_SHIFT; shift >= MIN_SCALE_SHIFT; shift--) {
    comp->scale_shift = (uint8_t)shift;
    if (quantise(c->scale_coeff, c->scale_order, (int32_t)shift, 1.0f, comp->scale_coeff) != NO_SUM) return IMUCAL_OK;
  }
  return IMUCAL_ERR_PRECISION; /* sum |m| above 1/16 */
}

/* Does everything fit with this many fractional bits?  bias_sum in units of 2^-(out_frac_bits + 6). */
IMUCAL_COLD static bool fits(const imucal_comp_t* comp, int32_t bias_sum, int32_t full_scale_counts) {
  const int64_t rate = ((int64_t)full_scale_counts << comp->out_frac_bits) + (bias_sum >> GUARD_BITS) + 1;
  if (rate > INT32_MAX) return false;
  if (!comp->has_scale) return true;
  int32_t scale_sum = 0; /* at most MAX_COEFF_SUM */
  for (uint32_t i = 0; i < IMUCAL_TABLE_SCALE_N; i++) {
    const int32_t k = comp->scale_coeff[i];
    scale_sum += k < 0 ? -k : k;
  }
  /* Below 2^31 (2^30 + 6) 2^-34 + 1 < 2^28. */
  const int32_t effect = (int32_t)((int64_t)(int32_t)rate * scale_sum >> comp->scale_shift) + 1;
  return effect <= MAX_SCALE_EFFECT && effect <= INT32_MAX - (int32_t)rate;
}

IMUCAL_COLD imucal_status imucal_comp_prepare_channel(imucal_comp_t* comp, const imucal_table_channel_t* channel,
                                                      float degc_per_count, float degc_at_zero) {
  const imucal_table_channel_t* c = channel;
  const thermometer_t thermometer = {degc_per_count, degc_at_zero};
  imucal_comp_t made = {.temp_lo_counts = INT32_MIN, .temp_hi_counts = INT32_MAX};
  imucal_status status = prepare_scale(&made, c);
  /* Without a polynomial of the temperature no temperature is outside its span. */
  if (status == IMUCAL_OK && (c->order > 0 || made.has_scale)) status = prepare_temperature(&made, &thermometer, c);
  if (status != IMUCAL_OK) return status;
  made.order = c->order;
  for (uint32_t lost = 0; lost <= MAX_OUT_FRAC_BITS; lost++) {
    made.out_frac_bits = (uint8_t)(MAX_OUT_FRAC_BITS - lost);
    const int32_t sum = quantise(c->coeff, c->order, made.out_frac_bits + GUARD_BITS, c->unit_per_count, made.coeff);
    if (sum == NO_SUM || !fits(&made, sum, c->full_scale_counts)) continue;
    made.unit_per_lsb = c->unit_per_count / (float)(1u << made.out_frac_bits);
    *comp = made;
    return IMUCAL_OK;
  }
  return IMUCAL_ERR_PRECISION;
}

IMUCAL_COLD imucal_status imucal_comp_prepare(imucal_comp_t* comp, const imucal_table_t* table, uint32_t i_channel) {
  if (comp == NULL || table == NULL || i_channel >= table->n_channels) return IMUCAL_ERR_ARGUMENT;
  return imucal_comp_prepare_channel(comp, &table->channel[i_channel], table->degc_per_count, table->degc_at_zero);
}

IMUCAL_COLD imucal_status imucal_comp_pass(imucal_comp_t* comp, float unit_per_count, int32_t full_scale_counts) {
  if (comp == NULL || full_scale_counts <= 0) return IMUCAL_ERR_ARGUMENT;
  *comp = (imucal_comp_t){.temp_lo_counts = INT32_MIN, .temp_hi_counts = INT32_MAX, .scale_shift = MIN_SCALE_SHIFT};
  comp->out_frac_bits = MAX_OUT_FRAC_BITS;
  while (comp->out_frac_bits > 0 && !fits(comp, 0, full_scale_counts)) comp->out_frac_bits--;
  comp->unit_per_lsb = unit_per_count / (float)(1u << comp->out_frac_bits);
  return IMUCAL_OK;
}

/* ---- run time: integers only ---- */

static inline int32_t clamped_tn_q30(const imucal_comp_t* comp, int32_t temp_counts, uint32_t* flags) {
  if (temp_counts < comp->temp_lo_counts) {
    temp_counts = comp->temp_lo_counts;
    *flags |= IMUCAL_COMP_TEMP_CLAMPED;
  }
  if (temp_counts > comp->temp_hi_counts) {
    temp_counts = comp->temp_hi_counts;
    *flags |= IMUCAL_COMP_TEMP_CLAMPED;
  }
  const uint32_t distance = (uint32_t)temp_counts - (uint32_t)comp->temp_mid_counts;
  const int64_t product = (int64_t)(int32_t)(distance << comp->tn_shift) * comp->tn_gain;
  return (int32_t)(product >> 31) + comp->tn_mid_q30;
}

int32_t imucal_comp_tn_q30(const imucal_comp_t* comp, int32_t temp_counts, uint32_t* flags) {
  return clamped_tn_q30(comp, temp_counts, flags);
}

static inline int32_t step_q30(int32_t acc, int32_t tn_q30, int32_t coeff) {
  return (int32_t)((int64_t)acc * tn_q30 >> 30) + coeff;
}

/* Pre: sum |coeff| <= 2^30 + 6, |tn| <= 2^30 + 2.  By orders and not in a loop: 9 instructions of 81 less at order 5 on a
 * Cortex-M4F. */
IMUCAL_STATIC_ASSERT(order_is_at_most_five, IMUCAL_MAX_ORDER == 5);
static inline int32_t horner_q30(const int32_t* coeff, uint32_t order, int32_t tn_q30) {
  int32_t acc = coeff[order];
  switch (order) {
  case 5:
    acc = step_q30(acc, tn_q30, coeff[4]); /* fall through */
  case 4:
    acc = step_q30(acc, tn_q30, coeff[3]); /* fall through */
  case 3:
    acc = step_q30(acc, tn_q30, coeff[2]); /* fall through */
  case 2:
    acc = step_q30(acc, tn_q30, coeff[1]); /* fall through */
  case 1:
    acc = step_q30(acc, tn_q30, coeff[0]); /* fall through */
  default:
    return acc;
  }
}

/* M(T), of order 2 always: coefficients above its own are 0. */
IMUCAL_STATIC_ASSERT(scale_is_of_order_2, IMUCAL_TABLE_SCALE_N == 3);
static inline int32_t scale_q30(const imucal_comp_t* comp, int32_t tn_q30) {
  const int32_t* k = comp->scale_coeff;
  return step_q30(step_q30(k[2], tn_q30, k[1]), tn_q30, k[0]);
}

static inline int32_t saturate(int64_t value, uint32_t* flags) {
  if (value == (int32_t)value) return (int32_t)value;
  *flags |= IMUCAL_COMP_SATURATED;
  return value > 0 ? INT32_MAX : INT32_MIN;
}

int32_t imucal_comp_apply(const imucal_comp_t* comp, int32_t temp_counts, int32_t counts, uint32_t* flags) {
  const int32_t tn_q30 = clamped_tn_q30(comp, temp_counts, flags);
  const int32_t bias = ((int32_t)1 << (GUARD_BITS - 1)) - horner_q30(comp->coeff, comp->order, tn_q30);
  const int64_t scaled = (int64_t)counts * ((int32_t)1 << comp->out_frac_bits);
  const int32_t rate = saturate(scaled + (bias >> GUARD_BITS), flags);
  if (!comp->has_scale) return rate;
  const int64_t product = (int64_t)rate * scale_q30(comp, tn_q30);
  /* product >> (scale_shift - 6), a shift by 28 to 30: cheaper by halves. */
  const uint32_t shift = comp->scale_shift - (uint32_t)GUARD_BITS;
  const int32_t high = (int32_t)(product >> 32);
  const uint32_t low = (uint32_t)high << (32u - shift) | (uint32_t)product >> shift;
  const int64_t correction = (int64_t)(high >> shift) * ((int64_t)1 << 32) + low;
  return saturate(scaled + ((bias + correction) >> GUARD_BITS), flags);
}
