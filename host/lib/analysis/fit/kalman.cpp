// SPDX-License-Identifier: MIT
#include <cmath>

#include "analysis/fit/parts.h"
#include "base/error.h"
#include "learn.h"

namespace imucal {

namespace {

// Runs one log through the core as the device would: the seconds without a row are a gap before the next row.
void run_log(const FitRun& run, imucal_learn_t* learn) {
  uint32_t gap_s = 0;
  for (size_t k = 0; k < run.rate_dph.size(); ++k) {
    if (!run.has_row[k]) {
      ++gap_s;
      continue;
    }
    const imucal_learn_input_t input = {static_cast<float>(run.rate_dph[k]), static_cast<float>(run.temp_degc[k]),
                                        run.noise_ratio[k], gap_s,
                                        std::isfinite(run.rate_dph[k]) ? IMUCAL_LEARN_USED : IMUCAL_LEARN_MISSING};
    imucal_learn_take(learn, &input);
    gap_s = 0;
  }
}

} // namespace

ChebyshevFit fit_kalman(const std::vector<FitRun>& runs, const imucal_kf_config_t& config, bool shared_turn_on) {
  imucal_learn_t learn;
  const imucal_kf_t& kf = learn.kf;
  const imucal_status status = imucal_learn_init(&learn, &config);
  if (status != IMUCAL_OK)
    throw data_error(std::string("the filter refuses its configuration: ") + imucal_status_text(status));
  ChebyshevFit fit;
  fit.sigma_basis = "filter";
  std::vector<Factors> ends; // row 0 of each: the log's constant given the other coefficients
  for (size_t l = 0; l < runs.size(); ++l) {
    if (l > 0 && imucal_kf_new_run(&learn.kf, shared_turn_on ? 0.0F : config.prior_sigma) != IMUCAL_OK)
      throw data_error("the filter refuses a new run");
    run_log(runs[l], &learn);
    if (!shared_turn_on || l + 1 == runs.size()) ends.push_back(factors_of(kf));
  }
  fit.n_refused = static_cast<long>(learn.n[IMUCAL_LEARN_REFUSED]);
  const Factors last = factors_of(kf).without_constant();
  const Eigen::VectorXd rest = last.coeff();
  const Eigen::MatrixXd cov_rest = last.covariance();
  const int m = config.order;
  const auto n = static_cast<double>(ends.size());
  Eigen::RowVectorXd slope = Eigen::RowVectorXd::Zero(m);
  double mean = 0, variance = 0;
  for (const Factors& end : ends) {
    const Eigen::RowVectorXd slope_here = -end.r.block(0, 1, 1, m);
    const double value = end.x[0] + slope_here.dot(rest);
    fit.constant.push_back(value);
    mean += value / n;
    slope += slope_here / n;
    variance += 1 / end.d[0] / (n * n);
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

} // namespace imucal
