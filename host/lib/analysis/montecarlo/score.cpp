// SPDX-License-Identifier: MIT
// One run of a campaign: simulate, calibrate through the core, score.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "analysis/montecarlo/batch.h"
#include "analysis/montecarlo/campaign.h"
#include "analysis/montecarlo/methods.h"
#include "analysis/montecarlo/reference.h"
#include "analysis/montecarlo/residual.h"
#include "linear/linear.h"

namespace imucal {

SimOptions run_options(const CampaignPlan& plan, uint64_t run, size_t log_index) {
  SimOptions sim;
  sim.seed = plan.options.seed;
  sim.device = run;
  sim.log_index = log_index;
  sim.n_logs = 2; // the calibration test and, where asked for, a fresh one
  sim.missing_frac = plan.options.missing_frac;
  return sim;
}

namespace {

SimulatedLog simulate_test(const CampaignPlan& plan, const SimOptions& sim) {
  return simulate({plan.options.model}, 1, plan.t_s, plan.chamber_degc, plan.options.effects, sim);
}

void feed(const CampaignPlan& plan, const SimulatedLog& log, const SimOptions& sim, CoreChain* chain) {
  const SimRun& run = log.axes[0].run;
  RawSampler sampler(plan.options.raw, 1, run.seed, stream_run(sim));
  std::vector<RawSample> samples;
  samples.reserve(sampler.samples_per_second());
  for (size_t k = 0; k < run.t_s.size(); ++k) {
    if (log.is_missing[k]) continue;
    samples.clear();
    sampler.second(run.t_s[k], run.thermometer_degc[k], &run.rate_dph[k], &run.white_sigma_dph[k], &samples);
    for (const RawSample& sample : samples) chain->push(sample);
  }
  chain->finish();
}

// What the calibration ought to find: this run's polynomial with its turn-on constant.
std::vector<double> true_coefficients(const CampaignPlan& plan, const SimulatedAxis& axis) {
  std::vector<double> coeff = plan.truth.coeff_dph;
  // An effect may have changed this run's coefficients; they are in the model's normalisation.
  if (plan.options.model.bias && axis.run.bias.coeff_dph != plan.options.model.bias->coeff_dph) {
    std::vector<double> mine = axis.run.bias.renormalised(plan.chain.t0_degc, plan.chain.range_degc).coeff_dph;
    mine.resize(std::max(coeff.size(), mine.size()), 0.0);
    coeff = mine;
  }
  coeff[0] += axis.turn_on_dph;
  return coeff;
}

// Normalised estimation error squared of the coefficients; negative where the truth is of higher order.
double nees(const CoreChain& chain, const std::vector<double>& truth) {
  const auto p = static_cast<size_t>(chain.kf().config.order) + 1;
  if (truth.size() > p) return -1;
  const std::vector<double> found = chain.coefficients();
  Eigen::VectorXd error(p);
  for (size_t i = 0; i < p; ++i) error(static_cast<long>(i)) = found[i] - (i < truth.size() ? truth[i] : 0.0);
  const std::vector<double> cov = chain.coefficient_covariance();
  const Eigen::Map<const Eigen::MatrixXd> p_matrix(cov.data(), static_cast<long>(p), static_cast<long>(p));
  return error.dot(solve_symmetric(p_matrix, error));
}

void score_calibration(const CampaignPlan& plan, const CoreChain& chain, const std::vector<double>& truth,
                       Tally* tally) {
  const size_t n = plan.temp_degc.size();
  std::vector<double> error(n), error2(n), variance(n), comp_lsb(n);
  std::vector<int64_t> within1(n), within2(n);
  double worst = 0;
  for (size_t i = 0; i < n; ++i) {
    const double temp_degc = plan.temp_degc[i], tn = (temp_degc - plan.chain.t0_degc) / plan.chain.range_degc;
    const double found = chain.compensated_bias_dph(temp_degc);
    error[i] = found - bias_dph(truth, tn);
    error2[i] = error[i] * error[i];
    variance[i] = static_cast<double>(imucal_kf_bias_variance(&chain.kf(), static_cast<float>(temp_degc)));
    within1[i] = error2[i] <= variance[i];
    within2[i] = error2[i] <= 4 * variance[i];
    comp_lsb[i] = std::abs(found - chain.table_bias_dph(temp_degc)) / static_cast<double>(chain.comp().unit_per_lsb);
    worst = std::max(worst, std::abs(error[i]));
  }
  tally->count("runs");
  tally->add("error", error);
  tally->add("error2", error2);
  tally->add("variance", variance);
  tally->count("within1", within1);
  tally->count("within2", within2);
  tally->add("worst_error", worst);
  tally->highest("comp_lsb", *std::max_element(comp_lsb.begin(), comp_lsb.end()));
  const double e = nees(chain, truth);
  if (e >= 0) {
    tally->add("nees", e);
    tally->count("nees_runs");
  }
}

void score_innovations(const CoreChain& chain, Tally* tally) {
  const imucal_kf_stats_t& s = chain.kf().stats;
  tally->add("nis", static_cast<double>(s.sum[IMUCAL_KF_NIS]) + static_cast<double>(s.sum_lo[IMUCAL_KF_NIS]));
  tally->count("seconds", s.n);
  tally->count("missed", s.n_missed);
  tally->count("refused", s.n_refused);
  tally->add("mean_innovation2", chain.mean_innovation2());
  tally->add("lags", std::vector<double>(chain.lag_sums(), chain.lag_sums() + kInnovationLagCount));
  tally->count("lags", std::vector<int64_t>(chain.lag_counts(), chain.lag_counts() + kInnovationLagCount));
  tally->count("dropped",
               static_cast<int64_t>(chain.sum().n_duplicate) + chain.sum().n_backward + chain.sum().n_refused);
}

void score_least_squares(const CampaignPlan& plan, const CoreChain& chain, const std::vector<double>& truth,
                         Tally* tally) {
  std::vector<FitPoint> points;
  points.reserve(chain.seconds().size());
  for (const SecondMean& s : chain.seconds())
    points.push_back({static_cast<double>(s.temp_degc), static_cast<double>(s.z_dph)});
  const auto coeff = fit_polynomial(points, plan.chain.order, plan.chain.t0_degc, plan.chain.range_degc);
  if (coeff.empty()) return;
  const size_t n = plan.temp_degc.size();
  std::vector<double> error2(n), difference2(n);
  double largest = 0;
  for (size_t i = 0; i < n; ++i) {
    const double tn = (plan.temp_degc[i] - plan.chain.t0_degc) / plan.chain.range_degc;
    const double fitted = bias_dph(coeff, tn), error = fitted - bias_dph(truth, tn);
    const double difference = fitted - chain.compensated_bias_dph(plan.temp_degc[i]);
    error2[i] = error * error;
    difference2[i] = difference * difference;
    largest = std::max(largest, std::abs(difference));
  }
  tally->count("ls_runs");
  tally->add("ls_error2", error2);
  tally->add("ls_difference2", difference2);
  tally->add("ls_largest_difference", largest);
  tally->highest("ls_largest_difference", largest);
}

// The float32 core against the same filter in double.
void score_reference(const CampaignPlan& plan, const CoreChain& chain, Tally* tally) {
  const ReferenceFilter reference = reference_filter(plan.chain, chain.seconds());
  double bias_dph_max = 0, sigma_rel_max = 0;
  for (const double temp_degc : plan.temp_degc) {
    const auto t = static_cast<float>(temp_degc);
    const double tn = (temp_degc - plan.chain.t0_degc) / plan.chain.range_degc;
    const double sigma = std::sqrt(bias_variance_dph2(reference.covariance_dph2, tn));
    bias_dph_max = std::max(bias_dph_max, std::abs(static_cast<double>(imucal_kf_bias(&chain.kf(), t)) -
                                                   bias_dph(reference.coeff_dph, tn)));
    sigma_rel_max =
        std::max(sigma_rel_max, std::abs(static_cast<double>(imucal_kf_bias_sigma(&chain.kf(), t)) / sigma - 1));
  }
  tally->count("reference_runs");
  tally->highest("reference_bias_dph", bias_dph_max);
  tally->highest("reference_sigma_rel", sigma_rel_max);
}

} // namespace

CalibrationTest calibrate_run(const CampaignPlan& plan, uint64_t run) {
  const SimOptions sim = run_options(plan, run, 0);
  const SimulatedLog log = simulate_test(plan, sim);
  CalibrationTest test{CoreChain(plan.chain), true_coefficients(plan, log.axes[0]), log.axes[0].turn_on_dph};
  feed(plan, log, sim, &test.chain);
  return test;
}

std::vector<CalibrationTest> calibrate_runs(const CampaignPlan& plan, uint64_t first_run, uint64_t n) {
  if (can_batch(plan)) return calibrate_batch(plan, first_run, n);
  std::vector<CalibrationTest> tests;
  for (uint64_t i = 0; i < n; ++i) tests.push_back(calibrate_run(plan, first_run + i));
  return tests;
}

static void score_test(const CampaignPlan& plan, uint64_t run, const CalibrationTest& test, Tally* tally) {
  score_calibration(plan, test.chain, test.truth, tally);
  score_innovations(test.chain, tally);
  const auto due = [run](uint64_t every) { return every > 0 && run % every == 0; };
  if (due(plan.options.least_squares_every)) score_least_squares(plan, test.chain, test.truth, tally);
  if (due(plan.options.reference_every)) score_reference(plan, test.chain, tally);
  if (due(plan.options.residual_every) && !plan.dp_n.empty()) {
    const SimOptions later = run_options(plan, run, 1);
    const SimulatedLog fresh = simulate_test(plan, later);
    score_residual(plan, test.chain, fresh, later, test.turn_on_dph - fresh.axes[0].turn_on_dph, tally);
  }
}

void score_runs(const CampaignPlan& plan, uint64_t first_run, uint64_t n, Tally* tally) {
  const std::vector<CalibrationTest> tests = calibrate_runs(plan, first_run, n);
  for (size_t i = 0; i < tests.size(); ++i) score_test(plan, first_run + i, tests[i], tally);
}

} // namespace imucal
