// SPDX-License-Identifier: MIT
// All candidate columns of the library on one campaign, whitened once per node (a noise model) and scored from
// products of columns: a candidate costs one small Cholesky factorisation, a draw of the data one more column.
#pragma once
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "analysis/diagnose/evidence/marginal.h"

namespace imucal {

// One candidate at one shape.
struct ScanGroup {
  size_t candidate = 0; // place in the list the bank was made with
  Theta shape;
  MeanPart part;
};

// A candidate of the scan: an effect of the library, or a free shape of the mean that no effect owns.
struct ScanCandidate {
  const EffectEstimator* estimator = nullptr;
  std::vector<Theta> shapes;
};
MeanPart part_of(const SlowData& data, const ScanCandidate& candidate, const Theta& shape);

class ScanBank {
public:
  ScanBank(const SlowData& data, const std::vector<ScanCandidate>& candidates);

  const SlowData& data() const { return data_; }
  const std::vector<ScanGroup>& groups() const { return groups_; }
  size_t n_candidates() const { return n_candidates_; }

private:
  friend class ScanNode;
  struct Place {
    long first = 0, common = 0, local = 0, powers = 0; // columns in the order common, powers, local
    long width() const { return common + powers + local; }
  };
  const SlowData& data_;
  size_t n_candidates_;
  std::vector<ScanGroup> groups_;
  std::vector<Place> places_;
  std::vector<LaneColumns> columns_; // per run: all columns
};

// The bank under one noise model.
class ScanNode {
public:
  // `keeps_bank`: it will be scanned beside parts.
  ScanNode(const ScanBank& bank, const NoiseModel& noise, bool keeps_bank = false);

  const NoiseModel& noise() const { return noise_; }
  // Frees the whitened columns that were kept; they are made anew where they are asked for.
  void forget_white() {
    for (Eigen::MatrixXd& x : white_) x.resize(0, 0);
  }

  struct Scores {
    Eigen::VectorXd base;  // per draw: log marginal likelihood of the base
    Eigen::MatrixXd group; // group x draw: of the base with this group, mean over the prior scales
  };
  // `base`: parts that are in the mean already.  `y`: per run, used samples x draws, not whitened.
  // `skip`: per candidate, 1: leave out (its scores are -1e300).
  Scores score(const std::vector<const MeanPart*>& base, const std::vector<Eigen::MatrixXd>& y,
               const std::vector<char>& skip) const;
  // The same of the data themselves, for several bases: the bank is read once.
  struct Asked {
    std::vector<const MeanPart*> base;
    std::vector<char> skip;
  };
  std::vector<Scores> score(const std::vector<Asked>& asked) const;

private:
  // Data under the node's noise, per run: whitened, and their products with the bank.
  struct WhiteData {
    std::vector<Eigen::MatrixXd> y, with_bank;
  };
  struct Products;
  Eigen::MatrixXd whitened_bank(size_t run) const;
  const Eigen::MatrixXd& white(size_t run) const;
  WhiteData white_data(const std::vector<Eigen::MatrixXd>& y) const;
  std::vector<Scores> score_white(const std::vector<Asked>& asked, const WhiteData& y) const;
  Scores score_one(const Products& products, const Asked& asked) const;
  struct Range {
    long first = 0, n = 0;
  };
  Range asked_columns(const std::vector<Asked>& asked) const;
  void multiply_with_bank(const Range& range, size_t run, std::vector<Products>* all) const;
  std::vector<Products> products(const std::vector<Asked>& asked, const WhiteData& y) const;
  Eigen::MatrixXd solved_with(const Products& products, size_t group, long rows) const;
  Eigen::RowVectorXd score_group(const Products& products, size_t group, long rows, const Eigen::VectorXd& start) const;

  const ScanBank& bank_;
  NoiseModel noise_;
  std::vector<RunGains> gains_;
  double sum_log_s_ = 0;
  std::vector<std::vector<Eigen::MatrixXd>> self_; // per group and run
  // Per run: the bank whitened.  Bases without parts need its products alone, so that it is kept only where a scan asks
  // for it (by one thread).
  mutable std::vector<Eigen::MatrixXd> white_;
  std::vector<Eigen::MatrixXd> usual_; // per run: constant and powers of every base, times the bank
  WhiteData own_;                      // of the data themselves
};

} // namespace imucal
