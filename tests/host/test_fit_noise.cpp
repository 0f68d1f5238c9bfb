// SPDX-License-Identifier: MIT
// fit: noise of more than one Markov term.  Without a model the predicted error sees the slow one behind the fast one; with one
// the merged filter's innovations are judged by what the whole model makes of them; a residual that is no noise is refused.
#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>

#include <csetjmp>
#include <string>

#include "analysis/fit/expected.h"
#include "analysis/fit/fit.h"
#include "analysis/fit/judge.h"
#include "analysis/fit/residual_noise.h"
#include "base/rng.h"

extern "C" {
#include <cmocka.h>
}

using namespace imucal;

namespace {

const ErrorModel kTwoTerms = [] {
  ErrorModel model;
  model.arw_deg_rt_h = 0.2;
  model.markov = {{40, 3}, {20, 100}};
  return model;
}();

double truth_dph(double temp_degc) {
  const double tn = (temp_degc - 30) / 30;
  return 80 + 300 * tn + 150 * tn * tn - 100 * tn * tn * tn;
}

// Noise alone, n rows of a second.
std::vector<double> draw(const ErrorModel& model, uint64_t run, size_t n) {
  Rng white(21, run, 0, Stream::kWhite);
  std::vector<double> out(n);
  for (double& value : out) value = 60 * model.arw_deg_rt_h * white.normal();
  for (size_t i = 0; i < model.markov.size(); ++i) {
    Rng driven(21, run, static_cast<uint32_t>(i + 1), Stream::kMarkov);
    const double sigma = model.markov[i].sigma_dph, phi = std::exp(-1 / model.markov[i].tau_s);
    double state = sigma * driven.normal();
    for (double& value : out) {
      value += state;
      state = phi * state + sigma * std::sqrt(1 - phi * phi) * driven.normal();
    }
  }
  return out;
}

// The basic profile: soaks of 20 min at both ends, 0..60 degC; a polynomial of order 3 and noise.
Log log_of(const ErrorModel& model, uint64_t run) {
  Log log;
  log.path = "run" + std::to_string(run) + ".csv";
  log.metadata["serial"] = "17";
  LogAxis axis;
  axis.name = "gx_dph";
  axis.rate_dph = draw(model, run, 8400);
  for (size_t k = 0; k < axis.rate_dph.size(); ++k) {
    const double temp = std::min(60.0, std::max(0.0, (static_cast<double>(k) + 0.5 - 1200) * 0.01));
    log.t_s.push_back(static_cast<double>(k));
    log.temp_degc.push_back(temp);
    axis.rate_dph[k] += truth_dph(temp);
  }
  log.axes.push_back(axis);
  return log;
}

FitOptions options_of(FitOptions::Method method, const ErrorModel* model) {
  FitOptions options;
  options.method = method;
  options.order = 3;
  if (model) options.model = *model;
  options.t0_degc = 30;
  options.range_degc = 30;
  return options;
}

const FitReason* reason_of(const FitResult& result, const std::string& rule) {
  for (const FitReason& reason : result.reasons)
    if (reason.rule == rule) return &reason;
  return nullptr;
}

// 25 tests, 9 temperatures that share their errors (about 3 of them independent): rms of error/sigma 1 +- 0.08, two sigma
// 95 +- 2.5 %.  One Markov term alone has 2.3 and 62 %, 4.0 and 38 %.
void test_slow_noise_is_seen_behind_fast_noise(void**) {
  for (const double tau_s : {100.0, 300.0}) {
    ErrorModel model = kTwoTerms;
    model.markov[1].tau_s = tau_s;
    double chi2 = 0, within_2 = 0;
    constexpr int kRuns = 25;
    for (uint64_t run = 0; run < kRuns; ++run) {
      const FitResult result = fit_logs({log_of(model, run)}, options_of(FitOptions::Method::kPolynomial, nullptr));
      assert_true(result.is_accepted());
      const FitAxis& axis = result.axes.at(0);
      assert_true(axis.residual_noise->markov.size() >= 2);
      for (size_t i = 0; i < 9; ++i) {
        const double z = (axis.bias_dph(axis.temp_degc[i]) - truth_dph(axis.temp_degc[i])) / axis.sigma_dph[i];
        chi2 += z * z / (9 * kRuns);
        within_2 += (std::abs(z) < 2) / (9.0 * kRuns);
      }
    }
    std::fprintf(stderr, "40 dph over 3 s and 20 over %g: rms of error/sigma %.2f, within two %.3f\n", tau_s,
                 std::sqrt(chi2), within_2);
    assert_true(std::sqrt(chi2) > 0.6 && std::sqrt(chi2) < 1.25);
    assert_true(within_2 > 0.9);
  }
}

// Noise of one term stays one of one term, by and large as before.
void test_one_term_stays_one(void**) {
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  for (uint64_t run = 100; run < 110; ++run) {
    const FitAxis axis =
        fit_logs({log_of(model, run)}, options_of(FitOptions::Method::kPolynomial, nullptr)).axes.at(0);
    assert_int_equal(axis.residual_noise->markov.size(), 1);
    assert_true(axis.worst_sigma_dph() > 4 && axis.worst_sigma_dph() < 14); // 6.93 by the true model
  }
}

// A slow wave of 400 dph leaves steps from second to second that no noise of its size has.  Healthy tests of one and two terms
// have a residual variance of 0.94 to 1.10 of what their own noise makes (360 of them); the limit is 1.5.
void test_residual_that_is_no_noise_is_refused(void**) {
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  Log log = log_of(model, 1);
  const FitOptions options = options_of(FitOptions::Method::kPolynomial, nullptr);
  assert_true(fit_logs({log}, options).is_accepted());
  for (size_t k = 0; k < log.size(); ++k)
    log.axes[0].rate_dph[k] += 400 * std::sin(2 * 3.14159265358979 * 1.3 * static_cast<double>(k) / 8400);
  const FitResult result = fit_logs({log}, options);
  const FitReason* reason = reason_of(result, "residual");
  assert_true(reason != nullptr && !result.is_accepted());
  assert_true(reason->value > reason->limit && result.axes[0].error_factor > 1.5);
  assert_true(reason->text.find("polynomial misses something") != std::string::npos);
}

// A model that is exact refuses nobody, by either method; one that is wrong by a factor of two in its fast or its white noise is.
void test_two_terms_are_judged_by_their_own_model(void**) {
  ErrorModel loud = kTwoTerms, white = kTwoTerms;
  loud.markov[0].sigma_dph *= 2;
  white.arw_deg_rt_h *= 2;
  for (const auto method : {FitOptions::Method::kKalman, FitOptions::Method::kPolynomial}) {
    const FitOptions options = options_of(method, &kTwoTerms);
    for (uint64_t run = 0; run < 10; ++run) {
      const FitResult result = fit_logs({log_of(kTwoTerms, run)}, options);
      if (!result.is_accepted()) fail_msg("%s", result.reasons[0].text.c_str());
      const FitAxis& axis = result.axes[0];
      assert_true(std::abs(axis.health.value[IMUCAL_HEALTH_NIS] - 1) < 0.1F);
      assert_true(std::abs(axis.health.value[IMUCAL_HEALTH_LAG1]) < 0.06F);
      assert_true(axis.error_factor < 1.5);
    }
    assert_true(reason_of(fit_logs({log_of(loud, 1)}, options), "nis") != nullptr);
    assert_true(reason_of(fit_logs({log_of(white, 1)}, options), "nis") != nullptr);
  }
}

// Closed form against a filter that runs over 400000 seconds; of the filter's own model the innovations are white.
void test_expected_innovations_are_those_of_a_long_run(void**) {
  const imucal_kf_config_t config = kf_config(kTwoTerms, 3, 30, 30);
  const ExpectedInnovations expected = expected_innovations(config, noise_of(kTwoTerms), 1);
  const double phi = 1 - static_cast<double>(config.m), q = static_cast<double>(config.q),
               r = static_cast<double>(config.r);
  double variance = static_cast<double>(config.markov_variance), x = 0, before = 0, nis = 0, lag1 = 0, sum = 0,
         slow = 0;
  const std::vector<double> z = draw(kTwoTerms, 7, 400000);
  for (size_t k = 0; k < z.size(); ++k) {
    const double s = variance + r, nu = z[k] - x, gain = variance / s;
    nis += nu * nu / s;
    lag1 += nu * before / s;
    sum += nu / s;
    if ((k + 1) % 256 == 0) slow += sum * sum * s / 256, sum = 0;
    before = nu;
    x = phi * (x + gain * nu);
    variance = phi * phi * variance * r / s + q;
  }
  const auto n = static_cast<double>(z.size());
  std::fprintf(stderr, "nis %.3f (%.3f), lag1 %.4f (%.4f), slow %.3f (%.3f)\n", nis / n, expected.nis, lag1 / nis,
               expected.lag1, slow / (n / 256), expected.slow);
  assert_true(std::abs(nis / n / expected.nis - 1) < 4 * std::sqrt(2 * expected.nis_spread / n));
  assert_true(std::abs(lag1 / nis - expected.lag1) < 0.01);
  assert_true(std::abs(slow / (n / 256) / expected.slow - 1) < 4 * std::sqrt(2 * expected.slow_spread * 256 / n));
  ErrorModel one;
  one.arw_deg_rt_h = 0.6;
  one.markov = {{20, 100}};
  const ExpectedInnovations own = expected_innovations(kf_config(one, 3, 30, 30), noise_of(one), 1);
  assert_true(std::abs(own.nis - 1) < 1e-5 && std::abs(own.lag1) < 1e-5 && std::abs(own.slow - 1) < 1e-3);
  assert_true(own.rejects < 1e-8 && std::abs(own.nis_spread - 1) < 1e-5);
}

// Fast noise alone: a slower process may be there that BIC does not want; what the residuals leave of it is counted, beside
// whole models whose weights are one together.  Its density at low frequency is no more than theirs.
void test_slow_noise_that_is_not_seen_is_counted(void**) {
  ErrorModel fast = kTwoTerms;
  fast.markov.resize(1);
  const Log log = log_of(fast, 1);
  const std::vector<double> z = draw(fast, 1, log.size());
  ResidualRun run;
  run.steps.assign(z.size(), 1);
  run.columns.resize(static_cast<Eigen::Index>(z.size()), 5);
  for (Eigen::Index k = 0; k < run.columns.rows(); ++k) {
    const double tn = log.temp_degc[static_cast<size_t>(k)] / 30 - 1;
    run.columns.row(k) << z[static_cast<size_t>(k)], 1, tn, tn * tn, tn * tn * tn;
  }
  const NoiseBelief belief = believe_residuals({run}, 1, true);
  double whole = 0, whole_density = 0, unseen = 0, unseen_density = 0; // densities: 2 sigma^2 tau
  for (size_t i = 0; i < belief.noise.size(); ++i) {
    const NoiseModel& noise = belief.noise[i];
    double density = noise.white_sigma_dph * noise.white_sigma_dph;
    for (const Markov& m : noise.markov) density += 2 * m.sigma_dph * m.sigma_dph * m.tau_s;
    (noise.white_sigma_dph > 0 ? whole : unseen) += belief.weight[i];
    (noise.white_sigma_dph > 0 ? whole_density : unseen_density) += belief.weight[i] * density;
  }
  std::fprintf(stderr, "unseen: weight %.3f, %.2f of the density\n", unseen, unseen_density / whole_density);
  assert_true(std::abs(whole - 1) < 1e-9 && unseen > 0 && unseen < 1);
  assert_true(unseen_density > 0.01 * whole_density && unseen_density < whole_density);
}

// The figure of blocks scatters so much more than that of independent ones: 400 records of 40 blocks.
void test_spread_of_blocks_is_that_of_many_records(void**) {
  ErrorModel model = kTwoTerms;
  model.markov = {{60, 3}, {25, 1500}};
  const imucal_kf_config_t config = kf_config(model, 3, 30, 30);
  const ExpectedInnovations expected = expected_innovations(config, noise_of(model), 1);
  const double m = 1 - static_cast<double>(config.m), q = static_cast<double>(config.q),
               r = static_cast<double>(config.r);
  constexpr size_t kRecords = 400, kBlocks = 40, kSettle = 6000;
  double squares = 0;
  for (uint64_t run = 0; run < kRecords; ++run) {
    double variance = static_cast<double>(config.markov_variance), x = 0, sum = 0, slow = 0;
    const std::vector<double> z = draw(model, 100 + run, kSettle + 256 * kBlocks);
    for (size_t k = 0; k < z.size(); ++k) {
      const double s = variance + r, nu = z[k] - x;
      if (k >= kSettle) sum += nu / std::sqrt(s);
      if (k >= kSettle && (k - kSettle + 1) % 256 == 0) slow += sum * sum / 256, sum = 0;
      x = m * (x + variance / s * nu);
      variance = m * m * variance * r / s + q;
    }
    squares += std::pow(slow / kBlocks / expected.slow - 1, 2);
  }
  const double ratio = squares / kRecords / (2 * expected.slow_spread / kBlocks);
  std::fprintf(stderr, "spread of blocks %.2f times that of white ones, seen %.2f times that\n", expected.slow_spread,
               ratio);
  assert_true(expected.slow_spread > 1.2 && ratio > 0.75 && ratio < 1.25); // 400 squares: 7 % each standard deviation
}

// A reading that stands two, three and ten seconds; the same sensor read once a second is accepted, however coarse.
void test_held_readings_are_refused(void**) {
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  const FitOptions options = options_of(FitOptions::Method::kPolynomial, nullptr);
  for (const size_t held : {1, 2, 3, 10}) {
    Log log = log_of(model, 3);
    for (size_t k = 0; k < log.size(); ++k) log.axes[0].rate_dph[k] = log.axes[0].rate_dph[k / held * held];
    const FitResult result = fit_logs({log}, options);
    const FitReason* reason = reason_of(result, "repeated");
    assert_true((reason != nullptr) == (held > 1));
    if (reason) assert_true(std::abs(reason->value - (1 - 1 / static_cast<double>(held))) < 0.06);
  }
  for (const double quantum_dph : {5.0, 36.0, 60.0}) {
    Log log = log_of(model, 4);
    for (double& rate : log.axes[0].rate_dph) rate = quantum_dph * std::round(rate / quantum_dph);
    assert_true(reason_of(fit_logs({log}, options), "repeated") == nullptr);
  }
}

// What was accepted stands in the table: the rules, once each, and by how much the error is too small.
void test_table_notes_are_of_the_axes_with_an_accepted_reason(void**) {
  FitReason slow{"gx_dph", "slow", 4, 1.5, "", true}, again = slow, other{"gy_dph", "nis", 2, 1.3, "", false};
  const std::vector<TableNote> notes = table_notes({slow, again, other}, {{"gx_dph", 2.5}, {"gy_dph", 1.4}});
  assert_int_equal(notes.size(), 1);
  assert_string_equal(notes[0].axis.c_str(), "gx_dph");
  assert_true(notes[0].accepted == std::vector<std::string>{"slow"} && notes[0].error_factor == 2.5);
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_slow_noise_is_seen_behind_fast_noise),
      cmocka_unit_test(test_one_term_stays_one),
      cmocka_unit_test(test_residual_that_is_no_noise_is_refused),
      cmocka_unit_test(test_two_terms_are_judged_by_their_own_model),
      cmocka_unit_test(test_expected_innovations_are_those_of_a_long_run),
      cmocka_unit_test(test_slow_noise_that_is_not_seen_is_counted),
      cmocka_unit_test(test_spread_of_blocks_is_that_of_many_records),
      cmocka_unit_test(test_held_readings_are_refused),
      cmocka_unit_test(test_table_notes_are_of_the_axes_with_an_accepted_reason),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
