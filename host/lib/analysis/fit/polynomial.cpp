// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "analysis/fit/parts.h"
#include "base/error.h"
#include "linear/linear.h"
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

// The least squares problem z = A x + noise.  x: the constants of the runs, then c1 .. cM.
struct Design {
  std::vector<std::vector<long>> seconds; // of each run: those that have a rate, in the order of the rows
  Eigen::MatrixXd a;
  Eigen::VectorXd z_dph;
  Eigen::Index n_constants = 0;
};

std::vector<std::vector<long>> seconds_with_rate(const std::vector<FitRun>& runs) {
  std::vector<std::vector<long>> seconds(runs.size());
  for (size_t l = 0; l < runs.size(); ++l)
    for (size_t k = 0; k < runs[l].rate_dph.size(); ++k)
      if (std::isfinite(runs[l].rate_dph[k])) seconds[l].push_back(static_cast<long>(k));
  return seconds;
}

Design make_design(const std::vector<FitRun>& runs, int order, double t0_degc, double range_degc, bool shared_turn_on) {
  Design d;
  d.seconds = seconds_with_rate(runs);
  d.n_constants = shared_turn_on ? 1 : static_cast<Eigen::Index>(runs.size());
  Eigen::Index n = 0;
  for (const auto& list : d.seconds) n += static_cast<Eigen::Index>(list.size());
  d.a = Eigen::MatrixXd::Zero(n, d.n_constants + order);
  d.z_dph.resize(n);
  Eigen::Index row = 0;
  for (size_t l = 0; l < runs.size(); ++l)
    for (const long k : d.seconds[l]) {
      const auto at = static_cast<size_t>(k);
      d.a(row, shared_turn_on ? 0 : static_cast<Eigen::Index>(l)) = 1;
      d.a.row(row).tail(order) =
          chebyshev_row(order, (runs[l].temp_degc[at] - t0_degc) / range_degc).tail(order).transpose();
      d.z_dph[row++] = runs[l].rate_dph[at];
    }
  return d;
}

PivotedQr solver_of(const Design& d) {
  PivotedQr qr(d.a, 1e-9); // columns are of size 1: below this the logs do not tell them apart
  if (d.a.rows() < d.a.cols() || qr.rank() < d.a.cols())
    throw data_error("the logs do not determine " + std::to_string(d.a.cols()) + " coefficients (rank " +
                     std::to_string(qr.rank()) + "): record a wider temperature span or lower --order");
  return qr;
}

// Q' C Q, C the covariance of the noise as the model has it; runs are independent.
Eigen::MatrixXd projected_noise(const PivotedQr& qr, const Design& d, const ErrorModel& model, double dt_s) {
  const Eigen::Index n = d.a.rows(), p = d.a.cols();
  const Eigen::MatrixXd q = qr.q();
  Eigen::MatrixXd cq = Eigen::MatrixXd::Zero(n, p);
  Eigen::Index at = 0;
  for (const auto& list : d.seconds) {
    const auto len = static_cast<Eigen::Index>(list.size());
    const std::vector<int> steps = steps_of(list);
    for (Eigen::Index c = 0; c < p; ++c)
      cq.col(c).segment(at, len) =
          covariance_times({steps.size(), steps.data(), dt_s}, noise_of(model), q.col(c).segment(at, len));
    at += len;
  }
  return q.transpose() * cq;
}

// The same from the residuals: as if they were white with the density that they have at low frequency.
Eigen::MatrixXd projected_residuals(const Design& d, const Eigen::VectorXd& x) {
  const Eigen::VectorXd residual = d.z_dph - d.a * x;
  std::vector<Eigen::VectorXd> of_run;
  Eigen::Index at = 0;
  for (const auto& list : d.seconds) {
    of_run.emplace_back(residual.segment(at, static_cast<Eigen::Index>(list.size())));
    at += static_cast<Eigen::Index>(list.size());
  }
  return batch_variance(of_run) * Eigen::MatrixXd::Identity(d.a.cols(), d.a.cols());
}

// cov x = (A'A)^-1 A' C A (A'A)^-1 = Pi R^-1 (Q' C Q) R^-T Pi'; middle: Q' C Q.
Eigen::MatrixXd covariance_of(const PivotedQr& qr, const Eigen::MatrixXd& middle) {
  const Eigen::MatrixXd covariance = qr.r_solve(qr.r_solve(middle).transpose());
  return qr.permuted(Eigen::MatrixXd(qr.permuted(covariance).transpose())).transpose();
}

// c0 is the mean of the runs' constants.
Eigen::MatrixXd mean_of_constants(Eigen::Index n_constants, int order) {
  Eigen::MatrixXd to_mean = Eigen::MatrixXd::Zero(order + 1, n_constants + order);
  to_mean.row(0).head(n_constants).setConstant(1.0 / static_cast<double>(n_constants));
  to_mean.bottomRightCorner(order, order).setIdentity();
  return to_mean;
}

} // namespace

ChebyshevFit fit_polynomial_qr(const std::vector<FitRun>& runs, int order, double t0_degc, double range_degc,
                               const ErrorModel* model, double dt_s, bool shared_turn_on) {
  const Design design = make_design(runs, order, t0_degc, range_degc, shared_turn_on);
  const PivotedQr qr = solver_of(design);
  const Eigen::VectorXd x = qr.solve(design.z_dph);
  const Eigen::MatrixXd middle =
      model != nullptr ? projected_noise(qr, design, *model, dt_s) : projected_residuals(design, x);
  const Eigen::MatrixXd to_mean = mean_of_constants(design.n_constants, order);
  ChebyshevFit fit;
  fit.sigma_basis = model != nullptr ? "model" : "residuals";
  fit.coeff = to_mean * x;
  fit.covariance = to_mean * covariance_of(qr, middle) * to_mean.transpose();
  for (Eigen::Index l = 0; l < design.n_constants; ++l) fit.constant.push_back(x[l]);
  return fit;
}

} // namespace imucal
