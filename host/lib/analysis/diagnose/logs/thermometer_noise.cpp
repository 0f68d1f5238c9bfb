// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/thermometer_noise.h"

#include <cmath>

#include "analysis/diagnose/logs/blocks.h"
#include "analysis/diagnose/logs/mean_polynomial.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kSeen_nats = 5;     // of smoothed temperatures over readings
constexpr double kMostChange_sd = 8; // of rates from sample to sample: larger ones are hits and jumps

// Sums over samples that follow each other without a hole, of what the readings put into the rates (x) and the rates (y), from one
// to the next.
struct FollowSums {
  double xx = 0, xy = 0, x2x2 = 0; // x2: second differences, as white noise of the rates enters xy
  double degc2 = 0, dph2 = 0, n = 0;

  void add(const CampaignRun& run, const MeanPolynomial& b, double most_change_dph) {
    const VectorXd read = used_rows(run, {run.input.temp_degc}), smooth = used_rows(run, {run.input.smooth_degc}),
                   of_smooth = b.at(smooth), x = b.at(read) - of_smooth,
                   y = used_rows(run, {run.input.rate_dph}) - of_smooth;
    degc2 += (read - smooth).squaredNorm(), dph2 += x.squaredNorm(), n += static_cast<double>(x.size());
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

} // namespace

std::optional<ThermometerNoise> thermometer_noise(const Campaign& campaign) {
  if (!campaign.has_temperature || campaign.order < 1 || campaign.temp_lsb_degc > 0) return std::nullopt;
  const std::vector<MinuteMeans> means = long_ones(minute_means(campaign));
  const double white_dph = white_between_samples(campaign) / std::sqrt(campaign.dt_s);
  if (means.empty() || !(white_dph > 0)) return std::nullopt;
  const MeanPolynomial polynomial(means, campaign.order);
  FollowSums sums;
  for (const CampaignRun& run : campaign.runs) sums.add(run, polynomial, kMostChange_sd * std::sqrt(2.0) * white_dph);
  if (!(sums.xx > 0)) return std::nullopt;
  const double c = sums.xy / sums.xx, variance = white_dph * white_dph * sums.x2x2 / (sums.xx * sums.xx);
  if ((1 - 2 * c) / (2 * variance) < kSeen_nats) return std::nullopt;
  return ThermometerNoise{std::sqrt(sums.degc2 / sums.n), std::sqrt(sums.dph2 / sums.n), white_dph};
}

void take_smoothed(Campaign* campaign) {
  for (CampaignRun& run : campaign->runs) run.input.tn = normalised(run.input, run.input.smooth_degc);
}

} // namespace imucal
