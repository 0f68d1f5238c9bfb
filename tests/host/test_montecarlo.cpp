// SPDX-License-Identifier: MIT
// Monte Carlo campaigns: exact sums, the same bits for any threads and shards, statistics that see a wrong
// filter.
#include <unistd.h>

#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include <Eigen/Core>
extern "C" {
#include <cmocka.h>
}

#include "analysis/montecarlo/batch.h"
#include "analysis/montecarlo/campaign.h"
#include "analysis/montecarlo/methods.h"
#include "analysis/montecarlo/reference.h"
#include "analysis/montecarlo/truth.h"
#include "base/error.h"
#include "dense.h"
#include "io/json_file.h"
#include "montecarlo/report.h"

using namespace imucal;

static Profile profile_of(double soak_s, double rate_degc_per_min) {
  Profile profile;
  profile.start_degc = 0;
  profile.segments = {{0, soak_s, 0}, {rate_degc_per_min, 0, 60}, {0, soak_s, 0}};
  return profile;
}

static CampaignOptions options_of(uint64_t runs) {
  CampaignOptions o;
  o.model.arw_deg_rt_h = 0.6;
  o.model.markov = {{20, 100}};
  o.model.turn_on_sigma_dph = 30;
  o.model.bias = ThermalPolynomial{30, 30, {80, 300, 150, -100}};
  o.filter = o.model;
  o.profile = profile_of(200, 3);
  o.seed = 7;
  o.runs = runs;
  o.raw.rate_hz = 10;
  o.raw.counts_scale_dph = 1;
  return o;
}

static CampaignResult campaign(const CampaignOptions& options) {
  return run_campaign(plan_campaign(options), nullptr, nullptr);
}

static std::string refusal(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  fail_msg("nothing was refused");
  return "";
}

static void assert_contains(const std::string& text, const char* part) {
  if (text.find(part) == std::string::npos) fail_msg("\"%s\" is not in: %s", part, text.c_str());
}

static void test_exact_sum_does_not_depend_on_order(void**) {
  const std::vector<double> values = {1e15, 1e-9, -1e15, 3.25, 1.0 / 3, -7e7, 1e-12};
  ExactSum forward, backward, halves, other;
  for (size_t i = 0; i < values.size(); ++i) {
    forward.add(values[i]);
    backward.add(values[values.size() - 1 - i]);
    (i % 2 ? halves : other).add(values[i]);
  }
  halves.add(other);
  assert_string_equal(forward.text().c_str(), backward.text().c_str());
  assert_string_equal(forward.text().c_str(), halves.text().c_str());
  assert_true(std::abs(forward.value() - (3.25 + 1.0 / 3 - 7e7 + 1.001e-9)) < 3e-8); // double holds 7e7 to 1.5e-8
  assert_string_equal(ExactSum::from_text(forward.text()).text().c_str(), forward.text().c_str());
}

// The integers are those of Python, which has no limit of size.
static void test_exact_sum_is_the_integer_of_128_bits(void**) {
  const std::vector<std::pair<std::vector<double>, std::string>> cases = {
      {{1.0}, "17592186044416"},
      {{-1.0}, "-17592186044416"},
      {{0x1p62, 0x1p62, 0x1p62}, "243388915243820045087367015432192"},
      {{-0x1p62, -0x1p62, -0x1p62, -0x1p62, -0x1p62, 0.5}, "-405648192073033408470148932698112"},
      {{4e+18, -4e+18, 0x1p-44}, "1"},
      {{-0x1p-44}, "-1"},
      {{1e6 / 3, -2e+17, 12345.678}, "-3518437208877118750520974213376"},
      {{0.0}, "0"},
  };
  for (const auto& [values, text] : cases) {
    ExactSum sum;
    double near = 0;
    for (const double value : values) {
      sum.add(value);
      near += value;
    }
    assert_string_equal(sum.text().c_str(), text.c_str());
    assert_true(std::abs(sum.value() - near) <= 1e-15 * std::abs(near) + 1e-10);
    const ExactSum again = ExactSum::from_text(text);
    assert_string_equal(again.text().c_str(), text.c_str());
    assert_true(again.value() == sum.value());
  }
}

