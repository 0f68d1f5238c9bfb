// SPDX-License-Identifier: MIT
// The columns of all candidates and library-free tests on one campaign: evaluated once, and whitened once per
// noise model.  The panels of one search differ in their design far more often than in their noise.
//
// Reduced domain: block sums over sqrt(block length).  Exact for whatever changes little within a block (12 s
// in logs of usual length).
#pragma once
#include <Eigen/Dense>
#include <memory>
#include <string>
#include <vector>

#include "analysis/diagnose/kalman.h"

namespace imucal {

// Library-free tests; the first kMeanTests are free shapes of the mean.
enum Generic {
  kTemp,
  kTempDir,
  kTime,
  kTempTime,
  kByRun,
  kTransient,
  kMeanTests,
  kPsd = kMeanTests,
  kVarTemp,
  kVarRun,
  kDist,
  kVol,
  kAsym,
  kGenerics
};

// Delays of the temperature rate that a free response to earlier temperatures is made of.
constexpr double kDelays_s[] = {0., 30., 60., 120., 200., 300., 450., 600., 800., 1000., 1300.};

// Everything under one Gaussian noise model.
struct WhitenedColumns {
  std::vector<RunGains> gains; // per run
  double sum_log_s = 0;
  // Per effect, reduced: kColumns, shape after shape, n_columns each; kTemperature, the powers of the
  // polynomial, shape after shape; kRunRandom, n_columns of each run, zero in the others.  Else empty.
  std::vector<Eigen::MatrixXd> candidates;
  std::vector<Eigen::MatrixXd> tests; // kMeanTests of them, or none
  std::vector<Eigen::VectorXd> step;  // per run: response to a step, from its block on
  // Filters with a slope of -h and +h, of noise candidates whose parameter may have either sign.
  struct Slope {
    size_t candidate;
    double h;
    std::vector<RunGains> minus, plus;
  };
  std::vector<Slope> slopes;
};

class ColumnBank {
public:
  // The campaign has to outlive the bank and must not change (masking) meanwhile.
  ColumnBank(const Campaign& campaign, const std::vector<const Effect*>& library);

  const Campaign& campaign() const { return campaign_; }
  const std::vector<const Effect*>& library() const { return library_; }
  // Shape of every set of columns of an effect, in their order.
  const std::vector<Theta>& shapes(size_t effect) const { return shapes_[effect]; }
  bool can_score(size_t effect) const;

  // The last models asked for are kept.
  std::shared_ptr<const WhitenedColumns> under(const NoiseModel& gaussian, bool with_tests);

  long n_blocks() const { return first_block_.back(); }
  long block() const { return block_; }
  long first_block(size_t run) const { return first_block_[run]; }
  // Block sums over sqrt(length) of columns of one run into its rows of `out`.
  void reduce_run(size_t run, const Eigen::MatrixXd& white, Eigen::MatrixXd* out) const;
  Eigen::VectorXd reduce(const std::vector<Eigen::VectorXd>& e) const;
  Eigen::MatrixXd whiten_and_reduce(const std::vector<RunGains>& gains, std::vector<Eigen::MatrixXd> columns) const;

private:
  void evaluate_tests();
  std::shared_ptr<WhitenedColumns> whiten_all(const NoiseModel& gaussian) const;
  void whiten_tests(WhitenedColumns* out) const;
  void step_responses(WhitenedColumns* out) const;

  const Campaign& campaign_;
  std::vector<const Effect*> library_;
  long block_ = 12;
  std::vector<long> first_block_;                   // per run, and the end
  std::vector<std::vector<Theta>> shapes_;          // per effect
  std::vector<std::vector<Eigen::MatrixXd>> raw_;   // per effect and run: used samples x columns
  std::vector<std::vector<Eigen::MatrixXd>> tests_; // per test and run
  struct Kept {
    NoiseModel noise;
    std::shared_ptr<WhitenedColumns> columns;
  };
  std::vector<Kept> kept_; // newest last
};

} // namespace imucal
