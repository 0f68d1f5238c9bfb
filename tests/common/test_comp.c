// SPDX-License-Identifier: MIT
// comp: within its proof (0.71 LSB of the output, 0.95 with a scale factor) of exact arithmetic (long double on the table's float32 values), over the whole
// input range, orders 1..5, with and without scale factor; the limits of prepare hit and passed.
#include "unit.h"

#include "comp.h"
#include "crc.h"
#include "num.h"

#define TEMP_SCALE 0.01f
#define TEMP_ZERO 25.0f

static imucal_table_t table_of(int order, const float* coeff, float unit_per_count, int32_t full_scale) {
  imucal_table_t table = {
      .serial = "T1", .sequence = 1, .n_channels = 1, .degc_per_count = TEMP_SCALE, .degc_at_zero = TEMP_ZERO};
  imucal_table_channel_t* c = &table.channel[0];
  strcpy(c->name, "gx_dph");
  c->order = (uint8_t)order;
  c->t0_degc = 30;
  c->range_degc = 30;
  c->span_lo_degc = 0;
  c->span_hi_degc = 60;
  for (int i = 0; i <= order; i++) c->coeff[i] = coeff[i];
  c->unit_per_count = unit_per_count;
  c->full_scale_counts = full_scale;
  return table;
}

/* Exact value in LSB of the output; the temperature clamped to the counts that comp names as its span. */
static long double exact(const imucal_table_t* table, const imucal_comp_t* comp, int32_t temp_counts, int32_t counts) {
  const imucal_table_channel_t* c = &table->channel[0];
  if (temp_counts < comp->temp_lo_counts) temp_counts = comp->temp_lo_counts;
  if (temp_counts > comp->temp_hi_counts) temp_counts = comp->temp_hi_counts;
  long double temp = (long double)temp_counts * table->degc_per_count + table->degc_at_zero;
  long double tn = (temp - c->t0_degc) / c->range_degc, bias = 0, scale = 0;
  for (int i = c->order; i >= 0; i--) bias = bias * tn + c->coeff[i];
  for (int i = c->scale_order; i >= 0; i--) scale = scale * tn + c->scale_coeff[i];
  return (counts - bias / c->unit_per_count) * (1 + scale) * ldexpl(1, comp->out_frac_bits);
}

/* What comp.c proves: LSB of the output. */
static double bound_of(const imucal_comp_t* comp) {
  return comp->has_scale ? 0.95 : 0.71;
}

static double worst_error(const imucal_table_t* table, const imucal_comp_t* comp, unit_rng_t* rng, int n) {
  int32_t full_scale = table->channel[0].full_scale_counts;
  double worst = 0;
  for (int i = 0; i < n; i++) {
    int32_t temp_counts =
        (int32_t)unit_integer(rng, (int64_t)comp->temp_lo_counts - 50, (int64_t)comp->temp_hi_counts + 50);
    if (i % 16 == 0) temp_counts = comp->temp_lo_counts;
    if (i % 16 == 1) temp_counts = comp->temp_hi_counts;
    if (i % 16 == 2) temp_counts = comp->temp_mid_counts;
    if (i % 1024 == 3) temp_counts = i & 1024 ? INT32_MAX : INT32_MIN;
    int32_t counts = (int32_t)unit_integer(rng, -full_scale, full_scale);
    if (i % 8 == 4) counts = full_scale;
    if (i % 8 == 5) counts = -full_scale;
    uint32_t flags = 0;
    int32_t out = imucal_comp_apply(comp, temp_counts, counts, &flags);
    assert_int_equal(flags & IMUCAL_COMP_SATURATED, 0);
    int is_outside = temp_counts < comp->temp_lo_counts || temp_counts > comp->temp_hi_counts;
    assert_int_equal(flags & IMUCAL_COMP_TEMP_CLAMPED, is_outside ? IMUCAL_COMP_TEMP_CLAMPED : 0);
    double error = fabs((double)(out - exact(table, comp, temp_counts, counts)));
    if (error > worst) worst = error;
  }
  return worst;
}

