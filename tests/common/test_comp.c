// SPDX-License-Identifier: MIT
// comp: within its proof (0.71 LSB of the output, 0.95 with a scale factor) of exact arithmetic (long double on the table's float32 values), over the whole
// input range, orders 1..5, with and without scale factor; the limits of prepare hit and passed.
#include "unit.h"

#include "comp.h"
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

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_apply_random_tables_within_the_proof),
      cmocka_unit_test(test_apply_at_the_bound_of_the_bias_within_the_proof_beyond_refused),
      cmocka_unit_test(test_apply_around_the_bound_of_the_scale_factor_within_the_proof),
      cmocka_unit_test(test_apply_coarse_sensor_mean_is_not_rounded_to_counts),
      cmocka_unit_test(test_apply_beyond_full_scale_saturates_and_is_flagged),
      cmocka_unit_test(test_pass_gives_counts_back),
      cmocka_unit_test(test_prepare_refuses_what_it_cannot_hold),
      cmocka_unit_test(test_prepare_bound_of_the_scale_effect_is_exact),
      cmocka_unit_test(test_prepare_bound_of_the_result_is_exact),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