static void test_exact_sum_refuses_what_is_not_a_number(void**) {
  for (const double bad : {std::nan(""), 1e300, -1e300 * 1e300}) {
    ExactSum sum;
    bool refused = false;
    try {
      sum.add(bad);
    } catch (const std::overflow_error&) {
      refused = true;
    }
    assert_true(refused);
  }
}

static void test_campaign_threads_and_shards_give_the_same_bits(void**) {
  CampaignOptions whole = options_of(23);
  whole.reference_every = 5;
  whole.residual_every = 7;
  const std::string expected = campaign(whole).tally.to_json().dump();
  whole.threads = 4;
  assert_string_equal(campaign(whole).tally.to_json().dump().c_str(), expected.c_str());

  std::vector<Partial> shards;
  const std::string path = "/tmp/imucal_test_mc_" + std::to_string(getpid());
  for (const auto& [first, runs] : {std::pair<uint64_t, uint64_t>{9, 14}, {0, 4}, {4, 5}}) {
    CampaignOptions shard = whole;
    shard.threads = 1;
    shard.first_run = first;
    shard.runs = runs;
    write_partial(path, shard, campaign(shard));
    shards.push_back(read_partial(path));
    std::remove(path.c_str());
  }
  const Partial merged = merge_partials(shards);
  assert_string_equal(merged.result.tally.to_json().dump().c_str(), expected.c_str());
  assert_int_equal(merged.result.runs_done, 23);
}

static void assert_same_filter(const CoreChain& a, const CoreChain& b) {
  imucal_kf_state_t x, y;
  imucal_kf_get_state(&a.kf(), &x), imucal_kf_get_state(&b.kf(), &y);
  assert_memory_equal(&x, &y, sizeof x);
  const imucal_kf_stats_t &s = a.kf().stats, &t = b.kf().stats;
  assert_memory_equal(s.sum, t.sum, sizeof s.sum);
  assert_memory_equal(s.sum_lo, t.sum_lo, sizeof s.sum_lo);
  assert_int_equal(s.n, t.n);
  assert_int_equal(s.n_missed, t.n_missed);
  assert_true(s.innovation == t.innovation && s.innovation_weight == t.innovation_weight);
  for (int i = 0; i < IMUCAL_LEARN_N_OUTCOMES; ++i)
    assert_int_equal(a.n_seconds(imucal_learn_outcome_t(i)), b.n_seconds(imucal_learn_outcome_t(i)));
  assert_memory_equal(a.lag_counts(), b.lag_counts(), sizeof(int64_t) * kInnovationLagCount);
  assert_true(a.mean_innovation2() == b.mean_innovation2());
  assert_memory_equal(a.lag_sums(), b.lag_sums(), sizeof(double) * kInnovationLagCount);
}

// Side by side, sums made in vectors, against run by run, sample by sample through imucal_sum_add.
static void assert_batch_is_run_by_run(const CampaignOptions& options, const char* what) {
  const CampaignPlan plan = plan_campaign(options);
  if (!can_batch(plan)) fail_msg("%s: not side by side", what);
  for (const uint64_t n : {uint64_t{3}, kBatch}) {
    const std::vector<CalibrationTest> batch = calibrate_batch(plan, 5, n);
    assert_int_equal(batch.size(), n);
    for (uint64_t i = 0; i < n; ++i) {
      const CalibrationTest alone = calibrate_run(plan, 5 + i);
      assert_same_filter(batch[i].chain, alone.chain);
      assert_true(batch[i].truth == alone.truth && batch[i].turn_on_dph == alone.turn_on_dph);
      assert_int_equal(batch[i].chain.seconds().size(), alone.chain.seconds().size());
      for (const double temp_degc : plan.temp_degc)
        assert_true(batch[i].chain.compensated_bias_dph(temp_degc) == alone.chain.compensated_bias_dph(temp_degc));
    }
  }
}