static void test_apply_random_tables_within_the_proof(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  const float units[] = {180.0f, 18.0f, 0.3f, 0.001f};
  const int32_t full_scales[] = {511, 8191, 32767, 8388607, INT32_MAX};
  double worst = 0;
  int n_prepared = 0;
  for (int run = 0; run < 4000; run++) {
    int order = run % 5 + 1;
    float coeff[6], unit = units[unit_integer(&rng, 0, 3)];
    double size = pow(10, unit_between(&rng, 0, 4.5));
    for (int i = 0; i <= order; i++) coeff[i] = (float)(size * unit_between(&rng, -1, 1));
    imucal_table_t table = table_of(order, coeff, unit, full_scales[unit_integer(&rng, 0, 4)]);
    table.degc_per_count = (float)pow(10, unit_between(&rng, -6, -0.5));
    table.degc_at_zero = (float)unit_between(&rng, -300, 100);
    if (run % 2) {
      table.channel[0].scale_order = (uint8_t)unit_integer(&rng, 0, 2);
      for (int i = 0; i <= table.channel[0].scale_order; i++)
        table.channel[0].scale_coeff[i] = (float)(pow(10, unit_between(&rng, -6, -1.7)) * unit_between(&rng, -1, 1));
    }
    for (int i = 0; i < IMUCAL_TABLE_SIGMA_N; i++) table.channel[0].sigma[i] = 1.0f;
    assert_int_equal(imucal_table_validate(&table, NULL), IMUCAL_OK);
    imucal_comp_t comp;
    imucal_status status = imucal_comp_prepare(&comp, &table, 0);
    if (status == IMUCAL_ERR_PRECISION) continue; /* refused rather than wrong */
    assert_int_equal(status, IMUCAL_OK);
    n_prepared++;
    double error = worst_error(&table, &comp, &rng, 500);
    if (error > worst) worst = error;
    if (error > bound_of(&comp))
      fail_msg("run %d: error %.3f LSB (order %d, unit %g, frac %d)", run, error, order, (double)unit,
               comp.out_frac_bits);
  }
  assert_true(n_prepared > 2000);
  if (getenv("IMUCAL_PRINT")) printf("comp: %d random tables, worst error %.3f LSB of the output\n", n_prepared, worst);
}

/* Everything at its limit at once: sum |b| = 2^24 LSB, order 5, all signs that add up. */
static void test_apply_at_the_bound_of_the_bias_within_the_proof_beyond_refused(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  for (int order = 1; order <= 5; order++) {
    for (int signs = 0; signs < 64; signs++) {
      float coeff[6] = {0};
      float each = floorf(16777216.0f / (float)(order + 1)); /* 2^24 counts in all: frac 0 */
      for (int i = 0; i <= order; i++) coeff[i] = (signs >> i & 1) ? -each : each;
      imucal_table_t table = table_of(order, coeff, 1.0f, 1000000000);
      imucal_comp_t comp;
      /* 1e7 is the table's own bound on a coefficient; prepare does not ask for it */
      assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_OK);
      assert_int_equal(comp.out_frac_bits, 0);
      assert_true(worst_error(&table, &comp, &rng, 400) <= 0.71);
      table.channel[0].coeff[order] =
          (signs >> order & 1) ? -each - 8.0f * (float)(order + 1) : each + 8.0f * (float)(order + 1);
      assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_ERR_PRECISION);
    }
  }
}

static void test_apply_around_the_bound_of_the_scale_factor_within_the_proof(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  double worst = 0;
  int n = 0, n_refused = 0;
  for (int run = 0; run < 3000; run++) {
    float each = (float)(5592405 * unit_between(&rng, 0.9, 1)) / 2;
    float coeff[6];
    for (int i = 0; i < 6; i++) coeff[i] = unit_bits(&rng) & 1 ? each : -each;
    imucal_table_t table =
        table_of(5, coeff, 1.0f, (int32_t)unit_integer(&rng, 1080000000, 2000000000)); /* no fractional bit fits */
    double room = 23726566.0 / ((double)table.channel[0].full_scale_counts + 1.7e7);   /* 2^24.5 LSB of effect */
    table.channel[0].scale_order = 2;
    const double factor = unit_between(&rng, 0.97, 1.02);
    for (int i = 0; i < 3; i++)
      table.channel[0].scale_coeff[i] = (float)(room / 3 * factor * (unit_bits(&rng) & 1 ? 1 : -1));
    imucal_comp_t comp;
    if (imucal_comp_prepare(&comp, &table, 0) != IMUCAL_OK) {
      n_refused++;
      continue;
    }
    assert_int_equal(comp.out_frac_bits, 0);
    n++;
    double error = worst_error(&table, &comp, &rng, 300);
    if (error > worst) worst = error;
  }
  assert_true(n > 500 && n_refused > 500); /* both sides of the limit were met */
  assert_true(worst <= 0.95);
  if (getenv("IMUCAL_PRINT")) printf("comp: %d tables at the scale-factor bound, worst error %.3f LSB\n", n, worst);
}

static void test_apply_coarse_sensor_mean_is_not_rounded_to_counts(void** state) {
  (void)state;
  const float coeff[4] = {80, 300, 150, -100};
  imucal_table_t table = table_of(3, coeff, 180.0f, 6000); /* ADIS16405: 0.05 deg/s per count */
  imucal_comp_t comp;
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_OK);
  assert_int_equal(comp.out_frac_bits, 8);
  uint32_t flags = 0;
  for (int temp = 0; temp <= 60; temp += 3) {
    int32_t temp_counts = (temp - 25) * 100;
    double tn = (temp - 30) / 30.0, bias = 80 + 300 * tn + 150 * tn * tn - 100 * tn * tn * tn;
    double removed = -(double)imucal_comp_apply(&comp, temp_counts, 0, &flags) * (double)comp.unit_per_lsb;
    assert_true(fabs(removed - bias) <= 180.0 / 256);
  }
}

