// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/kalman.h"

namespace imucal {

RunTimes::RunTimes(const CampaignRun& run, bool reads_temperature) : times_{run.n(), run.steps.data(), run.input.dt_s} {
  if (!reads_temperature) return;
  tn_.reserve(run.n());
  for (const int row : run.used) tn_.push_back(run.input.tn[static_cast<size_t>(row)]);
  times_.tn = tn_.data();
}

RunGains compute_gains(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2) {
  return compute_gains(RunTimes(run, !noise.is_stationary()).times(), noise, extra_dph2);
}

const RunGains& GainsByRun::of(const CampaignRun& run) {
  const bool is_same =
      last_ && noise_.is_stationary() && last_->steps == run.steps && last_->input.dt_s == run.input.dt_s;
  if (!is_same) gains_ = compute_gains(run, noise_);
  last_ = &run;
  return gains_;
}

double mixture_log_likelihood(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual,
                              Eigen::VectorXd* scores, Eigen::VectorXd* hit) {
  return mixture_log_likelihood(RunTimes(run, !noise.is_stationary()).times(), noise, residual, scores, hit);
}

TelegraphLevel telegraph_level(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual) {
  return telegraph_level(RunTimes(run, !noise.is_stationary()).times(), noise, residual);
}

} // namespace imucal
