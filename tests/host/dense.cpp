// SPDX-License-Identifier: MIT
#include "dense.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <stdexcept>

using Eigen::MatrixXd;
using Eigen::VectorXd;

static Eigen::LLT<MatrixXd> cholesky(const MatrixXd& a) {
  Eigen::LLT<MatrixXd> llt(a);
  if (llt.info() != Eigen::Success) throw std::invalid_argument("dense.h: the matrix is not positive definite");
  return llt;
}

DenseFactor::DenseFactor(const MatrixXd& a) : lower(cholesky(a).matrixLLT()) {}

MatrixXd DenseFactor::half_solve(const MatrixXd& b) const {
  MatrixXd x = b;
  lower.triangularView<Eigen::Lower>().solveInPlace(x);
  return x;
}

double DenseFactor::log_det() const {
  return 2 * lower.diagonal().array().log().sum();
}

MatrixXd dense_solve(const MatrixXd& a, const MatrixXd& b) {
  MatrixXd x = b;
  cholesky(a).solveInPlace(x);
  return x;
}

MatrixXd dense_inverse(const MatrixXd& a) {
  return dense_solve(a, MatrixXd::Identity(a.rows(), a.cols()));
}

MatrixXd dense_gram(const MatrixXd& x) {
  return x.transpose() * x;
}

MatrixXd dense_sandwich(const MatrixXd& a, const MatrixXd& v) {
  const MatrixXd left = a * v;
  return left * a.transpose();
}

VectorXd dense_least_squares(const MatrixXd& a, const VectorXd& b) {
  return a.colPivHouseholderQr().solve(b);
}