static void test_apply_beyond_full_scale_saturates_and_is_flagged(void** state) {
  (void)state;
  const float coeff[2] = {-1000, 0};
  imucal_table_t table = table_of(1, coeff, 1.0f, 8000000);
  imucal_comp_t comp;
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_OK);
  assert_true(comp.out_frac_bits > 0);
  uint32_t flags = 0;
  assert_int_equal(imucal_comp_apply(&comp, 0, INT32_MAX, &flags), INT32_MAX);
  assert_int_equal(flags, IMUCAL_COMP_SATURATED);
  flags = 0;
  assert_int_equal(imucal_comp_apply(&comp, 0, INT32_MIN, &flags), INT32_MIN);
  assert_int_equal(flags, IMUCAL_COMP_SATURATED);
}

static void test_pass_gives_counts_back(void** state) {
  (void)state;
  imucal_comp_t comp;
  assert_int_equal(imucal_comp_pass(&comp, 18.0f, 32767), IMUCAL_OK);
  assert_int_equal(comp.out_frac_bits, 8);
  uint32_t flags = 0;
  for (int32_t counts = -32768; counts <= 32767; counts++)
    assert_int_equal(imucal_comp_apply(&comp, counts * 60000, counts, &flags), counts * 256);
  assert_int_equal(flags, 0);
  assert_int_equal(imucal_comp_pass(&comp, 1.0f, INT32_MAX), IMUCAL_OK);
  assert_int_equal(comp.out_frac_bits, 0);
  assert_int_equal(imucal_comp_apply(&comp, 0, INT32_MIN, &flags), INT32_MIN);
  assert_int_equal(imucal_comp_apply(&comp, 0, INT32_MAX, &flags), INT32_MAX);
  assert_int_equal(flags, 0);
  assert_int_equal(imucal_comp_pass(&comp, 1.0f, 0), IMUCAL_ERR_ARGUMENT);
}

static void test_prepare_refuses_what_it_cannot_hold(void** state) {
  (void)state;
  const float coeff[4] = {80, 300, 150, -100};
  imucal_comp_t comp;
  imucal_table_t table = table_of(3, coeff, 18.0f, 32767);
  assert_int_equal(imucal_comp_prepare(&comp, &table, 1), IMUCAL_ERR_ARGUMENT);
  table.degc_per_count = 100; /* two counts over the span */
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_ERR_PRECISION);
  table.degc_per_count = 3e38f;
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_ERR_PRECISION);
  table.degc_per_count = 1e-12f; /* counts beyond 2^32 over the range */
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_ERR_PRECISION);
  table = table_of(3, coeff, 1e-7f, 32767); /* bias of 6e9 counts */
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_ERR_PRECISION);
  table = table_of(3, coeff, 18.0f, 32767);
  table.channel[0].scale_coeff[0] = 0.0626f; /* above 1/16 */
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_ERR_PRECISION);
  table.channel[0].scale_coeff[0] = 0.0625f;
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_OK);
  table = table_of(3, coeff, 18.0f, 32767);
  table.channel[0].range_degc = 0.01f;
  table.channel[0].span_lo_degc = 29.995f;
  table.channel[0].span_hi_degc = 30.005f;
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_ERR_PRECISION);
}

/* It has no polynomial: no temperature is outside of it, and no thermometer too coarse for it. */
static void test_prepare_uncalibrated_channel_has_no_span(void** state) {
  (void)state;
  const float none[1] = {0};
  imucal_comp_t comp;
  imucal_table_t table = table_of(0, none, 18.0f, 32767);
  table.channel[0].t0_degc = 0.0f, table.channel[0].range_degc = 1.0f;
  table.channel[0].span_lo_degc = -1.0f, table.channel[0].span_hi_degc = 1.0f;
  for (int coarse = 0; coarse < 2; coarse++) {
    if (coarse) table.degc_per_count = 2.5f;
    assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_OK);
    for (int i = 0; i < 3; i++) {
      const int32_t temp_counts = i == 0 ? 500 : i == 1 ? INT32_MIN : INT32_MAX;
      uint32_t flags = 0;
      assert_int_equal(imucal_comp_apply(&comp, temp_counts, 1000, &flags), 1000 << comp.out_frac_bits);
      assert_int_equal(imucal_comp_tn_q30(&comp, temp_counts, &flags), 0);
      assert_int_equal(flags, 0);
    }
  }
  table.channel[0].scale_coeff[0] = 0.05f; /* a scale factor has a span */
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_ERR_PRECISION);
}

static void test_prepare_channel_alone_is_as_in_its_table(void** state) {
  (void)state;
  const float coeff[4] = {80, 300, 150, -100};
  imucal_comp_t in_table, alone;
  memset(&in_table, 0, sizeof in_table), memset(&alone, 0, sizeof alone);
  imucal_table_t table = table_of(3, coeff, 18.0f, 32767);
  const imucal_table_channel_t* channel = &table.channel[0];
  assert_int_equal(imucal_comp_prepare(&in_table, &table, 0), IMUCAL_OK);
  assert_int_equal(imucal_comp_prepare_channel(&alone, channel, table.degc_per_count, table.degc_at_zero), IMUCAL_OK);
  assert_memory_equal(&alone, &in_table, sizeof alone);
  assert_int_equal(imucal_comp_prepare_channel(&alone, channel, 100.0f, table.degc_at_zero), IMUCAL_ERR_PRECISION);
  assert_memory_equal(&alone, &in_table, sizeof alone); /* refused: as it was */
}

