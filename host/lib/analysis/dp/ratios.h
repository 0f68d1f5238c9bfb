// SPDX-License-Identifier: MIT
// Is the prediction error Gaussian?  Ratios of max/3 and of the 95.4th percentile/2 to the rms (paper eq. 3), a verdict
// with a stated false-alarm rate, and where in time and temperature the outliers lie.
//
// For Gaussian d the percentile ratio is 0.998 with a standard deviation of about 0.7/sqrt(dof), and the largest of
// `windows` values exceeds z sigma with probability below 2 windows Phi(-z) (sigma taken from the percentile, which
// outliers do not move).  Both limits are set so that at most the given part of all Gaussian records gets another verdict
// (Bonferroni over the octaves of tau, between which d is nearly independent).
// Verdicts: "gaussian"; "outliers" (single events); "singularity" (most events in one narrow range of temperature, passed
// at least twice); "heavy_tails" and "light_tails" (percentile ratio off: the variance changes along the record, or the
// distribution is not Gaussian); "too_short" (dof below 20 at every tau).
#pragma once
#include <string>
#include <vector>

#include "analysis/dp/dp.h"

namespace imucal {

constexpr double kPercentileRatio = 0.99768; // 95.4th percentile of |N(0,1)| over 2
constexpr double kPercentileSpread = 0.70;   // times 1/sqrt(dof); simulated: errormodel validate, tests
constexpr double kLeastDof = 20;             // below it the ratio says nothing

struct DpOutlier {
  double t_s = 0;       // of the sample that is off; beside a jump, or where many are, of the first that was predicted
  double temp_degc = 0; // NaN without temperature
  double tau_s = 0;     // where it stands out most
  double sigmas = 0;    // |d| over the sigma of the percentile
};

struct DpRatios {
  std::string log, axis;
  DpType type = DpType::kAv;
  std::vector<double> tau_s, max_over_rms, p95_over_rms, dof;
  std::vector<double> max_limit; // max/3 over rms that a Gaussian record stays below (at the false-alarm rate)
  std::string verdict, statement;
  std::vector<DpOutlier> outliers; // events, at most 20, largest first
  long n_events = 0;
};

// At the taus of `curve`, which is one of this record; `dof` per tau as from analysis/errormodel/confidence.h; temp_degc of every
// sample (empty: not known), which axes of a log may share.  Of the series only labels, time stamps and size are read.
DpRatios dp_ratios(const Series& series, const std::vector<double>& temp_degc, const DpRecord& record,
                   const DpCurve& curve, const std::vector<double>& dof, double false_alarm_rate = 0.01);

} // namespace imucal
