// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/kalman.h"

#include <algorithm>

namespace imucal {

namespace {

// Whether a run has its samples at the times of another one, as far as it goes, and as much noise of its own.  The first step is
// not read: no sample is before it.
bool is_beginning(const CampaignRun& run, const CampaignRun& of) {
  if (run.n() == 0 || run.n() > of.n() || run.input.dt_s != of.input.dt_s) return false;
  if (run.own_white_dph2 != of.own_white_dph2) return false;
  return std::equal(run.steps.begin() + 1, run.steps.end(), of.steps.begin() + 1);
}

} // namespace

RunTimes::RunTimes(const CampaignRun& run, bool reads_temperature) : times_{run.n(), run.steps.data(), run.input.dt_s} {
  times_.own_white_dph2 = run.own_white_dph2;
  if (!reads_temperature) return;
  tn_.reserve(run.n());
  for (const int row : run.used) tn_.push_back(run.input.tn[static_cast<size_t>(row)]);
  times_.tn = tn_.data();
}

RunGains compute_gains(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2) {
  return compute_gains(RunTimes(run, !noise.is_stationary()).times(), noise, extra_dph2);
}

GainsByRun::GainsByRun(const std::vector<CampaignRun>& runs, const NoiseModel& noise) : noise_(noise) {
  if (runs.empty() || !noise.is_stationary()) return;
  const auto is_shorter = [](const CampaignRun& a, const CampaignRun& b) { return a.n() < b.n(); };
  longest_ = &*std::max_element(runs.begin(), runs.end(), is_shorter);
  of_longest_ = compute_gains(*longest_, noise_);
}
const RunGains& GainsByRun::of(const CampaignRun& run) {
  if (longest_ && is_beginning(run, *longest_)) {
    if (run.n() == longest_->n()) return of_longest_;
    return of_beginning_ = first_samples(of_longest_, run.n());
  }
  const bool is_as_last = last_ && run.n() == last_->n() && is_beginning(run, *last_);
  if (!is_as_last) of_last_ = compute_gains(run, noise_);
  if (noise_.is_stationary()) last_ = &run;
  return of_last_;
}

double mixture_log_likelihood(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual,
                              Eigen::VectorXd* scores, Eigen::VectorXd* hit) {
  return mixture_log_likelihood(RunTimes(run, !noise.is_stationary()).times(), noise, residual, scores, hit);
}

Eigen::VectorXd expected_hit_dph2(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual) {
  return expected_hit_dph2(RunTimes(run, !noise.is_stationary()).times(), noise, residual);
}

TelegraphLevel telegraph_level(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual) {
  return telegraph_level(RunTimes(run, !noise.is_stationary()).times(), noise, residual);
}

std::vector<Eigen::VectorXd> whitened(const std::vector<CampaignRun>& runs, const NoiseModel& noise,
                                      std::vector<Eigen::VectorXd> residual) {
  GainsByRun gains(runs, noise);
  for (size_t r = 0; r < residual.size(); ++r)
    whiten(gains.of(runs[r]), residual[r].data(), static_cast<size_t>(residual[r].size()));
  return residual;
}

} // namespace imucal
