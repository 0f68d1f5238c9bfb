// SPDX-License-Identifier: MIT
// How large the prediction errors of one n are: their number, the 95.4th percentile and the maximum of |d|, from blocks
// of d that are looked at once.  Exact, in linear time, and without keeping d.
//
// The percentile of a sample of d, with four standard errors of its rank to both sides, brackets that of all: only what
// lies within is kept (some 3 %) and what lies below is counted.  Where the bracket misses, percentile() says so.
#pragma once
#include <cstdint>
#include <optional>
#include <vector>

namespace imucal {

constexpr double kPercentile = 0.954; // of |d|: two sigma

// Place `part` of the way between the order statistics of x, linear between them.  Reorders x; x is not empty.
double order_statistic(std::vector<double>* x, double part);

class Sizes {
public:
  static constexpr long kSample = 4096; // of d, evenly over the record; so few in all are simply kept

  // `sample` of |d|; empty: everything is kept.
  explicit Sizes(std::vector<double> sample = {});

  void add(const double* d, long n);

  long count() const { return count_; }
  double largest() const;
  std::optional<double> percentile();

private:
  double lo_, hi_; // the bracket
  long count_ = 0, below_ = 0, n_kept_ = 0;
  double largest_ = 0;
  std::vector<double> kept_; // the first n_kept_
};

} // namespace imucal
