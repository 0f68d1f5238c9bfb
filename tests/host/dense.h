// SPDX-License-Identifier: MIT
// Dense linear algebra that unit tests compare with: Eigen's own decompositions, compiled once; they do not go through
// host/lib/linear, which the library itself uses.
#pragma once
#include <Eigen/Core>

// a = L L' (Cholesky), a symmetric and positive definite: throws where it is not.
struct DenseFactor {
  explicit DenseFactor(const Eigen::MatrixXd& a);
  Eigen::MatrixXd half_solve(const Eigen::MatrixXd& b) const; // L^-1 b
  double log_det() const;                                     // of a

  Eigen::MatrixXd lower; // L; above its diagonal: not used
};

// a^-1 b and a^-1 of such an a.
Eigen::MatrixXd dense_solve(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);
Eigen::MatrixXd dense_inverse(const Eigen::MatrixXd& a);

// Products: x' x and a v a'.
Eigen::MatrixXd dense_gram(const Eigen::MatrixXd& x);
Eigen::MatrixXd dense_sandwich(const Eigen::MatrixXd& a, const Eigen::MatrixXd& v);

// The x with the smallest |a x - b|: Householder's QR with pivots.
Eigen::VectorXd dense_least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);