/* A gyro whose bias is 0 and whose scale factor is `scale` at every temperature. */
static imucal_status prepare_scaled(imucal_comp_t* comp, float scale, int64_t full_scale) {
  const float coeff[2] = {0, 0};
  imucal_table_t table = table_of(1, coeff, 1.0f, (int32_t)full_scale);
  table.channel[0].scale_coeff[0] = scale;
  return imucal_comp_prepare(comp, &table, 0);
}

/* (c) of comp.c: |M| times the largest rate <= 2^24.5 LSB; M = 2^-6 is exact, the largest rate is one more than full
 * scale, and the effect is taken to the integer above. */
static void test_prepare_bound_of_the_scale_effect_is_exact(void** state) {
  (void)state;
  imucal_comp_t comp;
  const int64_t beyond = (int64_t)23726566 * 64 - 1; /* floor(2^24.5) */
  assert_int_equal(prepare_scaled(&comp, 0x1p-6f, beyond - 1), IMUCAL_OK);
  assert_int_equal(comp.out_frac_bits, 0);
  assert_int_equal(prepare_scaled(&comp, 0x1p-6f, beyond), IMUCAL_ERR_PRECISION);
  assert_int_equal(prepare_scaled(&comp, -0x1p-6f, beyond), IMUCAL_ERR_PRECISION);
}

/* (b) of comp.c: what comes out fits 32 bits, with and without a scale factor, and where a bit more would not. */
static void test_prepare_bound_of_the_result_is_exact(void** state) {
  (void)state;
  imucal_comp_t comp;
  assert_int_equal(prepare_scaled(&comp, 0.0f, INT32_MAX - 1), IMUCAL_OK);
  assert_int_equal(prepare_scaled(&comp, -0.0f, INT32_MAX - 1), IMUCAL_OK);
  assert_false(comp.has_scale);
  assert_int_equal(prepare_scaled(&comp, 0.0f, INT32_MAX), IMUCAL_ERR_PRECISION);
  assert_int_equal(prepare_scaled(&comp, 0.0f, (INT32_MAX >> 1) + 1),
                   IMUCAL_OK); /* 2^31 with a fractional bit: none then */
  assert_int_equal(comp.out_frac_bits, 0);
  assert_int_equal(prepare_scaled(&comp, 0.0f, INT32_MAX >> 1), IMUCAL_OK);
  assert_int_equal(comp.out_frac_bits, 1);
  int64_t rate = INT32_MAX; /* largest rate whose effect, rounded up, still fits */
  while (rate + rate / 1024 + 1 > INT32_MAX) rate--;
  assert_int_equal(prepare_scaled(&comp, 0x1p-10f, rate - 1), IMUCAL_OK);
  assert_true(comp.has_scale);
  uint32_t flags = 0;
  const int32_t out = imucal_comp_apply(&comp, 0, (int32_t)rate - 1, &flags);
  assert_int_equal(flags, 0);
  assert_true(llabs((int64_t)out - (rate - 1 + rate / 1024)) <= 1);
  assert_int_equal(prepare_scaled(&comp, 0x1p-10f, rate), IMUCAL_ERR_PRECISION);
}

/* A gyro without bias whose thermometer counts `per` from `zero`. */
static imucal_status prepare_temperature_of(imucal_comp_t* comp, float t0, float range, float lo, float hi, float per,
                                            float zero) {
  const float coeff[2] = {0, 0};
  imucal_table_t table = table_of(1, coeff, 1.0f, 1000);
  table.degc_per_count = per;
  table.degc_at_zero = zero;
  table.channel[0].t0_degc = t0;
  table.channel[0].range_degc = range;
  table.channel[0].span_lo_degc = lo;
  table.channel[0].span_hi_degc = hi;
  return imucal_comp_prepare(comp, &table, 0);
}

/* (a) of comp.c: sum |c_i| = 2^30 + 6, five of them one above their values. */
static void test_prepare_bound_of_the_coefficients_is_exact(void** state) {
  (void)state;
  imucal_comp_t comp;
  const float at[6] = {0x1p24f, 0, 0, 0, 0, 0x1p-6f}, beyond[6] = {0x1p24f, 0, 0, 0, 0, 0x1p-5f};
  imucal_table_t table = table_of(5, at, 1.0f, 1000000000);
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_OK);
  assert_int_equal(comp.coeff[0], ((int32_t)1 << 30) + 1);
  assert_int_equal(comp.coeff[1] + comp.coeff[2] + comp.coeff[3] + comp.coeff[4] + comp.coeff[5], 5);
  table = table_of(5, beyond, 1.0f, 1000000000);
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_ERR_PRECISION);
}

