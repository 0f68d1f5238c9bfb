// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/reference.h"

#include <Eigen/Core>
#include <cmath>

namespace imucal {

ReferenceFilter reference_filter(const ChainSetup& setup, const std::vector<SecondMean>& seconds) {
  // The parameters as the core has them: rounded to float32 once.
  const imucal_kf_config_t config = filter_config(setup);
  const int p = setup.order + 1, n = p + 1; // states b0 … bM, e
  const double r = static_cast<double>(config.r), q1 = static_cast<double>(config.q);
  const double phi1 = 1.0 - static_cast<double>(config.m);
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n), h(n), gain(n);
  Eigen::MatrixXd cov = Eigen::MatrixXd::Zero(n, n);
  const double prior = static_cast<double>(config.prior_sigma);
  for (int i = 0; i < p; ++i) cov(i, i) = prior * prior;
  cov(p, p) = static_cast<double>(config.markov_variance);
  for (const SecondMean& s : seconds) {
    double phi = phi1, q = q1;
    for (uint32_t k = 0; k < s.gap_s; ++k) { // composed step by step: phi and q of the whole gap
      q = q1 + phi1 * phi1 * q;
      phi *= phi1;
    }
    x(p) *= phi;
    cov.row(p) *= phi;
    cov.col(p) *= phi;
    cov(p, p) += q;
    const double tn = (static_cast<double>(s.temp_degc) - static_cast<double>(config.t0_degc)) /
                      static_cast<double>(config.range_degc);
    double power = 1;
    for (int i = 0; i < p; ++i, power *= tn) h(i) = power;
    h(p) = 1;
    gain.noalias() = cov * h;
    const double innovation_variance = h.dot(gain) + r * static_cast<double>(s.noise_ratio);
    x += gain * ((static_cast<double>(s.z_dph) - h.dot(x)) / innovation_variance);
    cov.noalias() -= gain * gain.transpose() / innovation_variance;
  }
  ReferenceFilter out;
  for (int i = 0; i < p; ++i) {
    out.coeff_dph.push_back(x(i));
    for (int j = 0; j < p; ++j) out.covariance_dph2.push_back(0.5 * (cov(i, j) + cov(j, i)));
  }
  return out;
}

double bias_dph(const std::vector<double>& coeff_dph, double tn) {
  double sum = 0;
  for (size_t i = coeff_dph.size(); i-- > 0;) sum = sum * tn + coeff_dph[i];
  return sum;
}

double bias_variance_dph2(const std::vector<double>& covariance_dph2, double tn) {
  size_t p = 1;
  while (p * p < covariance_dph2.size()) ++p;
  double sum = 0, power_i = 1;
  for (size_t i = 0; i < p; ++i, power_i *= tn) {
    double power_j = 1;
    for (size_t j = 0; j < p; ++j, power_j *= tn) sum += power_i * covariance_dph2[i * p + j] * power_j;
  }
  return sum;
}

} // namespace imucal
