// SPDX-License-Identifier: MIT
// Marginal likelihood of a mean and a noise model on one campaign.
//
//   y = C c + L l_r + noise,   c ~ N(0, P^-1), l_r ~ N(0, Q^-1) of every run,   noise ~ N(0, V(nu))
//   log p(y | nu) = -1/2 [ e'e + sum log S + log|X'V^-1X + P| - log|P| ]
//
// with the innovations e and their variances S of the Kalman filter (de Jong, Ann. Stat. 1991).  Constants of the
// runs and the polynomial are flat (precision 0, the same in every hypothesis that is compared); everything else has
// a weak prior in dph, so that hypotheses of any size compare without a count of parameters.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "analysis/diagnose/evidence/kalman.h"

namespace imucal {

// A prior in dph is tried at these multiples of its scale, each as likely as the others.
constexpr double kPriorScales[] = {1.0 / 3, 1.0, 3.0};

// One part of the mean: columns with a coefficient common to all runs, and columns with one of every run.
struct MeanPart {
  std::vector<Eigen::MatrixXd> common, local;        // per run: used samples x columns
  Eigen::VectorXd common_precision, local_precision; // 1/dph^2; 0: flat
  std::vector<Eigen::MatrixXd> powers;               // per run, or empty: replaces the powers of temperature
};

std::vector<const MeanPart*> pointers_of(const std::vector<MeanPart>& parts);

// What all hypotheses on a campaign share.
struct SlowData {
  explicit SlowData(Campaign blocks);
  // Fewer rows of the same runs, with the columns of `like`: one polynomial, one scale of priors.
  SlowData(Campaign blocks, const SlowData& like);
  Campaign campaign;
  std::vector<Eigen::VectorXd> y;          // per run, its mean taken off
  std::vector<Eigen::MatrixXd> powers;     // per run: polynomial of temperature, centred by run, unit rms, orthogonal
  std::vector<std::vector<int>> rows_used; // per run
  double spread_dph = 0; // rms of what least squares with the polynomial leaves, in one-minute means: scale of priors
  size_t rows() const;
};

// Columns of a polynomial at another temperature, normalised as SlowData::powers are: centred by run, orthogonal,
// unit rms.  A flat prior on their coefficients is then one on values in dph, whatever the range of the temperature.
std::vector<Eigen::MatrixXd> polynomial_columns(const Campaign& campaign, const std::vector<Column>& tn);

// The columns of an effect at one shape (kColumns, kTemperature, kRunRandom, kTone, kSteps).
MeanPart mean_part(const SlowData& data, const EffectEstimator& estimator, const Theta& shape);

// Share of each used row of a run that lies after a change: rows and change together are over_s long, about their times.
Eigen::VectorXd share_after(const CampaignRun& run, double change_s, double over_s);

// The levels after the jumps that runs have of their own; no columns where none has any.
MeanPart own_jumps_part(const SlowData& data);

// A part on the rows that `some`, made from `all`, still has: the same columns and priors, so that likelihoods and
// coefficients of all rows and of some belong together.
MeanPart rows_of(const MeanPart& part, const SlowData& all, const SlowData& some);

// Only the start states of an effect.
MeanPart start_part(const SlowData& data, const EffectEstimator& estimator, const Theta& shape);

// The columns of a mean with the data, in the order that the filters read them: made once, scored under many noises.
class MeanColumns {
public:
  MeanColumns(const SlowData& data, const std::vector<const MeanPart*>& parts);

private:
  friend class RunGrams;
  Eigen::VectorXd local_precision_, common_precision_;
  std::vector<WideColumns> wide_; // per run: local (constant first), common (powers first), y
};

// Sums of products of whitened columns, run by run: any subset of runs is scored from them.
class RunGrams {
public:
  RunGrams(const SlowData& data, const MeanColumns& columns, const NoiseModel& noise);
  RunGrams(const SlowData& data, const std::vector<const MeanPart*>& parts, const NoiseModel& noise)
      : RunGrams(data, MeanColumns(data, parts), noise) {}

  // Log marginal likelihood of the runs chosen (empty: all).  `scale` multiplies the standard deviations of all
  // priors of parts.
  double log_marginal(double scale = 1, const std::vector<char>& runs = {}) const;
  // Logarithm of the mean over the prior scales 1/3, 1, 3: the size of an effect is not known to a factor of three.
  double log_marginal_any_scale(const std::vector<char>& runs = {}) const;

  struct Posterior {
    Eigen::VectorXd common; // coefficients: powers first, then parts
    Eigen::MatrixXd common_covariance;
    std::vector<Eigen::VectorXd> local, local_sd; // per run: constant first
  };
  Posterior posterior(const std::vector<char>& runs = {}) const;
  // Sums of products of the common columns and the data (last) of one run, its local ones taken out.
  Eigen::MatrixXd without_local(size_t run) const;
  const Eigen::VectorXd& common_precision() const { return common_precision_; }

private:
  double one_run(size_t r, double scale, Eigen::MatrixXd* common) const;

  long n_local_ = 1, n_common_ = 0;
  Eigen::VectorXd local_precision_, common_precision_;
  std::vector<Eigen::MatrixXd> gram_; // per run: local, common, y
  std::vector<double> sum_log_s_;
};

// What a run's rates are off the mean at a posterior: its constant and start states as estimated with it.
Eigen::VectorXd residual_of(const SlowData& data, const std::vector<MeanPart>& parts, const RunGrams::Posterior& at,
                            size_t run);

// What a step just before every used row of a run would gain at its best size, without a prior of its own, beside a mean at its
// posterior: half the squared score over the information [nats].  The first row, where a step is the constant of the run, gains
// nothing.  `gains`: of the run.
Eigen::VectorXd step_gains(const SlowData& data, const std::vector<MeanPart>& parts, const RunGains& gains,
                           const RunGrams::Posterior& at, size_t run);

} // namespace imucal
