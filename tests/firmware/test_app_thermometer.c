// SPDX-License-Identifier: MIT
/* A board with a thermometer of 1 degC: the filters learn with the temperature between its steps. */
#include <math.h>

#include "bench.h"

static bench_t bench;

#define SOAK_S 300.0
#define RAMP_DEGC_S 0.02

static double temperature(uint64_t t_us) {
  const double t_s = (double)t_us * 1e-6;
  return t_s < SOAK_S ? 0.0 : (t_s - SOAK_S) * RAMP_DEGC_S;
}

/* 100 dph/degC and no noise: what the filter cannot explain is the thermometer's error. */
static void steep(uint64_t t_us, imucal_sample_t* sample) {
  const double temp = temperature(t_us);
  sample->temp_counts = (int32_t)lround(temp / (double)bench.board.degc_per_count);
  for (int i = 0; i < 3; i++) sample->counts[i] = (int32_t)lround(100.0 * (temp - 30.0));
}

/* Mean normalised innovation squared of a calibration over a soak and a ramp to 40 degC. */
static double learn(float degc_per_count) {
  bench_start(&bench);
  bench.board.degc_per_count = degc_per_count;
  bench.board.degc_at_zero = 0.0f;
  bench_power_cycle(&bench);
  bench.shape = steep;
  bench.t_us = 0;
  assert_int_equal(bench_cal_start(&bench, 0, 1), IMUCAL_OK);
  assert_int_equal(bench_stream(&bench, IMUCAL_STREAM_SECOND), IMUCAL_OK); /* samples flow from now on */
  bench_feed(&bench, 2300);
  assert_true(bench.app.channel[0].learn.kf.stats.n > 2000);
  return (double)imucal_kf_mean_nis(&bench.app.channel[0].learn.kf);
}

/* As read, the sawtooth of +-50 dph would be most of the innovations: 0.2 and more instead of less than 0.02.
 */
static void test_coarse_thermometer_steps_are_followed(void** state) {
  (void)state;
  const double fine = learn(0.01f), coarse = learn(1.0f);
  assert_true(fine < 0.02);
  if (coarse > fine + 0.02) fail_msg("mean NIS %.3f with a coarse thermometer, %.3f with a fine one", coarse, fine);
  assert_true(fabs((double)imucal_kf_bias(&bench.app.channel[0].learn.kf, 20.0f) + 1000.0) < 10.0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_coarse_thermometer_steps_are_followed)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
