// SPDX-License-Identifier: MIT
// The exact covariance against the core's own filter (float32) on the same temperatures.
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>

#include "analysis/profile/covariance.h"
#include "base/units.h"
extern "C" {
#include "kf.h"
}
extern "C" {
#include <cmocka.h>
}

using namespace imucal;

static void check_order(int order) {
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  Profile profile;
  profile.segments = {{0, 1200, 0}, {0.6, 0, 60}, {0, 1200, 60}};
  CalibrationSetup setup;
  setup.order = order;
  setup.hi_degc = 60;
  setup.truth = setup.filter = model;
  setup.points = 13;
  const auto runs = runs_of_profile(profile);
  const CalibrationError exact = calibration_error(runs, setup);

  imucal_kf_config_t config = {};
  config.order = static_cast<uint8_t>(order);
  config.t0_degc = 30;
  config.range_degc = 30;
  config.m = static_cast<float>(1 - model.markov[0].phi());
  config.q = static_cast<float>(model.markov[0].q_dph2());
  config.r = static_cast<float>(std::pow(white_sigma_dph(model.arw_deg_rt_h), 2));
  config.markov_variance = 400;
  config.prior_sigma = 1e4f;
  imucal_kf_t kf;
  assert_int_equal(imucal_kf_init(&kf, &config), IMUCAL_OK);
  for (double t : runs[0].temp_degc) assert_int_equal(imucal_kf_update(&kf, 0, static_cast<float>(t)), IMUCAL_OK);
  for (size_t i = 0; i < exact.temp_degc.size(); ++i) {
    const double core_dph = imucal_kf_bias_sigma(&kf, static_cast<float>(exact.temp_degc[i]));
    // 2e-4: what float32 keeps (tests/README.md, reference figures D).
    if (std::abs(core_dph / exact.sigma_dph[i] - 1) > 2e-4)
      fail_msg("order %d, %g degC: core %.6f, exact %.6f dph", order, exact.temp_degc[i], core_dph, exact.sigma_dph[i]);
  }
}

static void test_error_agrees_with_the_core_filter(void**) {
  for (int order = 1; order <= 5; ++order) check_order(order);
}

int main() {
  const CMUnitTest tests[] = {cmocka_unit_test(test_error_agrees_with_the_core_filter)};
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
