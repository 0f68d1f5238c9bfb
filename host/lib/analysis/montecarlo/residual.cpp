// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/residual.h"

#include <cmath>
#include <limits>

#include "analysis/dp/dp.h"
#include "analysis/errormodel/expect.h"

namespace imucal {

static DpOperator dp2(const CampaignPlan& plan) {
  return make_dp_operator(DpType::kDp2, 1.0, plan.options.model);
}

static Series series_of(std::vector<double> rate_dph) {
  Series series;
  series.rate_dph = std::move(rate_dph);
  return series;
}

ResidualExpectation expect_residual(const CampaignPlan& plan) {
  ResidualExpectation out;
  const DpOperator op = dp2(plan);
  ErrorModel noise = plan.options.model;
  noise.effects.clear();
  const std::vector<double> tau_s(plan.dp_n.begin(), plan.dp_n.end());
  out.model_dp_dph = expected_dp_dph(noise, op, tau_s);
  const auto p = static_cast<size_t>(plan.options.order) + 1;
  std::vector<DpRecord> columns; // 1, Tn, Tn^2, … over the test
  std::vector<double> power(plan.chamber_degc.size(), 1.0);
  for (size_t i = 0; i < p; ++i) {
    columns.emplace_back(series_of(power), op);
    for (size_t k = 0; k < power.size(); ++k)
      power[k] *= (plan.chamber_degc[k] - plan.chain.t0_degc) / plan.chain.range_degc;
  }
  for (const long n : plan.dp_n) {
    std::vector<std::vector<double>> w(p);
    std::vector<long> t0;
    for (size_t i = 0; i < p; ++i) columns[i].samples(n, &w[i], &t0);
    std::vector<double> weight(p * p, 0.0);
    for (size_t i = 0; i < p; ++i)
      for (size_t j = 0; j < p; ++j) {
        for (size_t k = 0; k < w[i].size(); ++k) weight[i * p + j] += w[i][k] * w[j][k];
        weight[i * p + j] /= static_cast<double>(w[i].size());
      }
    out.weight.push_back(std::move(weight));
  }
  return out;
}

// The fresh test through the core's compensation; one mean per second, NaN where there is no sample.
static std::vector<double> compensated(const CampaignPlan& plan, const CoreChain& chain, const SimulatedLog& fresh,
                                       const SimOptions& sim) {
  const SimRun& run = fresh.axes[0].run;
  RawSampler sampler(plan.options.raw, 1, run.seed, stream_run(sim));
  std::vector<RawSample> samples;
  std::vector<double> out;
  for (size_t k = 0; k < run.t_s.size(); ++k) {
    samples.clear();
    if (!fresh.is_missing[k])
      sampler.second(run.t_s[k], run.thermometer_degc[k], &run.rate_dph[k], &run.white_sigma_dph[k], &samples);
    int64_t sum = 0;
    uint32_t flags = 0;
    for (const RawSample& s : samples) sum += imucal_comp_apply(&chain.comp(), s.temp_counts, s.counts[0], &flags);
    out.push_back(samples.empty() ? std::numeric_limits<double>::quiet_NaN()
                                  : static_cast<double>(sum) / static_cast<double>(samples.size()) *
                                        static_cast<double>(chain.comp().unit_per_lsb));
  }
  return out;
}

void score_residual(const CampaignPlan& plan, const CoreChain& chain, const SimulatedLog& fresh, const SimOptions& sim,
                    double turn_on_dph, Tally* tally) {
  std::vector<double> residual = compensated(plan, chain, fresh, sim);
  for (double& r : residual) r += turn_on_dph;
  const DpRecord record(series_of(std::move(residual)), dp2(plan));
  const std::vector<double> cov = chain.coefficient_covariance();
  std::vector<double> square, square2, extra;
  std::vector<int64_t>
      n_tests; // with a prediction at this tau: gaps, or a nominal filter that settles slowly, leave none
  const auto moments = record.moments(plan.dp_n);
  for (size_t i = 0; i < moments.size(); ++i) {
    const double d2 = moments[i].mean_square();
    double trace = 0;
    for (size_t j = 0; j < cov.size(); ++j) trace += plan.residual_weight[i][j] * cov[j]; // both symmetric
    const bool has_any = std::isfinite(d2) && std::isfinite(trace);
    n_tests.push_back(has_any);
    square.push_back(has_any ? d2 : 0);
    square2.push_back(has_any ? d2 * d2 : 0);
    extra.push_back(has_any ? trace : 0);
  }
  tally->count("residual_runs");
  tally->count("residual_tests", n_tests);
  tally->add("residual_d2", square);
  tally->add("residual_d4", square2);
  tally->add("residual_extra", extra);
}

Json residual_json(const CampaignPlan& plan, const Tally& tally) {
  const std::vector<int64_t> n_tests = tally.counts("residual_tests");
  const auto d2 = tally.sums("residual_d2"), d4 = tally.sums("residual_d4"), extra = tally.sums("residual_extra");
  Json json = {{"runs", tally.counted("residual_runs")}, {"type", "dp2"}};
  for (const char* name : {"tau_s", "dp_dph", "std_error_dph", "model_dph", "expected_dph", "z"})
    json[name] = Json::array();
  json["left_out_tau_s"] = Json::array(); // no test had a prediction there
  for (size_t i = 0; i < d2.size(); ++i) {
    const auto runs = static_cast<double>(n_tests[i]);
    if (n_tests[i] == 0) {
      json["left_out_tau_s"].push_back(plan.dp_n[i]);
      continue;
    }
    const double mean = d2[i] / runs, dp = std::sqrt(mean / 2);
    const double error2 = runs > 1 ? std::max(0.0, d4[i] / runs - mean * mean) / (runs - 1) : 0.0;
    const double error = std::sqrt(error2) / (4 * dp); // d sqrt(m/2) = dm / (4 sqrt(m/2))
    const double model = plan.residual_model_dph[i];
    const double expected = std::sqrt(model * model + extra[i] / runs / 2);
    json["tau_s"].push_back(plan.dp_n[i]);
    json["dp_dph"].push_back(dp);
    json["std_error_dph"].push_back(error);
    json["model_dph"].push_back(model);
    json["expected_dph"].push_back(expected);
    json["z"].push_back(error > 0 ? (dp - expected) / error : 0.0);
  }
  return json;
}

} // namespace imucal