static void test_batch_gives_the_bits_of_each_run(void**) {
  CampaignOptions options = options_of(8);
  options.profile = profile_of(201.0, 6); // no multiple of anything
  assert_batch_is_run_by_run(options, "plain");
  options.model.markov = {{20, 100}, {5, 7}, {0, 30}};
  options.raw.rate_hz = 100;
  options.raw.temp_lsb_degc = 1; // tracked
  assert_batch_is_run_by_run(options, "two Markov terms, coarse thermometer, 100 Hz");
  options.raw = options_of(1).raw;
  options.raw.max_counts = 600; // some seconds have samples at the rail
  options.model.turn_on_sigma_dph = 0;
  assert_batch_is_run_by_run(options, "saturation");
  options.raw.rate_hz = 1;
  options.model.arw_deg_rt_h = 0;
  assert_batch_is_run_by_run(options, "no white noise, one sample a second");
}

static void test_batch_leaves_what_it_cannot_do(void**) {
  const auto can = [](const std::function<void(CampaignOptions*)>& change) {
    CampaignOptions options = options_of(8);
    change(&options);
    return can_batch(plan_campaign(options));
  };
  assert_true(can([](CampaignOptions*) {}));
  assert_false(can([](CampaignOptions* o) { o->missing_frac = 0.01; }));
  assert_false(can([](CampaignOptions* o) { o->raw.missing_frac = 0.01; }));
  assert_false(can([](CampaignOptions* o) { o->raw.jitter_s = 0.001; }));
  assert_false(can([](CampaignOptions* o) { o->raw.temp_noise_degc = 0.01; }));
  assert_false(can([](CampaignOptions* o) { o->raw.dithered = true; }));
  EffectSpec lag;
  lag.name = "thermal_lag";
  assert_false(can([&](CampaignOptions* o) { o->effects.push_back(lag); }));
}

static void test_merge_refuses_overlap_and_other_campaigns(void**) {
  const std::string path = "/tmp/imucal_test_mc_" + std::to_string(getpid());
  CampaignOptions options = options_of(3);
  const auto through_a_file = [&] { // which is not written again: what was read is protected
    write_partial(path, options, campaign(options));
    const Partial read = read_partial(path);
    std::remove(path.c_str());
    return read;
  };
  const Partial first = through_a_file();
  options.first_run = 2;
  const Partial overlapping = through_a_file();
  options.first_run = 3;
  options.order = 4;
  const Partial other = through_a_file();
  assert_contains(refusal([&] { merge_partials({overlapping, first}); }), "from run 2");
  assert_contains(refusal([&] { merge_partials({first, other}); }), "another campaign");
  std::ofstream(path) << R"({"imucal_model":1})";
  assert_contains(refusal([&] { read_partial(path); }), "--partial");
  std::remove(path.c_str());
}

static void test_campaign_stops_and_keeps_what_is_done(void**) {
  CampaignOptions options = options_of(50);
  int asked = 0;
  const CampaignResult result = run_campaign(plan_campaign(options), nullptr, [&] { return ++asked > 2; });
  assert_true(result.is_interrupted);
  assert_int_equal(result.runs_done, 2 * kBatch);
  assert_int_equal(result.tally.counted("runs"), 2 * kBatch);
  options.runs = 2 * kBatch; // what is done are the first runs
  assert_string_equal(result.tally.to_json().dump().c_str(), campaign(options).tally.to_json().dump().c_str());
}

// 99.99 % intervals of means of chi-square variables: 3.9 standard deviations.
static void assert_chi2_mean(double mean, double dof, double n, const char* what) {
  const double z = (mean - dof) / std::sqrt(2 * dof / n);
  if (std::abs(z) > 3.9) fail_msg("%s: %.5f, expected %.5f (%.1f standard errors)", what, mean, dof, z);
}