/* (d) of comp.c: 2^30 counts from the middle to an end; |2^30 Tn| <= 2^30 + 1 there. */
static void test_prepare_bound_of_the_span_is_exact(void** state) {
  (void)state;
  imucal_comp_t comp;
  assert_int_equal(prepare_temperature_of(&comp, 0, 1024, -1024, 1024, 0x1p-20f, 0), IMUCAL_OK);
  assert_int_equal(comp.temp_lo_counts, -((int32_t)1 << 30));
  assert_int_equal(comp.temp_hi_counts, (int32_t)1 << 30);
  assert_int_equal(comp.temp_mid_counts, 0);
  assert_int_equal(comp.tn_mid_q30, 1);
  assert_int_equal(comp.tn_shift, 0);
  assert_int_equal(comp.tn_gain, INT32_MAX); /* 2^31, cut */
  assert_int_equal(prepare_temperature_of(&comp, 0x1p-20f, 1025, -1024, 1024, 0x1p-20f, 0), IMUCAL_ERR_PRECISION);
  assert_int_equal(prepare_temperature_of(&comp, 0x1p-20f, 1024, -1024, 1000, 0x1p-20f, 0), IMUCAL_ERR_PRECISION);
  assert_int_equal(prepare_temperature_of(&comp, -0x1p-20f, 1024, -1024, 1024, 0x1p-20f, 0), IMUCAL_OK);
  assert_int_equal(comp.temp_hi_counts, ((int32_t)1 << 30) - 1); /* one count beyond the range, taken back */
  /* counts fit int32 */
  assert_int_equal(prepare_temperature_of(&comp, -512, 1024, -1000, -0x1p-20f, 0x1p-20f, -2048), IMUCAL_OK);
  assert_int_equal(comp.temp_hi_counts, INT32_MAX);
  assert_int_equal(prepare_temperature_of(&comp, -512, 1024, -1000, 0, 0x1p-20f, -2048), IMUCAL_ERR_PRECISION);
  /* a range below one count from a middle between two: the gain would be above 2^31 */
  assert_int_equal(prepare_temperature_of(&comp, 0.5f, 1.0f, -0.5f, 1.5f, 1, 0), IMUCAL_OK);
  assert_int_equal(prepare_temperature_of(&comp, 0.5f, 0.75f, -0.25f, 1.25f, 1, 0), IMUCAL_ERR_PRECISION);
}

static void test_prepare_ends_outside_the_range_by_two_counts_at_most(void** state) {
  (void)state;
  imucal_comp_t comp;
  const float count = 0x1p-10f;
  for (int n = 0; n <= 2; n++) {
    const float end = 512 + (float)n * count;
    assert_int_equal(prepare_temperature_of(&comp, 0, 512, -end, end, count, 0), IMUCAL_OK);
    assert_int_equal(comp.temp_lo_counts, -((int32_t)1 << 19));
    assert_int_equal(comp.temp_hi_counts, (int32_t)1 << 19);
  }
  assert_int_equal(prepare_temperature_of(&comp, 0, 512, -512 - 3 * count, 512, count, 0), IMUCAL_ERR_PRECISION);
  assert_int_equal(prepare_temperature_of(&comp, 0, 512, -512, 512 + 3 * count, count, 0), IMUCAL_ERR_PRECISION);
}

/* t0 between two counts, so that an end is 2^k counts from the nearest and the range a little less than 2^k: on either side,
 * and with a middle outside the span's middle. */
static void test_prepare_end_a_power_of_two_beyond_the_range_is_held(void** state) {
  (void)state;
  imucal_comp_t comp;
  assert_int_equal(prepare_temperature_of(&comp, 23.5f, 63.5f, -40, 87, 1, 0), IMUCAL_OK);
  assert_true(comp.temp_lo_counts == -40 && comp.temp_mid_counts == 24 && comp.temp_hi_counts == 87);
  assert_int_equal(comp.tn_shift, 25); /* 64 counts: -2^31 */
  assert_int_equal(prepare_temperature_of(&comp, 23.25f, 63.875f, 20, 87, 1, 0), IMUCAL_OK);
  assert_true(comp.temp_lo_counts == 20 && comp.temp_mid_counts == 84 && comp.temp_hi_counts == 87);
}

/* Thermometers of 1 degC to 2^-22 of 60 degC a count, any span: none is refused, all within the proof. */
static void test_prepare_any_span_of_a_coarse_thermometer_within_the_proof(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  const float per[] = {1.0f, 0.5f, 0.125f, 0.01f, 60.0f / 4194304}, zero[] = {0, 25};
  uint32_t n_moved = 0;
  for (int run = 0; run < 40000; run++) {
    const float lo = (float)(unit_integer(&rng, -4000, 2100)) / 100, hi = (float)(unit_integer(&rng, 4000, 9100)) / 100;
    float coeff[6];
    for (int i = 0; i < 6; i++) coeff[i] = (float)(30000 * unit_between(&rng, -1, 1));
    imucal_table_t table = table_of(5, coeff, 27.0f, 32767);
    table.degc_per_count = per[run % 5];
    table.degc_at_zero = zero[run / 5 % 2];
    imucal_table_channel_t* c = &table.channel[0];
    c->t0_degc = (lo + hi) / 2;
    c->range_degc = (hi - lo) / 2 * 1.00001f;
    c->span_lo_degc = lo;
    c->span_hi_degc = hi;
    imucal_comp_t comp;
    assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_OK);
    const int is_moved = ((int64_t)comp.temp_mid_counts - comp.temp_lo_counts) << comp.tn_shift > INT32_MAX;
    n_moved += is_moved;
    if (is_moved) assert_true(worst_error(&table, &comp, &rng, 200) <= bound_of(&comp));
  }
  assert_true(n_moved > 50);
}

