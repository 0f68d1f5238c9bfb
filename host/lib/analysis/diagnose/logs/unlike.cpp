// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/unlike.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "analysis/diagnose/logs/blocks.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kMean_s = 60;
constexpr double kLeastCommon_degc = 20;
constexpr size_t kFewestRuns = 3;
constexpr long kFewestMeans = 20;                 // of a run
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

// Means over a minute.
struct Means {
  VectorXd temp_degc, rate_dph;
};
std::vector<Means> means_of(const Campaign& campaign) {
  const Campaign means = block_means(campaign, kMean_s);
  std::vector<Means> out;
  for (const CampaignRun& run : means.runs)
    out.push_back({used_rows(run, {run.input.smooth_degc}), used_rows(run, {run.input.rate_dph})});
  return out;
}

// The polynomial of some logs, each with its own constant, and what it leaves of them.
class Polynomial {
public:
  Polynomial(const std::vector<Means>& logs, int order) : order_(order) {
    double lo = 1e300, hi = -1e300;
    long n = 0;
    for (const Means& m : logs)
      lo = std::min(lo, m.temp_degc.minCoeff()), hi = std::max(hi, m.temp_degc.maxCoeff()), n += m.rate_dph.size();
    middle_degc_ = 0.5 * (lo + hi), half_degc_ = std::max(1e-9, 0.5 * (hi - lo));
    MatrixXd x(n, order);
    VectorXd y(n);
    long first = 0;
    for (const Means& m : logs) {
      const long size = m.rate_dph.size();
      x.middleRows(first, size) = about_mean(powers_at(m.temp_degc));
      y.segment(first, size) = m.rate_dph.array() - m.rate_dph.mean();
      first += size;
    }
    coefficients_ = x.colPivHouseholderQr().solve(y);
    rms_dph_ = std::sqrt((y - x * coefficients_).squaredNorm() / static_cast<double>(n));
  }
  double rms_dph() const { return rms_dph_; }
  // What it has of temperatures in common with another log, once the slip is taken back.
  double common_degc(const Means& m, const Slip& slip) const {
    const double lo = slip.zero_degc + slip.degc_per_unit * m.temp_degc.minCoeff(),
                 hi = slip.zero_degc + slip.degc_per_unit * m.temp_degc.maxCoeff();
    return std::min(hi, middle_degc_ + half_degc_) - std::max(lo, middle_degc_ - half_degc_);
  }
  // What it leaves of another log, once the slip is taken back.
  double rms_of_dph(const Means& m, const Slip& slip) const {
    const VectorXd temp = (slip.zero_degc + slip.degc_per_unit * m.temp_degc.array()).matrix();
    const VectorXd rate = slip.sign * (m.rate_dph.array() - m.rate_dph.mean()).matrix();
    return std::sqrt((rate - about_mean(powers_at(temp)) * coefficients_).squaredNorm() /
                     static_cast<double>(rate.size()));
  }

private:
  MatrixXd powers_at(const VectorXd& temp_degc) const {
    MatrixXd out(temp_degc.size(), order_);
    for (int i = 0; i < order_; ++i) out.col(i) = ((temp_degc.array() - middle_degc_) / half_degc_).pow(i + 1);
    return out;
  }
  static MatrixXd about_mean(const MatrixXd& x) { return x.rowwise() - x.colwise().mean(); }

  int order_;
  double middle_degc_, half_degc_, rms_dph_;
  VectorXd coefficients_;
};

std::string why_unlike(const Polynomial& others, const Means& log) {
  if (log.rate_dph.size() < kFewestMeans) return "";
  const double left_dph = others.rms_dph();
  if (others.rms_of_dph(log, kNone) < kFarTimes * left_dph) return "";
  // A soak agrees with any polynomial, and a polynomial says little beyond what it was fitted to.
  const auto takes_back = [&](const Slip& slip) {
    return others.common_degc(log, slip) > kLeastCommon_degc && others.rms_of_dph(log, slip) < kLikeTimes * left_dph;
  };
  const auto slip = std::find_if(std::begin(kSlips), std::end(kSlips), takes_back);
  return slip == std::end(kSlips) ? "" : slip->what;
}

// Those that are long enough to say something of a polynomial.
std::vector<Means> long_ones(std::vector<Means> logs) {
  logs.erase(std::remove_if(logs.begin(), logs.end(), [](const Means& m) { return m.rate_dph.size() < kFewestMeans; }),
             logs.end());
  return logs;
}

} // namespace

std::vector<std::string> unlike_others(const Campaign& campaign) {
  std::vector<std::string> out(campaign.runs.size());
  if (campaign.runs.size() < kFewestRuns || campaign.order < 1) return out;
  const std::vector<Means> all = means_of(campaign);
  for (size_t r = 0; r < all.size(); ++r) {
    std::vector<Means> others = all;
    others.erase(others.begin() + static_cast<long>(r));
    others = long_ones(others);
    if (others.size() + 1 >= kFewestRuns) out[r] = why_unlike(Polynomial(others, campaign.order), all[r]);
  }
  return out;
}

std::vector<std::string> unlike_those_of(const Campaign& campaign, const Campaign& other) {
  std::vector<std::string> out(other.runs.size());
  const std::vector<Means> others = long_ones(means_of(campaign));
  if (others.empty() || campaign.order < 1) return out;
  const Polynomial polynomial(others, campaign.order);
  const std::vector<Means> all = means_of(other);
  for (size_t r = 0; r < out.size(); ++r) out[r] = why_unlike(polynomial, all[r]);
  return out;
}

} // namespace imucal
