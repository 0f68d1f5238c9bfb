// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "analysis/fit/parts.h"
#include "base/error.h"
#include "noise/covariance.h"

namespace imucal {

Eigen::VectorXd chebyshev_row(int order, double x) {
  Eigen::VectorXd row(order + 1);
  row[0] = 1;
  if (order > 0) row[1] = x;
  for (int k = 2; k <= order; ++k) row[k] = 2 * x * row[k - 1] - row[k - 2];
  return row;
}

Eigen::MatrixXd power_from_chebyshev(int order) {
  Eigen::MatrixXd c = Eigen::MatrixXd::Zero(order + 1, order + 1);
  c(0, 0) = 1;
  if (order > 0) c(1, 1) = 1;
  for (int k = 2; k <= order; ++k)
    for (int i = 0; i <= k; ++i) c(i, k) = (i > 0 ? 2 * c(i - 1, k - 1) : 0.0) - c(i, k - 2);
  return c;
}

namespace {

std::vector<int> steps_of(const std::vector<long>& second) {
  std::vector<int> steps(second.size(), 1);
  for (size_t k = 1; k < second.size(); ++k) steps[k] = static_cast<int>(second[k] - second[k - 1]);
  return steps;
}

// Density of the residuals at low frequency per second: length of a batch times the variance of batch means.
double batch_variance(const std::vector<Eigen::VectorXd>& residuals) {
  double sum = 0;
  long n_batches = 0;
  for (const Eigen::VectorXd& r : residuals) {
    const Eigen::Index length = std::max<Eigen::Index>(1, r.size() / 30);
    for (Eigen::Index at = 0; at + length <= r.size(); at += length, ++n_batches) {
      const double mean = r.segment(at, length).mean();
      sum += mean * mean * static_cast<double>(length);
    }
  }
  return n_batches > 0 ? sum / static_cast<double>(n_batches) : 0;
}

} // namespace

ChebyshevFit fit_polynomial_qr(const std::vector<FitRun>& runs, int order, double t0_degc, double range_degc,
                               const ErrorModel* model, double dt_s, bool shared_turn_on) {
  const Eigen::Index n_constants = shared_turn_on ? 1 : static_cast<Eigen::Index>(runs.size());
  const Eigen::Index p = n_constants + order;
  std::vector<std::vector<long>> seconds(runs.size());
  Eigen::Index n = 0;
  for (size_t l = 0; l < runs.size(); ++l) {
    for (size_t k = 0; k < runs[l].rate_dph.size(); ++k)
      if (std::isfinite(runs[l].rate_dph[k])) seconds[l].push_back(static_cast<long>(k));
    n += static_cast<Eigen::Index>(seconds[l].size());
  }
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, p);
  Eigen::VectorXd z(n);
  Eigen::Index row = 0;
  for (size_t l = 0; l < runs.size(); ++l)
    for (const long k : seconds[l]) {
      const auto at = static_cast<size_t>(k);
      a(row, shared_turn_on ? 0 : static_cast<Eigen::Index>(l)) = 1;
      a.row(row).tail(order) =
          chebyshev_row(order, (runs[l].temp_degc[at] - t0_degc) / range_degc).tail(order).transpose();
      z[row++] = runs[l].rate_dph[at];
    }
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(a);
  qr.setThreshold(1e-9); // columns are of size 1: below this the logs do not tell them apart
  if (n < p || qr.rank() < p)
    throw data_error("the logs do not determine " + std::to_string(p) + " coefficients (rank " +
                     std::to_string(qr.rank()) + "): record a wider temperature span or lower --order");
  const Eigen::VectorXd x = qr.solve(z);
  const Eigen::VectorXd residual = z - a * x;
  const Eigen::MatrixXd q = qr.householderQ() * Eigen::MatrixXd::Identity(n, p);

  // cov x = (A'A)^-1 A' C A (A'A)^-1 = Pi R^-1 (Q' C Q) R^-T Pi'
  Eigen::MatrixXd middle;
  ChebyshevFit fit;
  if (model != nullptr) {
    Eigen::MatrixXd cq = Eigen::MatrixXd::Zero(n, p);
    Eigen::Index at = 0;
    for (const auto& list : seconds) {
      const auto len = static_cast<Eigen::Index>(list.size());
      const std::vector<int> steps = steps_of(list);
      for (Eigen::Index c = 0; c < p; ++c)
        cq.col(c).segment(at, len) =
            covariance_times({steps.size(), steps.data(), dt_s}, noise_of(*model), q.col(c).segment(at, len));
      at += len;
    }
    middle = q.transpose() * cq;
    fit.sigma_basis = "model";
  } else {
    std::vector<Eigen::VectorXd> residuals;
    Eigen::Index at = 0;
    for (const auto& list : seconds) {
      residuals.emplace_back(residual.segment(at, static_cast<Eigen::Index>(list.size())));
      at += static_cast<Eigen::Index>(list.size());
    }
    middle = batch_variance(residuals) * Eigen::MatrixXd::Identity(p, p);
    fit.sigma_basis = "residuals";
  }
  const auto r = qr.matrixR().topLeftCorner(p, p).triangularView<Eigen::Upper>();
  const Eigen::MatrixXd half = r.solve(middle);
  Eigen::MatrixXd covariance = r.solve(half.transpose());
  covariance = qr.colsPermutation() * covariance * qr.colsPermutation().transpose();

  Eigen::MatrixXd to_mean = Eigen::MatrixXd::Zero(order + 1, p);
  to_mean.row(0).head(n_constants).setConstant(1.0 / static_cast<double>(n_constants));
  to_mean.bottomRightCorner(order, order).setIdentity();
  fit.coeff = to_mean * x;
  fit.covariance = to_mean * covariance * to_mean.transpose();
  for (Eigen::Index l = 0; l < n_constants; ++l) fit.constant.push_back(x[l]);
  return fit;
}

} // namespace imucal
