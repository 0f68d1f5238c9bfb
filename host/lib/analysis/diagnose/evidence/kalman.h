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

// Gains of one noise model for the runs of a campaign.  A run with samples at the same times as another one, as far as it goes,
// has the same gains, unless the noise follows the temperature: those of the longest run serve such runs.
class GainsByRun {
public:
  GainsByRun(const std::vector<CampaignRun>& runs, const NoiseModel& noise); // the runs must outlive it
  // Good until the next call.
  const RunGains& of(const CampaignRun& run);

private:
  bool is_beginning_of_longest(const CampaignRun& run) const;

  NoiseModel noise_;
  const CampaignRun* longest_ = nullptr; // where its gains can serve
  RunGains of_longest_, of_another_;
};

} // namespace imucal
