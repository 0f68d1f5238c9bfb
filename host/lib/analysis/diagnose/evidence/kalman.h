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
Eigen::VectorXd expected_hit_dph2(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual);

TelegraphLevel telegraph_level(const CampaignRun& run, const NoiseModel& noise, const Eigen::VectorXd& residual);

// Gains of one noise model for the runs of a campaign.  A run with samples at the same times as another one, as far as it goes,
// has the same gains, unless the noise follows the temperature or one of them is rounded to other steps: those of the longest run
// and of the one asked for last serve such runs.
class GainsByRun {
public:
  GainsByRun(const std::vector<CampaignRun>& runs,
             const NoiseModel& noise); // these and those asked for must outlive it
  // Good until the next call.
  const RunGains& of(const CampaignRun& run);

private:
  NoiseModel noise_;
  const CampaignRun *longest_ = nullptr, *last_ = nullptr; // where their gains can serve
  RunGains of_longest_, of_last_, of_beginning_;
};

// Innovations of a residual, run by run.
std::vector<Eigen::VectorXd> whitened(const std::vector<CampaignRun>& runs, const NoiseModel& noise,
                                      std::vector<Eigen::VectorXd> residual);

} // namespace imucal
