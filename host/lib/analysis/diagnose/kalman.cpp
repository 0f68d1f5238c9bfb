// SPDX-License-Identifier: MIT
#include "analysis/diagnose/kalman.h"

namespace imucal {
namespace {

// A run as the noise room sees it; it holds the temperatures of the used rows where the model reads them.
class RunTimes {
public:
  RunTimes(const CampaignRun& run, const NoiseModel& noise) : times_{run.n(), run.steps.data(), run.input.dt_s} {
    if (noise.is_stationary()) return;
    tn_.reserve(run.n());
    for (const int row : run.used) tn_.push_back(run.input.tn[static_cast<size_t>(row)]);
    times_.tn = tn_.data();
  }
  const SampleTimes& times() const { return times_; }

private:
  std::vector<double> tn_;
  SampleTimes times_;
};

} // namespace

RunGains compute_gains(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2) {
  return compute_gains(RunTimes(run, noise).times(), noise, extra_dph2);
}

double mixture_log_likelihood(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual,
                              Eigen::VectorXd* scores, Eigen::VectorXd* hit) {
  return mixture_log_likelihood(RunTimes(run, noise).times(), noise, residual, scores, hit);
}

} // namespace imucal
