// SPDX-License-Identifier: MIT
// Whitening by the innovations filter: with V the covariance of the noise at the samples,
// (whitened a)'(whitened b) = a' V^-1 b.
//
// Columns of one run, one row per sample.  Cost: about 2 ns per sample, column and state.  Threads: pure functions.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "noise/gains.h"

namespace imucal {

// In place: each innovation over its standard deviation.
void whiten(const RunGains& gains, Eigen::MatrixXd* columns);
void whiten(const RunGains& gains, double* column, size_t n);
// The same for n rows of `width` values, row after row.
void whiten_rows(const RunGains& gains, size_t width, double* rows);
// Rows become V^-1 rows: the backward recursion of the disturbance smoother (de Jong 1988; Durbin and Koopman 2012,
// 4.5) after whitening.
void solve_rows(const RunGains& gains, size_t width, double* rows);
// u' V^-1 u of every step u that is 0 before sample k and 1 from there on: what a step of 1 dph there adds to a sum of squares.
Eigen::VectorXd step_norms(const RunGains& gains);
// The inverse of whitening: the sample path whose whitened innovations are `column`.
void colour(const RunGains& gains, double* column, size_t n);

// A'B of columns of one run, for the widest vectors of the machine.  Shapes: n x p and n x q give p x q.
Eigen::MatrixXd column_products(const Eigen::Ref<const Eigen::MatrixXd>& a, const Eigen::Ref<const Eigen::MatrixXd>& b);
Eigen::MatrixXd column_gram(const Eigen::Ref<const Eigen::MatrixXd>& a); // A'A

// The columns of one run in the order that the filters read them.  Made once, then whitened by many noise models.
class WideColumns {
public:
  explicit WideColumns(const Eigen::MatrixXd& columns); // one row per sample
  WideColumns(const std::vector<const double*>& columns, size_t n);
  // W'W of the whitened columns W.
  Eigen::MatrixXd whitened_gram(const RunGains& gains) const;

private:
  size_t n_, p_, width_;     // samples, columns, and these with what fills the last vector
  std::vector<double> data_; // sample after sample
};

// For columns whose whitened values are wanted: they lie in groups of eight, the last of four or eight.
class LaneColumns {
public:
  explicit LaneColumns(const Eigen::MatrixXd& columns); // one row per sample
  Eigen::MatrixXd whitened(const RunGains& gains) const;

private:
  size_t n_, p_;             // samples, columns
  std::vector<double> data_; // group after group; in a group sample after sample
};

} // namespace imucal