static void test_campaign_right_filter_is_consistent(void**) {
  CampaignOptions options = options_of(400);
  options.missing_frac = 0.02;
  options.raw.missing_frac = 0.02;
  options.raw.jitter_s = 0.01;
  options.least_squares_every = options.residual_every = 0;
  const CampaignPlan plan = plan_campaign(options);
  const Json json = campaign_json(plan, run_campaign(plan, nullptr, nullptr));
  // Missing samples: the white noise of a second with 9 of 10 samples is 10/9 of nominal, 2 % on average.
  assert_chi2_mean(double(json["nees"]["mean"]), 4, 400, "NEES");
  for (size_t i = 0; i < json["ratio"].size(); ++i)
    assert_chi2_mean(std::pow(double(json["ratio"][i]), 2), 1, 400, "ratio squared");
  for (const auto& [band, expected] : {std::pair<const char*, double>{"one_sigma", 0.6827}, {"two_sigma", 0.9545}})
    for (const Json& part : json["coverage"][band]["part"])
      assert_true(std::abs(double(part) - expected) < 3.9 * std::sqrt(expected * (1 - expected) / 400));
  assert_true(std::abs(double(json["seconds_missed_per_run"]) - 0.02 * 1600) < 3);
  assert_true(double(json["double_reference"]["largest_bias_difference_dph"]) < 0.1);
  assert_true(double(json["double_reference"]["largest_sigma_difference_rel"]) < 1e-3);
  assert_true(double(json["compensation"]["largest_error_lsb"]) <= 1.0);
}

static void test_campaign_innovations_are_white(void**) {
  CampaignOptions options = options_of(300);
  options.least_squares_every = options.reference_every = options.residual_every = 0;
  const CampaignPlan plan = plan_campaign(options);
  const Json json = campaign_json(plan, run_campaign(plan, nullptr, nullptr));
  assert_chi2_mean(double(json["nis"]["mean"]), 1, double(json["nis"]["n"]), "NIS");
  assert_chi2_mean(double(json["whiteness"]["mean2"]["mean"]), 1, 300, "mean innovation");
  for (size_t i = 0; i < json["whiteness"]["lag_s"].size(); ++i) {
    const double z =
        double(json["whiteness"]["correlation"][i]) / double(json["whiteness"]["ci95_half_width"][i]) * 1.96;
    if (std::abs(z) > 4.2)
      fail_msg("innovations %d s apart are correlated: %.1f standard errors", int(json["whiteness"]["lag_s"][i]), z);
  }
}

static void test_campaign_sees_a_wrong_filter_and_the_truth_covariance_explains_it(void**) {
  CampaignOptions options = options_of(400);
  options.filter.markov = {{5, 100}};
  options.least_squares_every = options.reference_every = options.residual_every = 0;
  const CampaignPlan plan = plan_campaign(options);
  const Json json = campaign_json(plan, run_campaign(plan, nullptr, nullptr));
  assert_true(double(json["nees"]["mean"]) > 2 * double(json["nees"]["ci95"][1]));
  assert_true(double(json["nis"]["mean"]) > double(json["nis"]["ci95"][1]));
  assert_true(double(json["ratio"][6]) > 1.5);
  for (const Json& ratio : json["ratio_to_truth"])
    assert_chi2_mean(std::pow(double(ratio), 2), 1, 400, "ratio to truth");
}

static void test_residual_curve_is_model_plus_calibration_error(void**) {
  CampaignOptions options = options_of(400);
  options.least_squares_every = options.reference_every = 0;
  options.residual_every = 1;
  const CampaignPlan plan = plan_campaign(options);
  const Json json = campaign_json(plan, run_campaign(plan, nullptr, nullptr))["residual_dp"];
  assert_int_equal(json["tau_s"].size(), 8);
  for (size_t i = 0; i < json["tau_s"].size(); ++i)
    if (std::abs(double(json["z"][i])) > 3.9)
      fail_msg("DP2 at %d s: %.3f, expected %.3f (%.1f standard errors)", int(json["tau_s"][i]),
               double(json["dp_dph"][i]), double(json["expected_dph"][i]), double(json["z"][i]));
  // The calibration error must matter for the test to mean anything.
  assert_true(double(json["expected_dph"][7]) > 1.02 * double(json["model_dph"][7]));
}

static void test_plan_basic_profile_is_the_papers(void**) {
  CampaignOptions options = options_of(1);
  options.profile = profile_of(1200, 0.6);
  options.model.turn_on_sigma_dph = 0;
  const CampaignPlan plan = plan_campaign(options);
  const TruthCovariance truth = truth_covariance(plan);
  assert_true(std::abs(std::sqrt(bias_variance_dph2(truth.actual, 1)) - 6.93) < 0.01);
  const CampaignResult result = run_campaign(plan, nullptr, nullptr);
  assert_true(std::abs(std::sqrt(result.tally.sums("variance")[12]) / 6.93 - 1) < 0.01);
}

