// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/mean_polynomial.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "analysis/diagnose/logs/blocks.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kMean_s = 60;
constexpr long kFewestMeans = 20; // of a run

MatrixXd about_mean(const MatrixXd& x) {
  return x.rowwise() - x.colwise().mean();
}

} // namespace

std::vector<MinuteMeans> minute_means(const Campaign& campaign) {
  const Campaign means = block_means(campaign, kMean_s);
  std::vector<MinuteMeans> out;
  for (const CampaignRun& run : means.runs)
    out.push_back({used_rows(run, {run.input.smooth_degc}), used_rows(run, {run.input.rate_dph})});
  return out;
}

bool is_long(const MinuteMeans& means) {
  return means.rate_dph.size() >= kFewestMeans;
}
std::vector<MinuteMeans> long_ones(std::vector<MinuteMeans> runs) {
  runs.erase(std::remove_if(runs.begin(), runs.end(), [](const MinuteMeans& m) { return !is_long(m); }), runs.end());
  return runs;
}

MeanPolynomial::MeanPolynomial(const std::vector<MinuteMeans>& runs, int order) : order_(order) {
  double lo = 1e300, hi = -1e300;
  long n = 0;
  for (const MinuteMeans& m : runs)
    lo = std::min(lo, m.temp_degc.minCoeff()), hi = std::max(hi, m.temp_degc.maxCoeff()), n += m.rate_dph.size();
  middle_degc_ = 0.5 * (lo + hi), half_degc_ = std::max(1e-9, 0.5 * (hi - lo));
  MatrixXd x(n, order);
  VectorXd y(n);
  long first = 0;
  for (const MinuteMeans& m : runs) {
    const long size = m.rate_dph.size();
    x.middleRows(first, size) = about_mean(powers_at(m.temp_degc));
    y.segment(first, size) = m.rate_dph.array() - m.rate_dph.mean();
    first += size;
  }
  coefficients_ = x.colPivHouseholderQr().solve(y);
  rms_dph_ = std::sqrt((y - x * coefficients_).squaredNorm() / static_cast<double>(n));
}

VectorXd MeanPolynomial::at(const VectorXd& temp_degc) const {
  const Eigen::ArrayXd x = (temp_degc.array() - middle_degc_) / half_degc_;
  Eigen::ArrayXd out = Eigen::ArrayXd::Zero(x.size());
  for (long i = order_; i-- > 0;) out = (out + coefficients_[i]) * x; // Horner
  return out.matrix();
}

MatrixXd MeanPolynomial::powers_at(const VectorXd& temp_degc) const {
  MatrixXd out(temp_degc.size(), order_);
  for (int i = 0; i < order_; ++i) out.col(i) = ((temp_degc.array() - middle_degc_) / half_degc_).pow(i + 1);
  return out;
}

} // namespace imucal
