// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/unlike.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "analysis/diagnose/logs/mean_polynomial.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kLeastCommon_degc = 20;
constexpr size_t kFewestRuns = 3;
constexpr double kFarTimes = 3, kLikeTimes = 1.5; // what the other logs leave

struct Slip {
  double sign, degc_per_unit, zero_degc; // of the rates; temperature = zero + reading * degc_per_unit
  const char* what;
};
constexpr Slip kSlips[] = {
    {-1, 1, 0, "has rates of the other sign than the other logs: turn them, or the axis"},
    {1, 1 / 1.8, -32 / 1.8, "has temperatures that agree with the other logs only if they are in degF: convert them"},
    {1, 1.8, 32, "has temperatures that agree with the other logs only if those are in degF: convert them"},
};
constexpr Slip kNone = {1, 1, 0, ""};

// What of its temperatures another log has in common with these, once the slip is taken back.
double common_degc(const MeanPolynomial& others, const MinuteMeans& m, const Slip& slip) {
  const double lo = slip.zero_degc + slip.degc_per_unit * m.temp_degc.minCoeff(),
               hi = slip.zero_degc + slip.degc_per_unit * m.temp_degc.maxCoeff();
  return std::min(hi, others.hi_degc()) - std::max(lo, others.lo_degc());
}
// What the others' polynomial leaves of another log, once the slip is taken back.
double rms_of_dph(const MeanPolynomial& others, const MinuteMeans& m, const Slip& slip) {
  const VectorXd temp = (slip.zero_degc + slip.degc_per_unit * m.temp_degc.array()).matrix();
  const VectorXd left = slip.sign * m.rate_dph - others.at(temp);
  return std::sqrt((left.array() - left.mean()).square().mean());
}

std::string why_unlike(const MeanPolynomial& others, const MinuteMeans& log) {
  if (!is_long(log)) return "";
  const double left_dph = others.rms_dph();
  if (rms_of_dph(others, log, kNone) < kFarTimes * left_dph) return "";
  // A soak agrees with any polynomial, and a polynomial says little beyond what it was fitted to.
  const auto takes_back = [&](const Slip& slip) {
    return common_degc(others, log, slip) > kLeastCommon_degc && rms_of_dph(others, log, slip) < kLikeTimes * left_dph;
  };
  const auto slip = std::find_if(std::begin(kSlips), std::end(kSlips), takes_back);
  return slip == std::end(kSlips) ? "" : slip->what;
}

} // namespace

std::vector<std::string> unlike_others(const Campaign& campaign) {
  std::vector<std::string> out(campaign.runs.size());
  if (campaign.runs.size() < kFewestRuns || campaign.order < 1) return out;
  const std::vector<MinuteMeans> all = minute_means(campaign);
  for (size_t r = 0; r < all.size(); ++r) {
    std::vector<MinuteMeans> others = all;
    others.erase(others.begin() + static_cast<long>(r));
    others = long_ones(others);
    if (others.size() + 1 >= kFewestRuns) out[r] = why_unlike(MeanPolynomial(others, campaign.order), all[r]);
  }
  return out;
}

std::vector<std::string> unlike_those_of(const Campaign& campaign, const Campaign& other) {
  std::vector<std::string> out(other.runs.size());
  const std::vector<MinuteMeans> others = long_ones(minute_means(campaign));
  if (others.empty() || campaign.order < 1) return out;
  const MeanPolynomial polynomial(others, campaign.order);
  const std::vector<MinuteMeans> all = minute_means(other);
  for (size_t r = 0; r < out.size(); ++r) out[r] = why_unlike(polynomial, all[r]);
  return out;
}

} // namespace imucal