/* The least range, and the finest thermometer: temperatures are rounded to 2^-40 degC, a 64th of a unit of Tn there. */
static void test_prepare_least_range_temperatures_are_rounded_to_nearest(void** state) {
  (void)state;
  imucal_comp_t comp;
  const float range = 0x1p-4f, per = 0x1p-34f, unit = 0x1p-40f;
  const float below = imucal_float_from_bits(imucal_bits_from_float(range) - 1);
  assert_int_equal(prepare_temperature_of(&comp, 0, range, -range, range, per, 0), IMUCAL_OK);
  assert_int_equal(prepare_temperature_of(&comp, 0, below, -below, below, per, 0), IMUCAL_ERR_PRECISION);
  /* t0, the thermometer's zero, and the middle count's Tn in units of 2^-30, to the integer above */
  const struct {
    float t0, zero;
    int32_t tn;
  } at[] = {{0, 32 * unit, 1},           {1.5f * unit, 2 * unit, 1},  {1.5f * unit, unit, 0},
            {1.25f * unit, unit, 1},     {0.75f * unit, unit, 1},     {0.75f * unit, 0, 0},
            {0.25f * unit, 0, 1},        {0.5f * unit, 0, 0},         {unit, 1.5f * unit, 1},
            {2 * unit, 1.5f * unit, 1},  {2 * unit, 1.25f * unit, 0}, {-1.5f * unit, -unit, 1},
            {-1.5f * unit, -2 * unit, 0}};
  for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
    assert_int_equal(prepare_temperature_of(&comp, at[i].t0, range, -range / 2, range / 2, per, at[i].zero), IMUCAL_OK);
    if (comp.temp_mid_counts == 0) assert_int_equal(comp.tn_mid_q30, at[i].tn);
  }
}

/* Floats below 2^-126 have no leading one. */
static void test_prepare_subnormal_coefficients_are_exact(void** state) {
  (void)state;
  const float coeff[2] = {0x1p-127f, 0x1p-149f};
  imucal_table_t table = table_of(1, coeff, 0x1p-126f, 1000);
  imucal_comp_t comp;
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_OK);
  assert_int_equal(comp.out_frac_bits, 8);
  assert_int_equal(comp.coeff[0], (1 << 13) + 1);
  assert_int_equal(comp.coeff[1], 0);
}

static void test_prepare_wrong_arguments_are_refused(void** state) {
  (void)state;
  const float coeff[2] = {0, 0};
  imucal_table_t table = table_of(1, coeff, 1.0f, 1000);
  imucal_comp_t comp;
  assert_int_equal(imucal_comp_prepare(NULL, &table, 0), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_comp_prepare(&comp, NULL, 0), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_comp_pass(NULL, 1.0f, 1000), IMUCAL_ERR_ARGUMENT);
  assert_int_equal(imucal_comp_pass(&comp, 3.0f, 1), IMUCAL_OK);
  assert_true(comp.out_frac_bits == 8 && comp.unit_per_lsb == 3.0f / 256);
}

/* ---- what prepare makes ---- */

/* A float of random bits, its magnitude in [2^lo, 2^hi): the same on every machine. */
static float float_of(unit_rng_t* rng, int lo, int hi) {
  const uint32_t exponent = (uint32_t)(unit_integer(rng, lo, hi - 1) + 127);
  const uint64_t bits = unit_bits(rng);
  return imucal_float_from_bits((uint32_t)(bits >> 32 & 0x80000000u) | exponent << 23 | (uint32_t)(bits & 0x7FFFFFu));
}

/* Any table that might be prepared: sizes from nothing to the limits of every float. */
static imucal_table_t random_table(unit_rng_t* rng) {
  const int32_t full_scales[] = {1, 511, 32767, 8388607, INT32_MAX};
  const int order = (int)unit_integer(rng, 0, 5);
  const int unit = (int)unit_integer(rng, -20, 10);
  const int size = unit + (int)unit_integer(rng, -8, 27);
  float coeff[6];
  for (int i = 0; i <= order; i++) coeff[i] = float_of(rng, size - 6, size);
  const int32_t full_scale = full_scales[unit_integer(rng, 0, 4)];
  imucal_table_t table = table_of(order, coeff, fabsf(float_of(rng, unit, unit + 1)), full_scale);
  imucal_table_channel_t* c = &table.channel[0];
  c->range_degc = fabsf(float_of(rng, -4, 10));
  c->t0_degc = float_of(rng, unit_bits(rng) & 1 ? -44 : 0, 9);
  c->span_lo_degc = c->t0_degc - c->range_degc * (float)unit_integer(rng, 1, 4) / 4;
  c->span_hi_degc = c->t0_degc + c->range_degc * (float)unit_integer(rng, 1, 4) / 4;
  table.degc_per_count = fabsf(float_of(rng, -36, 3)) * c->range_degc;
  table.degc_at_zero = float_of(rng, unit_bits(rng) & 1 ? -44 : 0, 11);
  c->scale_order = (uint8_t)unit_integer(rng, 0, 2);
  for (int i = 0; i <= c->scale_order; i++) c->scale_coeff[i] = unit_bits(rng) & 1 ? 0 : float_of(rng, -38, -5);
  return table;
}

