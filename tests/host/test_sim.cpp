// SPDX-License-Identifier: MIT
// The simulator itself: noise against closed forms within sampling error, streams independent, flaws as asked
// for. Thresholds are stated in standard errors; seeds are fixed, so a failure is a change of the product.
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>
extern "C" {
#include <cmocka.h>
}

#include "base/error.h"
#include "base/fast_normal.h"
#include "io/json_file.h"
#include "physics/sim/raw_samples.h"
#include "physics/sim/simulate.h"

using namespace imucal;

static ErrorModel model_of(double arw_deg_rt_h, std::vector<Markov> markov, double turn_on_sigma_dph = 0) {
  ErrorModel model;
  model.arw_deg_rt_h = arw_deg_rt_h;
  model.markov = std::move(markov);
  model.turn_on_sigma_dph = turn_on_sigma_dph;
  return model;
}

static Profile soak(double duration_s, double at_degc = 25) {
  Profile profile;
  profile.start_degc = at_degc;
  profile.segments.push_back({0, duration_s, 0});
  return profile;
}

static std::vector<double> noise(const ErrorModel& model, size_t n, const SimOptions& options, size_t axis = 0) {
  return simulate({model}, axis + 1, soak(static_cast<double>(n)), {}, options).axes[axis].run.rate_dph;
}

// Mean over runs and its standard error.
struct Mean {
  double sum = 0, sum2 = 0;
  long n = 0;
  void add(double x) { sum += x, sum2 += x * x, ++n; }
  double mean() const { return sum / static_cast<double>(n); }
  double error() const {
    return std::sqrt((sum2 / static_cast<double>(n) - mean() * mean()) / static_cast<double>(n - 1));
  }
};

static void assert_within(const Mean& found, double expected, double n_errors, const char* what) {
  const double z = (found.mean() - expected) / found.error();
  if (std::abs(z) > n_errors)
    fail_msg("%s: %.6g +- %.2g, expected %.6g (%.1f standard errors)", what, found.mean(), found.error(), expected, z);
}

static void test_simulate_autocovariance_is_the_closed_form(void**) {
  const ErrorModel model = model_of(0.6, {{20, 100}, {14, 8}});
  const std::vector<size_t> lags = {0, 1, 2, 5, 10, 30, 100, 300};
  std::vector<Mean> found(lags.size());
  for (size_t r = 0; r < 300; ++r) {
    SimOptions options;
    options.seed = 11;
    options.log_index = r;
    const auto x = noise(model, 4000, options);
    for (size_t i = 0; i < lags.size(); ++i) {
      double sum = 0;
      for (size_t k = 0; k + lags[i] < x.size(); ++k) sum += x[k] * x[k + lags[i]];
      found[i].add(sum / static_cast<double>(x.size() - lags[i])); // the mean is known: zero
    }
  }
  for (size_t i = 0; i < lags.size(); ++i) {
    const auto lag = static_cast<double>(lags[i]);
    const double expected = (lag == 0 ? 36.0 * 36.0 : 0.0) + 400 * std::exp(-lag / 100) + 196 * std::exp(-lag / 8);
    assert_within(found[i], expected, 3.5, ("autocovariance at lag " + std::to_string(lags[i])).c_str());
  }
}

