// SPDX-License-Identifier: MIT
// The slow stage works on means over blocks of seconds: a thermal cause changes little in ten seconds, and white
// noise plus a Gauss-Markov process stays white noise plus a Gauss-Markov process when it is averaged, so that
// nothing is lost for slow causes as long as the noise parameters are estimated on the blocks themselves.
#pragma once
#include "analysis/diagnose/logs/campaign.h"

namespace imucal {

// Length of the blocks: 10 s, longer where the logs hold more than about 3500 blocks of 10 s together.
double block_length_s(const Campaign& seconds);

// The same campaign with one row per block (dt_s = block_s).  A block of which less than half of the seconds are
// used, or all are hits, has no rate.  Single seconds far from the median of their block (eight times the noise between seconds) are
// left out where neither neighbour is like them: hits are judged at full rate, and one of them would colour a whole block.
Campaign block_means(const Campaign& seconds, double block_s);

// By how much the used samples of each run that those means leave out are off the median of their block [dph]; of others 0, and
// of those with which a memory that fades within seconds begins.
std::vector<Eigen::VectorXd> hits_of(const Campaign& seconds);

// Sizes of the differences of neighbouring used samples [dph].
std::vector<double> changes_between_samples(const CampaignRun& run);

// Noise of the used samples from the differences of neighbours, robustly, per square root of a second [dph]: what
// white noise alone would give.
double white_between_samples(const Campaign& campaign);
// The same of other rates of the used samples, per run.
double white_between_samples(const Campaign& campaign, const std::vector<Eigen::VectorXd>& rates_dph);

// The noise of means over `block_s` of noise that is `seconds` in 1-s means; telegraph noise as the process of its
// covariance, hits left out (block_means does).  The mean of a Gauss-Markov process over
// blocks of a = block/tau has the covariance sigma^2 2 (cosh a - 1)/a^2 exp(-a n) at distance n >= 1 and
// sigma^2 2 (a - 1 + exp(-a))/a^2 at 0: a Markov process of larger variance and (negative) white noise.
NoiseModel block_equivalent(const NoiseModel& seconds, double block_s);

// Why a run of which less than a minute of block means stays is left out.
constexpr char kTooShort[] = "has less than a minute of usable means";

// Leaves out such runs.  False: none would stay, and nothing was changed.
bool drop_short_runs(Campaign* seconds);

} // namespace imucal
