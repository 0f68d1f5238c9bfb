// SPDX-License-Identifier: MIT
// Dense linear algebra: the few decompositions that the analyses use.  Eigen's templates for them take seconds to compile
// wherever they are named; here they are compiled once, and other rooms include <Eigen/Core> only.
// Shapes that do not fit are errors of the caller and are not checked.
#pragma once
#include <Eigen/Core>
#include <cmath>
#include <memory>

namespace imucal {

// ---- a symmetric, positive semi-definite: LDLT with pivots ----

// x of a x = b.  log_det, where asked for: logarithm of the determinant of a.
Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, double* log_det = nullptr);
Eigen::MatrixXd inverse_symmetric(const Eigen::MatrixXd& a);

// ---- a symmetric, positive definite: a = L L' (Cholesky) ----

class Cholesky {
public:
  Cholesky() = default;
  explicit Cholesky(const Eigen::MatrixXd& a);

  bool is_positive() const { return is_positive_; }           // false: a is not, and nothing below may be asked
  Eigen::MatrixXd half_solve(const Eigen::MatrixXd& b) const; // L^-1 b
  Eigen::VectorXd half_solve(const Eigen::VectorXd& b) const;
  Eigen::MatrixXd inverse() const;                                    // of a
  double log_det(long i) const { return 2 * std::log(lower_(i, i)); } // what row i gives to it
  double log_det() const;

private:
  Eigen::MatrixXd lower_; // L; above its diagonal: not used
  bool is_positive_ = false;
};

// ---- a symmetric ----

// Eigenvalues of a symmetric a, rising, and in the columns of `vectors` what belongs to them.
struct Spectrum {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
Spectrum symmetric_spectrum(const Eigen::MatrixXd& a);

// ---- least squares ----

// a x = b in the sense of least squares, the shortest such x: complete orthogonal decomposition, for any rank of a.
Eigen::MatrixXd solve_shortest(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

// R of rows = Q R, square; at least as many rows as columns.  Householder; `rows` is used up.
Eigen::MatrixXd triangle_of(Eigen::MatrixXd* rows);

// a P = Q R with the columns of a in falling order of what they add (Householder).
class PivotedQr {
public:
  // A pivot below threshold times the largest one counts as zero.
  PivotedQr(const Eigen::MatrixXd& a, double threshold);

  long rank() const;
  Eigen::VectorXd solve(const Eigen::VectorXd& b) const;    // least squares; columns beyond the rank: 0
  Eigen::MatrixXd q() const;                                // as many columns as a
  Eigen::MatrixXd r_inverse() const;                        // of the first rank() rows and columns of R
  Eigen::MatrixXd r_solve(const Eigen::MatrixXd& b) const;  // R^-1 b, rank full
  double log_abs_r(long i) const;                           // ln |R(i, i)|
  Eigen::MatrixXd permuted(const Eigen::MatrixXd& b) const; // P b: rows in the order of the columns of a
  Eigen::VectorXd permuted(const Eigen::VectorXd& b) const;

private:
  std::shared_ptr<const Eigen::ColPivHouseholderQR<Eigen::MatrixXd>> qr_;
};

} // namespace imucal
