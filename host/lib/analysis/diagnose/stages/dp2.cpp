// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/dp2.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/evidence/kalman.h"
#include "base/rng.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

// A residual path as the filter of the nominal model's white noise and first Markov process follows it.
struct FollowedPath {
  VectorXd cumulative; // sum of the samples before k
  VectorXd estimate;   // of sample k, from those before it
};
FollowedPath followed(const VectorXd& x, double phi, double gain) {
  FollowedPath out{VectorXd(x.size() + 1), VectorXd(x.size() + 1)};
  double sum = 0, estimate = 0;
  for (long k = 0; k < x.size(); ++k) {
    out.cumulative[k] = sum, out.estimate[k] = estimate;
    sum += x[k];
    estimate = phi * (estimate + gain * (x[k] - estimate));
  }
  out.cumulative[x.size()] = sum, out.estimate[x.size()] = estimate;
  return out;
}

// DP2 of a residual path: error of the mean over the next n samples, predicted by a filter of the nominal model's white
// noise and first Markov process alone: the same filter for the data and for simulations of both models.
// Each tau is a whole number of steps dt, at least one.
std::vector<double> dp2(const std::vector<VectorXd>& paths, const NoiseModel& nominal, double dt_s,
                        const std::vector<double>& tau_s) {
  constexpr long kStart = 300; // samples until the filter has settled
  const double phi = nominal.markov.empty() ? 0 : nominal.markov[0].phi(dt_s);
  const double q = nominal.markov.empty() ? 0 : nominal.markov[0].q_dph2(dt_s);
  const double r = nominal.white_sigma_dph * nominal.white_sigma_dph / dt_s;
  double p = q / std::max(1e-12, 1 - phi * phi);
  for (int i = 0; i < 5000; ++i) p = phi * phi * p * r / (p + r) + q;
  std::vector<FollowedPath> all;
  for (const VectorXd& x : paths) all.push_back(followed(x, phi, p / (p + r)));
  std::vector<double> out;
  for (double tau : tau_s) {
    const long n = std::lround(tau / dt_s), stride = std::max<long>(1, n / 10);
    double sum = 0, count = 0;
    for (const FollowedPath& path : all)
      for (long k = (kStart / stride + 1) * stride; k + n < path.cumulative.size(); k += stride) {
        const double mean = (path.cumulative[k + n] - path.cumulative[k]) / static_cast<double>(n);
        sum += (mean - path.estimate[k]) * (mean - path.estimate[k]), count += 1;
      }
    out.push_back(count > 0 ? std::sqrt(sum / count / 2) : std::nan(""));
  }
  return out;
}

std::vector<VectorXd> simulated(const Campaign& seconds, const NoiseModel& noise, uint64_t seed, uint64_t draw) {
  std::vector<VectorXd> out;
  const NoiseModel gaussian = gaussian_equivalent(noise);
  for (size_t r = 0; r < seconds.runs.size(); ++r) {
    const Rng rng(seed, draw, static_cast<uint32_t>(r), static_cast<uint32_t>(Stream::kTool) + 9);
    const RunGains gains = compute_gains(seconds.runs[r], gaussian);
    VectorXd x(static_cast<long>(seconds.runs[r].n()));
    rng.normals(0, static_cast<size_t>(x.size()), x.data());
    colour(gains, x.data(), static_cast<size_t>(x.size()));
    out.push_back(std::move(x));
  }
  return out;
}

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0, n = 0;
  for (size_t i = 0; i < a.size(); ++i)
    if (std::isfinite(a[i]) && std::isfinite(b[i])) sum += std::pow(a[i] - b[i], 2), n += 1;
  return n > 0 ? std::sqrt(sum / n) : 0;
}

} // namespace

Dp2Comparison compare_dp2(const Campaign& seconds, const NoiseModel& nominal, const NoiseModel& final,
                          const Fit& before, const Fit& after, uint64_t seed) {
  Dp2Comparison out;
  double shortest = 1e300;
  for (const CampaignRun& run : seconds.runs)
    shortest = std::min(shortest, static_cast<double>(run.n()) * seconds.dt_s);
  for (double tau = std::max(2.0, seconds.dt_s); tau <= shortest / 4; tau *= 1.6) {
    const double whole = seconds.dt_s * std::round(tau / seconds.dt_s);
    if (out.tau_s.empty() || whole > out.tau_s.back()) out.tau_s.push_back(whole);
  }
  const auto curve_of = [&](const NoiseModel& noise) {
    std::vector<double> square(out.tau_s.size(), 0.0);
    constexpr int kDraws = 2;
    for (int d = 0; d < kDraws; ++d) {
      const std::vector<double> c =
          dp2(simulated(seconds, noise, seed, static_cast<uint64_t>(d)), nominal, seconds.dt_s, out.tau_s);
      for (size_t i = 0; i < square.size(); ++i) square[i] += c[i] * c[i] / kDraws;
    }
    for (double& s : square) s = std::sqrt(s);
    return square;
  };
  out.data_dph = dp2(before.residual, nominal, seconds.dt_s, out.tau_s);
  out.left_dph = dp2(after.residual, nominal, seconds.dt_s, out.tau_s);
  out.nominal_dph = curve_of(nominal);
  out.final_dph = final == nominal ? out.nominal_dph : curve_of(final);
  out.before_dph = distance(out.data_dph, out.nominal_dph);
  out.after_dph = distance(out.left_dph, out.final_dph);
  return out;
}

} // namespace imucal