/* Rounding of quotients that are good to 2^-5 unit (comp.c): what is lost lies in [lo, hi]. */
static void expect_rounded(int64_t made, long double exact_value, double lo, double hi) {
  const double off = (double)(made - exact_value);
  if (off < lo - 0x1p-5 || off > hi + 0x1p-5) fail_msg("%lld for %.3f", (long long)made, (double)exact_value);
}

static double sum_of_exact(const float* value, int order, double unit) {
  double sum = 0;
  for (int i = 0; i <= order; i++) sum += fabs((double)value[i]) / unit;
  return sum;
}

static void expect_temperature(const imucal_comp_t* comp, const imucal_table_t* table) {
  const imucal_table_channel_t* c = &table->channel[0];
  if (c->order == 0 && !comp->has_scale) { /* not calibrated */
    assert_true(comp->temp_lo_counts == INT32_MIN && comp->temp_hi_counts == INT32_MAX);
    assert_true(comp->tn_gain == 0 && comp->tn_mid_q30 == 0);
    return;
  }
  const long double per = table->degc_per_count, zero = table->degc_at_zero, t0 = c->t0_degc, range = c->range_degc;
  const int64_t mid = comp->temp_mid_counts, lo = comp->temp_lo_counts, hi = comp->temp_hi_counts;
  const int64_t reach = mid - lo > hi - mid ? mid - lo : hi - mid;
  const int has_moved = reach << comp->tn_shift > INT32_MAX; /* the middle: 2^k counts above the low end */
  if (!has_moved) expect_rounded(mid, (t0 - zero) / per, -0.5, 0.5);
  expect_rounded(lo, (c->span_lo_degc - zero) / per, -0.5, 2.5);
  expect_rounded(hi, (c->span_hi_degc - zero) / per, -2.5, 0.5);
  expect_rounded(comp->tn_mid_q30, 0x1p30L * (mid * per + zero - t0) / range, 0, 1);
  const int is_cut = comp->tn_gain == INT32_MAX;
  expect_rounded(comp->tn_gain, ldexpl(per / range, 61 - comp->tn_shift), is_cut ? -1.5 : -0.5, 0.5);
  assert_true(lo < hi && reach <= (int64_t)1 << 30 && reach << (comp->tn_shift + 1) > INT32_MAX);
  if (!has_moved) return;
  assert_true(reach > 1 && (reach & (reach - 1)) == 0);
  assert_true((mid - lo) << comp->tn_shift == (int64_t)INT32_MAX + 1 && (hi - mid) << comp->tn_shift <= INT32_MAX);
}

static void expect_coefficients(const int32_t* made, const float* value, int order, int n, double unit) {
  for (int i = 0; i < n; i++) {
    if (i < order) expect_rounded(made[i], value[i] / unit, 0, 1);
    if (i == order) expect_rounded(made[i], value[i] / unit, -0.5, 0.5);
    if (i > order) assert_int_equal(made[i], 0);
  }
}

/* As many fractional bits, and as fine a scale factor, as the limits (a), (b) and (c) of comp.c leave. */
static void expect_finest(const imucal_comp_t* comp, const imucal_table_channel_t* c) {
  const double m = sum_of_exact(c->scale_coeff, c->scale_order, 1);
  assert_true(comp->scale_shift == 36 || ldexp(m, comp->scale_shift + 1) > 0x1p30 - 4);
  if (comp->out_frac_bits == 8) return;
  const double finer = ldexp(1, comp->out_frac_bits + 1);
  const double bias = sum_of_exact(c->coeff, c->order, (double)c->unit_per_count) * finer;
  const double rate = c->full_scale_counts * finer + bias;
  assert_true(bias > 0x1p24 - 1 || rate * (1 + m) > 0x1p31 - 6 || m * rate > 23726566 - 4);
}

/* CRC-32 over what was prepared, little-endian. */
static uint32_t digest(uint32_t crc, const imucal_comp_t* comp) {
  uint8_t bytes[4 + 17 * 4];
  int32_t words[17] = {comp->temp_lo_counts,
                       comp->temp_hi_counts,
                       comp->temp_mid_counts,
                       comp->tn_mid_q30,
                       comp->tn_gain,
                       comp->tn_shift | comp->order << 8 | comp->out_frac_bits << 16,
                       comp->scale_shift | comp->has_scale << 8,
                       (int32_t)imucal_bits_from_float(comp->unit_per_lsb)};
  for (int i = 0; i < 6; i++) words[8 + i] = comp->coeff[i];
  for (int i = 0; i < 3; i++) words[14 + i] = comp->scale_coeff[i];
  imucal_put_u32(bytes, crc);
  for (size_t i = 0; i < 17; i++) imucal_put_u32(bytes + 4 + 4 * i, (uint32_t)words[i]);
  return imucal_crc32(bytes, sizeof bytes);
}

