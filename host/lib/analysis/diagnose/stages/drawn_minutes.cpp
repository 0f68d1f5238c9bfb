// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/drawn_minutes.h"

#include <cmath>

#include "analysis/diagnose/evidence/kalman.h"
#include "analysis/diagnose/evidence/minutes.h"
#include "base/rng.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int kDrawn = 200; // a standard deviation by them is known to 5 %

// Means over the whole minutes of a stretch, about their mean.
VectorXd means_of(const VectorXd& rows, double dt_s) {
  const long minute = rows_of_minute(dt_s), n = rows.size() / minute;
  VectorXd out(n);
  for (long m = 0; m < n; ++m) out[m] = rows.segment(m * minute, minute).mean();
  if (n > 0) out.array() -= out.mean();
  return out;
}
// Rows x draws.
MatrixXd draws_of(const CampaignRun& run, const NoiseModel& noise, size_t place) {
  MatrixXd out(static_cast<long>(run.n()), kDrawn);
  const RunGains gains = compute_gains(run, noise);
  for (int d = 0; d < kDrawn; ++d) {
    Rng rng(1, (static_cast<uint64_t>(d) << 16) + place, 0,
            static_cast<Stream>(static_cast<uint32_t>(Stream::kTool) + 9));
    for (long k = 0; k < out.rows(); ++k) out(k, d) = rng.normal();
    colour(gains, out.col(d).data(), run.n());
  }
  return run.own_strength * out;
}

} // namespace

MinutesOfNoise drawn_minutes(const std::vector<HeldOutUnit>& units, const NoiseModel& noise, double dt_s) {
  VectorXd sums = VectorXd::Zero(kDrawn);
  double n = 0;
  for (size_t u = 0; u < units.size(); ++u) {
    const MatrixXd drawn = draws_of(units[u].run, noise, u);
    for (int d = 0; d < kDrawn; ++d) sums[d] += means_of(drawn.col(d), dt_s).squaredNorm();
    n += static_cast<double>(units[u].left.size() / rows_of_minute(dt_s));
  }
  if (n == 0) return {};
  const VectorXd squares = sums / n;
  return {squares.mean(), std::sqrt((squares.array() - squares.mean()).square().sum() / (kDrawn - 1))};
}

double growth_of_minutes(const std::vector<HeldOutUnit>& units, double dt_s) {
  double before = 0, after = 0;
  for (const HeldOutUnit& unit : units) {
    const VectorXd left = means_of(unit.left, dt_s);
    after += left.squaredNorm(), before += (left + means_of(unit.change, dt_s)).squaredNorm();
  }
  return before > 0 ? std::sqrt(after / before) : 1;
}

} // namespace imucal
