// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <limits>

#include "analysis/fit/parts.h"
#include "base/error.h"
#include "base/median.h"
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

// Of the residuals' own spread, slow noise in it; the core's gate has 6 standard deviations of what a filter does not foresee.
constexpr double kFarOff = 8;
constexpr int kMostRounds = 10;

std::vector<int> steps_of(const std::vector<long>& second) {
  std::vector<int> steps(second.size(), 1);
  for (size_t k = 1; k < second.size(); ++k) steps[k] = static_cast<int>(second[k] - second[k - 1]);
  return steps;
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

// Q' C Q, C the covariance of the noise; runs are independent.
Eigen::MatrixXd projected_noise(const Eigen::MatrixXd& q, const Design& d, const NoiseModel& noise, double dt_s) {
  Eigen::MatrixXd cq = Eigen::MatrixXd::Zero(q.rows(), q.cols());
  Eigen::Index at = 0;
  for (const auto& list : d.seconds) {
    const auto len = static_cast<Eigen::Index>(list.size());
    const std::vector<int> steps = steps_of(list);
    for (Eigen::Index c = 0; c < q.cols(); ++c)
      cq.col(c).segment(at, len) =
          covariance_times({steps.size(), steps.data(), dt_s}, noise, q.col(c).segment(at, len));
    at += len;
  }
  return q.transpose() * cq;
}

// Q' C Q and the mean square that the noise leaves beside the columns, (tr C - tr Q' C Q)/n, as it is believed.
struct Projected {
  Eigen::MatrixXd noise;
  double residual_dph2 = 0;
};

Projected project(const PivotedQr& qr, const Design& d, const NoiseBelief& belief, double dt_s) {
  const Eigen::MatrixXd q = qr.q();
  Projected sum{Eigen::MatrixXd::Zero(q.cols(), q.cols())};
  double of_rows = 0;
  for (size_t i = 0; i < belief.noise.size(); ++i) {
    const NoiseModel& noise = belief.noise[i];
    sum.noise += belief.weight[i] * projected_noise(q, d, noise, dt_s);
    double row = noise.white_sigma_dph * noise.white_sigma_dph / dt_s;
    for (const Markov& m : noise.markov) row += m.sigma_dph * m.sigma_dph;
    of_rows += belief.weight[i] * row;
  }
  sum.residual_dph2 = std::max(0.0, of_rows - sum.noise.trace() / static_cast<double>(q.rows()));
  return sum;
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

void leave_out_far_off(int order, double t0_degc, double range_degc, bool shared_turn_on, std::vector<FitRun>* runs) {
  for (int round = 0; round < kMostRounds; ++round) {
    const Design design = make_design(*runs, order, t0_degc, range_degc, shared_turn_on);
    const Eigen::VectorXd residual = design.z_dph - design.a * solver_of(design).solve(design.z_dph);
    std::vector<double> sizes(residual.data(), residual.data() + residual.size());
    for (double& size : sizes) size = std::abs(size);
    const double limit = kFarOff * kSigmaOfMedianSize * median(sizes);
    bool is_any = false;
    Eigen::Index row = 0;
    for (size_t l = 0; l < runs->size(); ++l)
      for (const long k : design.seconds[l])
        if (std::abs(residual[row++]) > limit) {
          (*runs)[l].rate_dph[static_cast<size_t>(k)] = std::numeric_limits<double>::quiet_NaN();
          is_any = true;
        }
    if (!is_any) return;
  }
}

NoiseBelief noise_of_residuals(const std::vector<FitRun>& runs, int order, double t0_degc, double range_degc,
                               double dt_s, bool shared_turn_on) {
  const Design design = make_design(runs, order, t0_degc, range_degc, shared_turn_on);
  const Eigen::VectorXd residual = design.z_dph - design.a * solver_of(design).solve(design.z_dph); // digits
  std::vector<ResidualRun> rows;
  Eigen::Index at = 0;
  for (const auto& list : design.seconds) {
    const auto len = static_cast<Eigen::Index>(list.size());
    ResidualRun run{steps_of(list), Eigen::MatrixXd(len, order + 2)};
    run.columns.col(0) = residual.segment(at, len);
    run.columns.col(1).setOnes();
    run.columns.rightCols(order) = design.a.block(at, design.n_constants, len, order);
    rows.push_back(std::move(run));
    at += len;
  }
  return believe_residuals(rows, dt_s, shared_turn_on);
}

ChebyshevFit fit_polynomial_qr(const std::vector<FitRun>& runs, int order, double t0_degc, double range_degc,
                               const NoiseBelief& belief, double dt_s, bool shared_turn_on) {
  const Design design = make_design(runs, order, t0_degc, range_degc, shared_turn_on);
  const PivotedQr qr = solver_of(design);
  const Eigen::VectorXd x = qr.solve(design.z_dph);
  const Eigen::MatrixXd to_mean = mean_of_constants(design.n_constants, order);
  ChebyshevFit fit;
  fit.coeff = to_mean * x;
  const Projected projected = project(qr, design, belief, dt_s);
  fit.covariance = to_mean * covariance_of(qr, projected.noise) * to_mean.transpose();
  fit.expected_residual_dph = std::sqrt(projected.residual_dph2);
  for (Eigen::Index l = 0; l < design.n_constants; ++l) fit.constant.push_back(x[l]);
  return fit;
}

} // namespace imucal
