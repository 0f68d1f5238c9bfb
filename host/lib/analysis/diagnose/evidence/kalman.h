// SPDX-License-Identifier: MIT
// The filters of the noise room for a run of a campaign.
#pragma once
#include "analysis/diagnose/logs/campaign.h"
#include "noise/gains.h"
#include "noise/mixture.h"
#include "noise/whiten.h"

namespace imucal {

// A run as the noise room sees it; it holds the temperatures of the used rows where the model reads them.
class RunTimes {
public:
  RunTimes(const CampaignRun& run, bool reads_temperature);
  RunTimes(RunTimes&&) = default;
  SampleTimes times() const { return times_; } // good while this and the run live

private:
  std::vector<double> tn_;
  SampleTimes times_;
};

RunGains compute_gains(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2 = nullptr);
double mixture_log_likelihood(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual,
                              Eigen::VectorXd* scores = nullptr, Eigen::VectorXd* hit = nullptr);

TelegraphLevel telegraph_level(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual);

// Gains of one noise model, run after run.  A run with samples at the same times as the one before has the same gains,
// unless the noise follows the temperature.
class GainsByRun {
public:
  explicit GainsByRun(const NoiseModel& noise) : noise_(noise) {}
  // Good until the next call; `run` must live until then too.
  const RunGains& of(const CampaignRun& run);

private:
  NoiseModel noise_;
  const CampaignRun* last_ = nullptr;
  RunGains gains_;
};

} // namespace imucal
