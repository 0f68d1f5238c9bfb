// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/shared.h"

#include <algorithm>
#include <cmath>

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kLocalMean_s = 30;

// Innovations of both axes at the seconds that both use.
void common_rows(const CampaignRun& a, const VectorXd& ea, const CampaignRun& b, const VectorXd& eb, VectorXd* x,
                 VectorXd* y) {
  std::vector<double> left, right;
  const auto time_of = [](const CampaignRun& run, size_t k) { return run.input.t_s[static_cast<size_t>(run.used[k])]; };
  for (size_t i = 0, k = 0; i < a.n(); ++i) {
    while (k < b.n() && time_of(b, k) < time_of(a, i)) ++k;
    if (k == b.n()) break;
    if (time_of(b, k) != time_of(a, i)) continue;
    left.push_back(ea[static_cast<long>(i)]), right.push_back(eb[static_cast<long>(k)]);
  }
  *x = Eigen::Map<VectorXd>(left.data(), static_cast<long>(left.size()));
  *y = Eigen::Map<VectorXd>(right.data(), static_cast<long>(right.size()));
}

void take_off_means(VectorXd* x, long block) {
  for (long k = 0; k < x->size(); k += block) {
    auto part = x->segment(k, std::min(block, x->size() - k));
    part.array() -= part.mean();
  }
}

// Standard deviation of the innovations: geometric mean over all runs.
double innovation_sigma_dph(const AxisRest& axis) {
  double sum = 0, n = 0;
  for (const CampaignRun& run : axis.campaign->runs) {
    sum += compute_gains(run, gaussian_equivalent(axis.noise)).sum_log_s;
    n += static_cast<double>(run.n());
  }
  return n > 0 ? std::exp(0.5 * sum / n) : 0;
}

} // namespace

SharedNoise shared_noise(const AxisRest& a, const AxisRest& b) {
  SharedNoise out;
  double xx = 0, yy = 0, xy = 0, dof = 0;
  const long block = std::max(2L, std::lround(kLocalMean_s / a.campaign->dt_s));
  const std::vector<CampaignRun>&of_a = a.campaign->runs, &of_b = b.campaign->runs;
  for (size_t r = 0, q = 0; r < of_a.size(); ++r) { // an axis may lack a log
    while (q < of_b.size() && of_b[q].input.log < of_a[r].input.log) ++q;
    if (q == of_b.size()) break;
    if (of_b[q].input.log != of_a[r].input.log) continue;
    VectorXd x, y;
    common_rows(of_a[r], a.fit->e[r], of_b[q], b.fit->e[q], &x, &y);
    take_off_means(&x, block), take_off_means(&y, block);
    xx += x.squaredNorm(), yy += y.squaredNorm(), xy += x.dot(y);
    out.n += static_cast<size_t>(x.size());
    dof += static_cast<double>(x.size()) * (1 - 1 / static_cast<double>(block));
  }
  if (!(xx > 0) || !(yy > 0)) return out;
  out.correlation = xy / std::sqrt(xx * yy);
  out.covariance_dph2 = xy / dof * innovation_sigma_dph(a) * innovation_sigma_dph(b);
  out.gain_nats = -0.5 * dof * std::log1p(-std::min(1 - 1e-12, out.correlation * out.correlation));
  return out;
}

} // namespace imucal
