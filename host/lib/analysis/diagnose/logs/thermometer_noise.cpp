// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/thermometer_noise.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/logs/blocks.h"
#include "analysis/diagnose/logs/mean_polynomial.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kSeen_nats = 5;     // of a part over the readings as they are
constexpr double kMostChange_sd = 8; // of rates from sample to sample: larger ones are hits and jumps

// Sums over samples that follow each other without a hole, of changes from one to the next.
struct FollowSums {
  double xx = 0, xy = 0, x2x2 = 0; // x2: second differences, as white noise of the rates enters xy

  void add(const CampaignRun& run, const VectorXd& x, const VectorXd& y, double most_change_dph) {
    double before = 0; // the change of x that ends at the last sample
    for (long k = 1; k < x.size(); ++k) {
      const double dx = x[k] - x[k - 1], dy = y[k] - y[k - 1];
      const bool is_next = run.steps[static_cast<size_t>(k)] == 1 && std::fabs(dy) <= most_change_dph;
      x2x2 += std::pow((is_next ? dx : 0) - before, 2);
      before = is_next ? dx : 0;
      if (is_next) xx += dx * dx, xy += dx * dy;
    }
    x2x2 += before * before;
  }
};

// Rates in coarse steps are mostly equal to the one before: their noise is that of the rounding at least, whatever most
// differences say.
double smallest_change_dph(const Campaign& campaign) {
  double smallest = 1e300;
  for (const CampaignRun& run : campaign.runs)
    for (const double change : changes_between_samples(run))
      if (change > 0) smallest = std::min(smallest, change);
  return smallest < 1e300 ? smallest : 0;
}

} // namespace

std::optional<ThermometerNoise> thermometer_noise(const Campaign& campaign) {
  if (!campaign.has_temperature || campaign.order < 1 || campaign.temp_lsb_degc > 0) return std::nullopt;
  const std::vector<MinuteMeans> means = long_ones(minute_means(campaign));
  if (means.empty()) return std::nullopt;
  const MeanPolynomial polynomial(means, campaign.order);
  std::vector<VectorXd> x, y; // what the readings put into the rates, and the rates, both less the smooth bias
  double degc2 = 0, dph2 = 0;
  for (const CampaignRun& run : campaign.runs) {
    const VectorXd read = used_rows(run, {run.input.temp_degc}), smooth = used_rows(run, {run.input.smooth_degc}),
                   of_smooth = polynomial.at(smooth);
    x.emplace_back(polynomial.at(read) - of_smooth);
    y.emplace_back(used_rows(run, {run.input.rate_dph}) - of_smooth);
    degc2 += (read - smooth).squaredNorm(), dph2 += x.back().squaredNorm();
  }
  // Of the rates themselves it would hold the bias of a steep sensor, where a row lasts many seconds.
  const double white_dph = white_between_samples(campaign, y) / std::sqrt(campaign.dt_s);
  FollowSums sums;
  for (size_t r = 0; r < y.size(); ++r)
    sums.add(campaign.runs[r], x[r], y[r], kMostChange_sd * std::sqrt(2.0) * white_dph);
  if (!(white_dph > 0) || !(sums.xx > 0)) return std::nullopt;
  const double c = sums.xy / sums.xx, variance = white_dph * white_dph * sums.x2x2 / (sums.xx * sums.xx);
  const double felt = std::clamp(c, 0.0, 1.0), lacks = 1 - felt;
  // Below 0 it is as likely as it is at 0.
  if (lacks * (1 + felt - 2 * c) / (2 * variance) < kSeen_nats) return std::nullopt;
  const auto n = static_cast<double>(campaign.n());
  const double rounding_dph = smallest_change_dph(campaign) / std::sqrt(12.0);
  return ThermometerNoise{felt, lacks * std::sqrt(degc2 / n), lacks * std::sqrt(dph2 / n),
                          std::max(white_dph, rounding_dph)};
}

void take_smoothed(double felt, Campaign* campaign) {
  for (CampaignRun& run : campaign->runs) {
    RunInput& in = run.input;
    for (size_t i = 0; i < in.size(); ++i)
      in.tn[i] = in.normalised(in.smooth_degc[i] + felt * (in.temp_degc[i] - in.smooth_degc[i]));
  }
}

} // namespace imucal