// DP type 2 of simulated noise against the closed form (reference figures C, tests/README.md), both written out here a second time.
static void test_simulate_dp2_is_the_closed_form(void**) {
  const ErrorModel model = model_of(1.1, {{14, 20}, {14, 70}});
  const double phi_nominal = std::exp(-1 / 100.0), q = 400 * (1 - phi_nominal * phi_nominal), r = 36.0 * 36.0;
  double p = 400;
  for (int i = 0; i < 10000; ++i) p = (p * phi_nominal * phi_nominal + q) * r / (p * phi_nominal * phi_nominal + q + r);
  const double prior = p * phi_nominal * phi_nominal + q, gain = prior / (prior + r), a = phi_nominal * (1 - gain);
  const std::vector<size_t> spans = {2, 10, 50, 100, 200};
  const std::vector<double> design_dph = {34.85, 18.79, 14.33, 13.99, 13.88};
  std::vector<Mean> found(spans.size());
  for (size_t run = 0; run < 300; ++run) {
    SimOptions options;
    options.seed = 12;
    options.log_index = run;
    const auto x = noise(model, 4000, options);
    std::vector<double> sum(x.size() + 1, 0), estimate(x.size(), 0);
    for (size_t k = 0; k < x.size(); ++k) {
      sum[k + 1] = sum[k] + x[k];
      estimate[k] = a * (k ? estimate[k - 1] : 0) + gain * x[k];
    }
    for (size_t i = 0; i < spans.size(); ++i) {
      double d2 = 0;
      long n = 0;
      for (size_t t0 = 1000; t0 + spans[i] <= x.size(); ++t0, ++n) {
        const double d = (sum[t0 + spans[i]] - sum[t0]) / static_cast<double>(spans[i]) - estimate[t0 - 1];
        d2 += d * d;
      }
      found[i].add(d2 / static_cast<double>(n) / 2);
    }
  }
  for (size_t i = 0; i < spans.size(); ++i) {
    const auto n = static_cast<double>(spans[i]);
    double closed = 66.0 * 66.0 * (1 / n + gain * gain / (1 - a * a));
    for (const Markov& m : model.markov) {
      const double phi = m.phi(), s2 = m.sigma_dph * m.sigma_dph;
      double series = n;
      for (size_t k = 1; k < spans[i]; ++k)
        series += 2 * (n - static_cast<double>(k)) * std::pow(phi, static_cast<double>(k));
      closed += s2 / n / n * series + s2 * gain * gain / (1 - a * a) * (1 + a * phi) / (1 - a * phi) -
                2 * s2 / n * (1 - std::pow(phi, n)) / (1 - phi) * gain * phi / (1 - a * phi);
    }
    assert_within(found[i], closed / 2, 3.5, ("DP2 at " + std::to_string(spans[i]) + " s").c_str());
    assert_true(std::abs(std::sqrt(closed / 2) - design_dph[i]) < 0.01);
  }
}

static void test_simulate_markov_starts_stationary(void**) {
  Mean square;
  for (size_t r = 0; r < 4000; ++r) {
    SimOptions options;
    options.log_index = r;
    const double first = noise(model_of(0, {{20, 500}}), 2, options)[0];
    square.add(first * first);
  }
  assert_within(square, 400, 3.5, "variance of the first second");
}

// White noise and Markov noise of a time constant so short that it is white: every pair of logs, axes,
// devices, seeds and both streams must be uncorrelated.  820 pairs; the largest of 820 normal |z| exceeds 4.9
// once in 1000.
static void test_simulate_runs_axes_devices_and_seeds_are_uncorrelated(void**) {
  const size_t n = 3000;
  std::vector<std::vector<double>> series;
  for (const ErrorModel& model : {model_of(0.6, {}), model_of(0, {{36, 0.01}})})
    for (size_t which = 0; which < 5; ++which)
      for (size_t axis = 0; axis < 4; ++axis) {
        SimOptions options;
        options.seed = which == 1 ? 2 : 1;
        options.log_index = which == 2 ? 1 : which == 3 ? 65535 : 0;
        options.device = which == 4 ? 1 : 0;
        series.push_back(simulate({model}, 4, soak(n), {}, options).axes[axis].run.rate_dph);
      }
  double worst = 0;
  for (size_t i = 0; i < series.size(); ++i)
    for (size_t j = 0; j < i; ++j) {
      double product = 0;
      for (size_t k = 0; k < n; ++k) product += series[i][k] * series[j][k];
      worst = std::max(worst, std::abs(product) / (36.0 * 36.0 * std::sqrt(static_cast<double>(n))));
    }
  if (worst > 4.9) fail_msg("two streams are correlated: z = %.1f", worst);
}

static void test_simulate_same_seed_same_log_whatever_else_is_asked(void**) {
  const ErrorModel model = model_of(0.6, {{20, 100}}, 50);
  SimOptions options;
  options.seed = 5;
  options.log_index = 3;
  const auto one = simulate({model}, 1, soak(100), {}, options);
  options.missing_frac = 0.5;
  options.jitter_s = 0.01;
  const auto more = simulate({model}, 3, soak(100), {}, options);
  assert_true(one.axes[0].run.rate_dph == more.axes[0].run.rate_dph);
  options.seed = 6;
  assert_true(one.axes[0].run.rate_dph != simulate({model}, 1, soak(100), {}, options).axes[0].run.rate_dph);
}

static void test_simulate_turn_on_is_constant_in_a_log_and_differs_between_logs(void**) {
  ErrorModel model = model_of(0, {}, 50);
  Mean square;
  for (size_t log = 0; log < 2000; ++log) {
    SimOptions options;
    options.log_index = log;
    const auto simulated = simulate({model}, 1, soak(3), {}, options);
    const auto& x = simulated.axes[0].run.rate_dph;
    assert_true(x[0] == x[2] && x[0] == simulated.axes[0].turn_on_dph);
    square.add(x[0] * x[0]);
  }
  assert_within(square, 2500, 3.5, "variance of turn-on constants");
}

