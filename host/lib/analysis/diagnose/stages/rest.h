// SPDX-License-Identifier: MIT
// Tests of what is left of the seconds: they need no library, and say that something is there, not what.
#pragma once
#include <vector>

#include "analysis/diagnose/evidence/constants.h"
#include "analysis/diagnose/evidence/fit.h"

namespace imucal {

// Tests of innovations that no effect owns.
enum class Rest {
  kSpectrum,
  kVarianceOverTemperature,
  kVarianceOverTime,
  kDistribution,
  kBursts,
  kLine,
  kSuddenChanges,
  kCount
};
struct RestFinding {
  Rest test = Rest::kSpectrum;
  double evidence_nats = 0;  // > 0: fires; at rest_rate on a right model
  double threshold_nats = 0; // what -ln p has beyond it is the evidence; p of a line: of one place of the spectrum
  double n_places = 1;       // that were looked at for the strongest line

  // Probability of so much, or more, on a right model; of a line: at most.
  double p_value() const;
};
std::vector<RestFinding> test_rest(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e,
                                   const SelectorConstants& constants);
// Those of held-out logs that need no more of the noise than its kind: its parameters are known from other logs, to within
// errors.  `e`: of a fit of these logs, of any variance; `e_less_hits`: without samples that stand out, which only make tails.
std::vector<RestFinding> test_unseen(const Campaign& held_out, const std::vector<Eigen::VectorXd>& e,
                                     std::vector<Eigen::VectorXd> e_less_hits, const SelectorConstants& constants);
// By how many standard errors the kurtosis of the innovations is off that of a normal.
double heavy_tails(const std::vector<Eigen::VectorXd>& e);
// Two of the tests alone.
bool changes_suddenly(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e,
                      const SelectorConstants& constants);
bool has_spectrum(const Campaign& campaign, const std::vector<Eigen::VectorXd>& e, const SelectorConstants& constants);

// Whether sudden changes go one way more than the other, as teeth do; telegraph noise jumps up and down in turn.  Said at a
// rate of 1 in 100 at most where they do not.  `residual`: rate less the fitted mean; `noise`: of any kind.
bool is_one_sided(const Campaign& campaign, const std::vector<Eigen::VectorXd>& residual, const NoiseModel& noise);

// Whether what noise with hits takes for hits stays: innovations after a hit have its sign, as after a jump.  A hit is gone
// with its sample.  Said at rest_rate where it is.
bool do_hits_stay(const Campaign& campaign, const std::vector<Eigen::VectorXd>& residual, const NoiseModel& noise,
                  const SelectorConstants& constants);

constexpr long kOfOneBurst[] = {10, 60}; // samples within which hits of one burst follow each other

} // namespace imucal
