// SPDX-License-Identifier: MIT
#include <cmath>

#include "base/error.h"
#include "fit/parts.h"

namespace imucal {

namespace {

// The core's state in double: s = [e, c0 .. cM], P = U D U'.
struct Factors {
  Eigen::VectorXd x, d;
  Eigen::MatrixXd u;
};

Factors factors_of(const imucal_kf_t& kf) {
  const int n = kf.config.order + 2;
  Factors f{Eigen::VectorXd(n), Eigen::VectorXd(n), Eigen::MatrixXd::Identity(n, n)};
  for (int j = 0; j < n; ++j) {
    f.x[j] = static_cast<double>(kf.x[j]) + static_cast<double>(kf.x_lo[j]);
    f.d[j] = static_cast<double>(kf.d[j]) + static_cast<double>(kf.d_lo[j]);
    for (int i = 0; i < j; ++i) f.u(i, j) = kf.u[j * (j - 1) / 2 + i];
  }
  return f;
}

// What the end of a log says of its constant: given c1 .. cM, c0 = constant + slope (c1..M - rest) + noise of variance
// `variance`.  Dropping e drops row 0; of the remaining factors the first row is the regression of c0 on the rest.
struct Constant {
  double value, variance;
  Eigen::RowVectorXd slope;
  Eigen::VectorXd rest;
};

Constant constant_of(const Factors& f) {
  const int m = static_cast<int>(f.x.size()) - 2;
  const Eigen::MatrixXd u_rest = f.u.bottomRightCorner(m, m);
  // slope = u_1,rest U_rest^-1
  const Eigen::RowVectorXd slope =
      u_rest.transpose().triangularView<Eigen::UnitLower>().solve(f.u.block(1, 2, 1, m).transpose()).transpose();
  return {f.x[1], f.d[1], slope, f.x.tail(m)};
}

// Runs one log through the core; the first second needs no prediction gap.
void run_log(const FitRun& run, imucal_kf_t* kf, long* n_refused) {
  for (size_t k = 0; k < run.rate_dph.size(); ++k) {
    if (std::isfinite(run.rate_dph[k])) {
      const imucal_status status =
          imucal_kf_update(kf, static_cast<float>(run.rate_dph[k]), static_cast<float>(run.temp_degc[k]));
      if (status == IMUCAL_OK) continue;
      ++*n_refused;
    }
    if (imucal_kf_skip(kf, 1) != IMUCAL_OK) throw data_error("the filter refused to bridge a gap");
  }
}

}  // namespace

ChebyshevFit fit_kalman(const std::vector<FitRun>& runs, const imucal_kf_config_t& config, bool shared_turn_on) {
  imucal_kf_t kf;
  const imucal_status status = imucal_kf_init(&kf, &config);
  if (status != IMUCAL_OK) throw data_error(std::string("the filter refuses its configuration: ") + imucal_status_text(status));
  ChebyshevFit fit;
  fit.sigma_basis = "filter";
  std::vector<Constant> constants;
  for (size_t l = 0; l < runs.size(); ++l) {
    if (l > 0 && imucal_kf_new_run(&kf, shared_turn_on ? 0.0F : config.prior_sigma) != IMUCAL_OK)
      throw data_error("the filter refuses a new run");
    run_log(runs[l], &kf, &fit.n_refused);
    if (!shared_turn_on || l + 1 == runs.size()) constants.push_back(constant_of(factors_of(kf)));
  }
  const Factors f = factors_of(kf);
  const int m = config.order;
  const Eigen::MatrixXd u_rest = f.u.bottomRightCorner(m, m);
  const Eigen::MatrixXd cov_rest = u_rest * f.d.tail(m).asDiagonal() * u_rest.transpose();
  const Eigen::VectorXd rest = f.x.tail(m);
  const auto n = static_cast<double>(constants.size());
  Eigen::RowVectorXd slope = Eigen::RowVectorXd::Zero(m);
  double mean = 0, variance = 0;
  for (const Constant& c : constants) {
    const double value = c.value + c.slope.dot(rest - c.rest);
    fit.constant.push_back(value);
    mean += value / n;
    slope += c.slope / n;
    variance += c.variance / (n * n);
  }
  fit.coeff.resize(m + 1);
  fit.coeff << mean, rest;
  fit.covariance.resize(m + 1, m + 1);
  fit.covariance(0, 0) = variance + (slope * cov_rest * slope.transpose())(0);
  fit.covariance.block(0, 1, 1, m) = slope * cov_rest;
  fit.covariance.block(1, 0, m, 1) = (slope * cov_rest).transpose();
  fit.covariance.bottomRightCorner(m, m) = cov_rest;
  fit.mean_nis = imucal_kf_mean_nis(&kf);
  fit.lag1 = imucal_kf_lag1(&kf);
  if (runs.size() == 1)
    for (int i = 0; i <= m; ++i) fit.core_coeff.push_back(imucal_kf_coefficient(&kf, static_cast<uint32_t>(i)));
  return fit;
}

}  // namespace imucal