static void test_simulate_bias_follows_the_polynomial(void**) {
  ErrorModel model = model_of(0, {});
  model.bias = ThermalPolynomial{30, 30, {80, 300, 150, -100}};
  Profile ramp;
  ramp.start_degc = 0;
  ramp.segments.push_back({0.6, 0, 60});
  const auto run = simulate({model}, 1, ramp, {}, SimOptions{}).axes[0].run;
  assert_int_equal(run.rate_dph.size(), 6000);
  for (size_t k = 0; k < 6000; k += 7) {
    const double tn = ((static_cast<double>(k) + 0.5) * 0.01 - 30) / 30;
    assert_true(std::abs(run.rate_dph[k] - (80 + tn * (300 + tn * (150 - 100 * tn)))) < 1e-9);
  }
}

static void test_simulate_gap_decorrelates_by_its_length(void**) {
  Mean product;
  for (size_t r = 0; r < 6000; ++r) {
    SimOptions options;
    options.log_index = r;
    const auto x = simulate({model_of(0, {{20, 100}})}, 1, {1, 2, 72}, {25, 25, 25}, {}, options).axes[0].run.rate_dph;
    product.add(x[1] * x[2]);
  }
  assert_within(product, 400 * std::exp(-0.7), 3.5, "covariance over a gap of 70 s");
}

static void test_log_flaws_are_as_asked_for(void**) {
  SimOptions options;
  options.rate_lsb_dph = 180;
  options.temp_lsb_degc = 0.5;
  options.temp_noise_degc = 0.3;
  options.missing_frac = 0.25;
  options.jitter_s = 0.2;
  const Log log = to_log(simulate({model_of(3, {})}, 2, soak(4000, 25.2), {}, options), options);
  assert_true(std::abs(static_cast<double>(log.size()) - 3000) < 3.5 * std::sqrt(4000 * 0.25 * 0.75));
  bool sees_both = false;
  for (size_t k = 0; k < log.size(); ++k) {
    assert_true(std::abs(std::remainder(log.axes[1].rate_dph[k], 180)) < 1e-9);
    assert_true(std::abs(std::remainder(log.temp_degc[k], 0.5)) < 1e-9);
    sees_both = sees_both || log.temp_degc[k] != log.temp_degc[0];
    if (k > 0) assert_true(log.t_s[k] > log.t_s[k - 1]);
  }
  assert_true(sees_both);
}

static void test_simulate_unknown_effect_or_axis_is_refused(void**) {
  const auto refused = [](const EffectSpec& effect, const char* expected) {
    try {
      simulate({model_of(0.6, {})}, 2, soak(10), {effect}, SimOptions{});
    } catch (const Error& error) {
      if (std::string(error.what()).find(expected) == std::string::npos) fail_msg("message: %s", error.what());
      return;
    }
    fail_msg("%s was taken", effect.name.c_str());
  };
  refused({"no_such_effect", {}, "", -1}, "no_such_effect");
  refused({"warm_up", {}, "gz_dph", -1}, "axis \"gz_dph\" is not simulated");
}

static void test_simulate_effect_acts_on_its_axis_and_log_alone(void**) {
  const ErrorModel model = model_of(0.6, {{20, 100}});
  const EffectSpec ramp{"rate_ramp", Json{{"ramp_dph_per_h", 3600}}, "gy", 1};
  SimOptions options;
  for (size_t log = 0; log < 2; ++log) {
    options.log_index = log;
    const auto without = simulate({model}, 3, soak(100), {}, options),
               with = simulate({model}, 3, soak(100), {ramp}, options);
    assert_true(without.axes[0].run.rate_dph == with.axes[0].run.rate_dph);
    assert_true(without.axes[2].run.rate_dph == with.axes[2].run.rate_dph);
    const auto &a = without.axes[1].run.rate_dph, &b = with.axes[1].run.rate_dph;
    // 1 dph per second in log 1 over the same noise, nothing in log 0.
    assert_true(std::abs((b[90] - a[90]) - (b[10] - a[10]) - (log == 1 ? 80 : 0)) < 1e-9);
  }
}

static void test_fast_normal_has_the_normal_distribution(void**) {
  FastNormal source(Rng(1, 2, 3, 4u));
  const int n = 2000000;
  std::vector<double> counts(82, 0);
  for (int i = 0; i < n; ++i) {
    const double x = source.normal();
    counts[static_cast<size_t>(std::min(81.0, std::max(0.0, std::floor(x * 10) + 41)))] += 1;
  }
  double chi2 = 0;
  for (size_t bin = 0; bin < counts.size(); ++bin) {
    const double lo = bin == 0 ? -40 : (static_cast<double>(bin) - 41) / 10,
                 hi = bin == 81 ? 40 : (static_cast<double>(bin) - 40) / 10;
    const double expected = n * 0.5 * (std::erfc(lo / std::sqrt(2.0)) - std::erfc(hi / std::sqrt(2.0)));
    chi2 += (counts[bin] - expected) * (counts[bin] - expected) / expected;
  }
  if (chi2 > 81 + 3.5 * std::sqrt(2.0 * 81)) fail_msg("chi2 %.1f of 81 degrees of freedom", chi2);
}