/* The same integers on every machine.  The two figures at the end are of this very test: a change of prepare that gives
 * other integers inside the bounds above changes them. */
static void test_prepare_makes_the_exact_values_rounded_as_the_proof_says(void** state) {
  (void)state;
  unit_rng_t rng = {0x9E3779B97F4A7C15ULL};
  uint32_t n_prepared = 0, crc = 0;
  for (int run = 0; run < 20000; run++) {
    const imucal_table_t table = random_table(&rng);
    const imucal_table_channel_t* c = &table.channel[0];
    imucal_comp_t comp = {0};
    const imucal_status status = imucal_comp_prepare(&comp, &table, 0);
    if (status != IMUCAL_OK) {
      assert_int_equal(status, IMUCAL_ERR_PRECISION);
      continue;
    }
    n_prepared++;
    expect_temperature(&comp, &table);
    expect_coefficients(comp.coeff, c->coeff, c->order, 6, ldexp((double)c->unit_per_count, -comp.out_frac_bits - 6));
    expect_coefficients(comp.scale_coeff, c->scale_coeff, c->scale_order, 3, ldexp(1, -comp.scale_shift));
    expect_finest(&comp, c);
    assert_true(comp.unit_per_lsb == ldexpf(c->unit_per_count, -comp.out_frac_bits));
    assert_int_equal(comp.order, c->order);
    assert_int_equal(comp.has_scale, sum_of_exact(c->scale_coeff, c->scale_order, 1) > 0);
    crc = digest(crc, &comp);
  }
  assert_int_equal(n_prepared, 10667);
  assert_int_equal(crc, 0x8B9797D5);
}

/* Tn as the bias sees it: -1, 0 and 1 at the ends and the middle of the span, clamped and flagged beyond. */
static void test_tn_of_the_span_and_beyond(void** state) {
  (void)state;
  const float coeff[2] = {0, 0};
  const imucal_table_t table = table_of(1, coeff, 1.0f, 1000);
  imucal_comp_t comp;
  assert_int_equal(imucal_comp_prepare(&comp, &table, 0), IMUCAL_OK);
  const struct {
    int32_t temp_counts;
    double tn;
    uint32_t flags;
  } at[] = {{500, 0, 0},
            {-2500, -1, 0},
            {3500, 1, 0},
            {2000, 0.5, 0},
            {3501, 1, IMUCAL_COMP_TEMP_CLAMPED},
            {-2501, -1, IMUCAL_COMP_TEMP_CLAMPED}};
  for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
    uint32_t flags = 0;
    const double tn = imucal_comp_tn_q30(&comp, at[i].temp_counts, &flags) * 0x1p-30;
    assert_true(fabs(tn - at[i].tn) <= 300 * 0x1p-30); /* 0.01 in float32 is off by 2e-8 of itself */
    assert_int_equal(flags, at[i].flags);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_tn_of_the_span_and_beyond),
      cmocka_unit_test(test_apply_coarse_sensor_mean_is_not_rounded_to_counts),
      cmocka_unit_test(test_apply_beyond_full_scale_saturates_and_is_flagged),
      cmocka_unit_test(test_pass_gives_counts_back),
      cmocka_unit_test(test_prepare_refuses_what_it_cannot_hold),
      cmocka_unit_test(test_prepare_uncalibrated_channel_has_no_span),
      cmocka_unit_test(test_prepare_channel_alone_is_as_in_its_table),
      cmocka_unit_test(test_prepare_bound_of_the_scale_effect_is_exact),
      cmocka_unit_test(test_prepare_bound_of_the_result_is_exact),
      cmocka_unit_test(test_prepare_bound_of_the_coefficients_is_exact),
      cmocka_unit_test(test_prepare_bound_of_the_span_is_exact),
      cmocka_unit_test(test_prepare_ends_outside_the_range_by_two_counts_at_most),
      cmocka_unit_test(test_prepare_end_a_power_of_two_beyond_the_range_is_held),
      cmocka_unit_test(test_prepare_any_span_of_a_coarse_thermometer_within_the_proof),
      cmocka_unit_test(test_prepare_least_range_temperatures_are_rounded_to_nearest),
      cmocka_unit_test(test_prepare_subnormal_coefficients_are_exact),
      cmocka_unit_test(test_prepare_wrong_arguments_are_refused),
      cmocka_unit_test(test_prepare_makes_the_exact_values_rounded_as_the_proof_says),
      cmocka_unit_test(test_apply_random_tables_within_the_proof),
      cmocka_unit_test(test_apply_at_the_bound_of_the_bias_within_the_proof_beyond_refused),
      cmocka_unit_test(test_apply_around_the_bound_of_the_scale_factor_within_the_proof),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