static void test_plan_refuses_nonsense(void**) {
  CampaignOptions options = options_of(1);
  options.profile.segments = {{0, 1000, 0}};
  assert_contains(refusal([&] { plan_campaign(options); }), "does not move");
  options = options_of(1);
  options.filter.arw_deg_rt_h = 0;
  assert_contains(refusal([&] { plan_campaign(options); }), "arw_deg_rt_h");
  options = options_of(1);
  options.order = 6;
  assert_contains(refusal([&] { plan_campaign(options); }), "--order");
}

// A second derivation: QR of the scaled power basis.
static void test_fit_polynomial_is_the_qr_solution(void**) {
  Rng rng(1, 0, 0, Stream::kTool);
  std::vector<FitPoint> points;
  Eigen::MatrixXd a(500, 6);
  Eigen::VectorXd b(500);
  for (long k = 0; k < 500; ++k) {
    const double temp_degc = 60 * std::pow(rng.uniform(), 2), tn = (temp_degc - 30) / 30;
    points.push_back({temp_degc, 300 * tn * tn * tn + 40 * rng.normal()});
    b(k) = points.back().rate_dph;
    for (long j = 0; j < 6; ++j) a(k, j) = std::pow(tn, static_cast<double>(j));
  }
  const Eigen::VectorXd x = dense_least_squares(a, b);
  const auto coeff = fit_polynomial(points, 5, 30, 30);
  assert_int_equal(coeff.size(), 6);
  for (long j = 0; j < 6; ++j) assert_true(std::abs(coeff[static_cast<size_t>(j)] - x(j)) < 1e-8 * x.norm());
  points.assign(100, {20, 5});
  assert_true(fit_polynomial(points, 1, 30, 30).empty());
}

static void test_rising_methods_take_what_they_say(void**) {
  const std::vector<FitPoint> seconds = {{10.0, 1}, {10.3, 2}, {10.5, 3}, {10.4, 9},
                                         {10.6, 4}, {11.1, 5}, {9.0, 7},  {11.2, 6}};
  const auto bins = points_of(Method::kRisingBins, seconds, 0.5);
  assert_int_equal(bins.size(), 2); // 10.0 … 10.5 and 10.4 … 11.1; the fall to 9 empties the next
  assert_true(std::abs(bins[0].rate_dph - 2) < 1e-12 && std::abs(bins[1].rate_dph - 6) < 1e-12);
  const auto rising = points_of(Method::kRisingMaximum, seconds);
  assert_int_equal(rising.size(), 6);
  assert_true(rising[3].rate_dph == 4 && rising[5].rate_dph == 6);
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_exact_sum_does_not_depend_on_order),
      cmocka_unit_test(test_exact_sum_is_the_integer_of_128_bits),
      cmocka_unit_test(test_exact_sum_refuses_what_is_not_a_number),
      cmocka_unit_test(test_campaign_threads_and_shards_give_the_same_bits),
      cmocka_unit_test(test_batch_gives_the_bits_of_each_run),
      cmocka_unit_test(test_batch_leaves_what_it_cannot_do),
      cmocka_unit_test(test_merge_refuses_overlap_and_other_campaigns),
      cmocka_unit_test(test_campaign_stops_and_keeps_what_is_done),
      cmocka_unit_test(test_campaign_right_filter_is_consistent),
      cmocka_unit_test(test_campaign_innovations_are_white),
      cmocka_unit_test(test_campaign_sees_a_wrong_filter_and_the_truth_covariance_explains_it),
      cmocka_unit_test(test_residual_curve_is_model_plus_calibration_error),
      cmocka_unit_test(test_plan_basic_profile_is_the_papers),
      cmocka_unit_test(test_plan_refuses_nonsense),
      cmocka_unit_test(test_fit_polynomial_is_the_qr_solution),
      cmocka_unit_test(test_rising_methods_take_what_they_say),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