static void test_raw_second_has_the_given_mean_and_the_white_variance(void**) {
  RawFormat format;
  format.jitter_s = 0.002;
  RawSampler sampler(format, 2, 1, 0);
  std::vector<RawSample> samples;
  Mean square, error;
  const double mean_dph[2] = {1000, -2000}, white_dph[2] = {36, 0};
  for (int k = 1; k <= 400; ++k) {
    samples.clear();
    sampler.second(k, 30, mean_dph, white_dph, &samples);
    assert_int_equal(samples.size(), 100);
    double sum = 0;
    for (size_t i = 0; i < 100; ++i) {
      assert_true(samples[i].t_us > 1000000ull * static_cast<unsigned>(k - 1));
      assert_true(samples[i].t_us < 1000000ull * static_cast<unsigned>(k));
      if (i > 0) assert_true(samples[i].t_us > samples[i - 1].t_us);
      assert_int_equal(samples[i].temp_counts, 500);
      assert_true(std::abs(samples[i].counts[1] + 2000.0 / 18) <= 0.5);
      sum += samples[i].counts[0] * 18.0;
      square.add(std::pow(samples[i].counts[0] * 18.0 - 1000, 2));
    }
    error.add(std::pow(sum / 100 - 1000, 2));
  }
  assert_within(square, 360.0 * 360.0 * 0.99 + 18.0 * 18.0 / 12, 3.5, "variance of samples about the mean");
  assert_within(error, 18.0 * 18.0 / 12 / 100, 3.5, "variance of the second's mean by quantisation");
}

static void test_raw_saturation_and_loss_are_seen(void**) {
  RawFormat format;
  format.max_counts = 127;
  format.missing_frac = 0.2;
  RawSampler sampler(format, 1, 1, 0);
  std::vector<RawSample> samples;
  const double mean_dph = 127 * 18, white_dph = 36;
  for (int k = 1; k <= 100; ++k) sampler.second(k, 30, &mean_dph, &white_dph, &samples);
  assert_true(std::abs(static_cast<double>(samples.size()) - 8000) < 3.5 * 40);
  size_t n_saturated = 0;
  for (const RawSample& s : samples) {
    assert_true(std::abs(s.counts[0]) <= 127);
    assert_int_equal(s.saturated, s.counts[0] == 127 && s.saturated ? 1 : 0);
    n_saturated += s.saturated;
  }
  assert_true(std::abs(static_cast<double>(n_saturated) / static_cast<double>(samples.size()) - 0.5) < 0.03);
}

static void test_raw_bad_format_is_refused(void**) {
  RawFormat format;
  format.rate_hz = 99.5;
  try {
    RawSampler(format, 1, 1, 0);
    fail_msg("taken");
  } catch (const Error& error) {
    assert_int_equal(static_cast<int>(error.exit()), static_cast<int>(Exit::kUsage));
  }
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_simulate_autocovariance_is_the_closed_form),
      cmocka_unit_test(test_simulate_dp2_is_the_closed_form),
      cmocka_unit_test(test_simulate_markov_starts_stationary),
      cmocka_unit_test(test_simulate_runs_axes_devices_and_seeds_are_uncorrelated),
      cmocka_unit_test(test_simulate_same_seed_same_log_whatever_else_is_asked),
      cmocka_unit_test(test_simulate_turn_on_is_constant_in_a_log_and_differs_between_logs),
      cmocka_unit_test(test_simulate_bias_follows_the_polynomial),
      cmocka_unit_test(test_simulate_gap_decorrelates_by_its_length),
      cmocka_unit_test(test_log_flaws_are_as_asked_for),
      cmocka_unit_test(test_simulate_unknown_effect_or_axis_is_refused),
      cmocka_unit_test(test_simulate_effect_acts_on_its_axis_and_log_alone),
      cmocka_unit_test(test_fast_normal_has_the_normal_distribution),
      cmocka_unit_test(test_raw_second_has_the_given_mean_and_the_white_variance),
      cmocka_unit_test(test_raw_saturation_and_loss_are_seen),
      cmocka_unit_test(test_raw_bad_format_is_refused),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
