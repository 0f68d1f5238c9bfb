// SPDX-License-Identifier: MIT
#include "linear/linear.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd solve_symmetric(const MatrixXd& a, const VectorXd& b, double* log_det) {
  const Eigen::LDLT<MatrixXd> ldlt(a);
  if (log_det != nullptr) *log_det = ldlt.vectorD().array().log().sum();
  return ldlt.solve(b);
}

MatrixXd inverse_symmetric(const MatrixXd& a) {
  return Eigen::LDLT<MatrixXd>(a).solve(MatrixXd(MatrixXd::Identity(a.rows(), a.cols())));
}

Cholesky::Cholesky(const MatrixXd& a) {
  const Eigen::LLT<MatrixXd> llt(a);
  is_positive_ = llt.info() == Eigen::Success;
  lower_ = llt.matrixLLT();
}

MatrixXd Cholesky::half_solve(const MatrixXd& b) const {
  MatrixXd out = b;
  lower_.triangularView<Eigen::Lower>().solveInPlace(out);
  return out;
}

VectorXd Cholesky::half_solve(const VectorXd& b) const {
  VectorXd out = b;
  lower_.triangularView<Eigen::Lower>().solveInPlace(out);
  return out;
}

MatrixXd Cholesky::inverse() const {
  MatrixXd out = half_solve(MatrixXd(MatrixXd::Identity(lower_.rows(), lower_.cols())));
  lower_.adjoint().triangularView<Eigen::Upper>().solveInPlace(out);
  return out;
}

double Cholesky::log_det() const {
  double sum = 0;
  for (long i = 0; i < lower_.rows(); ++i) sum += log_det(i);
  return sum;
}

Spectrum symmetric_spectrum(const MatrixXd& a) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(a);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

MatrixXd solve_shortest(const MatrixXd& a, const MatrixXd& b) {
  return Eigen::CompleteOrthogonalDecomposition<MatrixXd>(a).solve(b);
}

namespace {

// Works in the memory of `rows`.  HouseholderQR<Ref<MatrixXd>> would do so too, with templates of its own for each of its
// steps; those of MatrixXd are there for the other decompositions.
class QrInPlace : Eigen::HouseholderQR<MatrixXd> {
public:
  explicit QrInPlace(MatrixXd* rows) {
    m_qr.swap(*rows);
    computeInPlace();
  }
  MatrixXd r() const { return m_qr.topRows(m_qr.cols()).triangularView<Eigen::Upper>(); }
};

} // namespace

MatrixXd triangle_of(MatrixXd* rows) {
  return QrInPlace(rows).r();
}

PivotedQr::PivotedQr(const MatrixXd& a, double threshold) {
  auto qr = std::make_shared<Eigen::ColPivHouseholderQR<MatrixXd>>(a);
  qr->setThreshold(threshold);
  qr_ = std::move(qr);
}

long PivotedQr::rank() const {
  return qr_->rank();
}

VectorXd PivotedQr::solve(const VectorXd& b) const {
  return qr_->solve(b);
}

MatrixXd PivotedQr::q() const {
  return qr_->householderQ() * MatrixXd(MatrixXd::Identity(qr_->rows(), qr_->cols()));
}

MatrixXd PivotedQr::r_solve(const MatrixXd& b) const {
  MatrixXd out = b;
  qr_->matrixQR().topLeftCorner(b.rows(), b.rows()).triangularView<Eigen::Upper>().solveInPlace(out);
  return out;
}

MatrixXd PivotedQr::r_inverse() const {
  return r_solve(MatrixXd::Identity(rank(), rank()));
}

double PivotedQr::log_abs_r(long i) const {
  return std::log(std::fabs(qr_->matrixQR()(i, i)));
}

MatrixXd PivotedQr::permuted(const MatrixXd& b) const {
  return qr_->colsPermutation() * b;
}

VectorXd PivotedQr::permuted(const VectorXd& b) const {
  return qr_->colsPermutation() * b;
}

} // namespace imucal
