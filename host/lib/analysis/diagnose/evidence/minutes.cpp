// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/minutes.h"

#include <algorithm>
#include <cmath>

namespace imucal {

using Eigen::VectorXd;

namespace {

constexpr double kHardlyReturns = 20; // time constant over the length of a stretch

// A random walk over a stretch as a Markov process that hardly returns within it.
NoiseModel without_walk(NoiseModel noise, double length_s) {
  const double tau_s = kHardlyReturns * length_s;
  if (noise.walk_dph_per_rt_s > 0) noise.markov.push_back({noise.walk_dph_per_rt_s * std::sqrt(0.5 * tau_s), tau_s});
  noise.walk_dph_per_rt_s = 0;
  return noise;
}
// Variance of that mean square over a stretch: 2/n^2 times the sum of the squared covariances of all minutes (Isserlis).
double spread_of_minutes(const NoiseModel& noise, double minute_s, double length_s) {
  const double length = std::max(length_s, 2 * minute_s), n = length / minute_s;
  const NoiseModel stationary = without_walk(noise, length);
  double of_mean = stationary.white_sigma_dph * stationary.white_sigma_dph / length;
  for (const Markov& m : stationary.markov) of_mean += m.sigma_dph * m.sigma_dph * variance_of_mean(length / m.tau_s);
  double sum = 0.5 * std::pow(noise_of_minutes(noise, minute_s, length), 2);
  for (double k = 1; k < n; ++k) {
    double covariance = -of_mean;
    for (const Markov& m : stationary.markov) {
      const double part = -std::expm1(-minute_s / m.tau_s) * m.tau_s / minute_s;
      covariance += m.sigma_dph * m.sigma_dph * part * part * std::exp(-(k - 1) * minute_s / m.tau_s);
    }
    sum += (1 - k / n) * covariance * covariance;
  }
  return 4 * sum / n;
}
NoiseModel noise_of(NoiseModel noise, const Minutes& stretch) {
  noise.extra_white_dph2 += stretch.own_white_dph2;
  return noise;
}

} // namespace

long rows_of_minute(double dt_s) {
  return std::max(1L, std::lround(60 / dt_s));
}
double minute_s(double dt_s) {
  return dt_s * static_cast<double>(rows_of_minute(dt_s));
}

void add_minutes(const VectorXd& rest, double dt_s, Minutes* to) {
  const long minute = rows_of_minute(dt_s);
  for (long k = 0; k + minute <= rest.size(); k += minute)
    to->sum += std::pow(rest.segment(k, minute).mean(), 2), to->n += 1;
}
Minutes minutes_of(VectorXd rest, double dt_s) {
  Minutes out;
  if (rest.size() > 0) rest.array() -= rest.mean();
  add_minutes(rest, dt_s, &out);
  return out;
}
double mean_square(const std::vector<Minutes>& rest) {
  double sum = 0, n = 0;
  for (const Minutes& m : rest) sum += m.sum, n += m.n;
  return n > 0 ? sum / n : 0;
}

double noise_of_minutes(const NoiseModel& noise, double minute_s, double length_s) {
  const double length = std::max(length_s, 2 * minute_s);
  const double white = noise.white_sigma_dph * noise.white_sigma_dph + noise.extra_white_dph2;
  double sum = white * (1 / minute_s - 1 / length);
  for (const Markov& m : noise.markov)
    sum += m.sigma_dph * m.sigma_dph * (variance_of_mean(minute_s / m.tau_s) - variance_of_mean(length / m.tau_s));
  const double walk = noise.walk_dph_per_rt_s;
  return sum + walk * walk * (length - minute_s) / 6;
}
double noise_of_all(const NoiseModel& noise, double minute_s, const std::vector<Minutes>& rest) {
  double sum = 0, n = 0;
  for (const Minutes& m : rest)
    sum += m.n * std::pow(m.strength, 2) * noise_of_minutes(noise_of(noise, m), minute_s, m.n * minute_s), n += m.n;
  return n > 0 ? sum / n : 0;
}
double error_of_minutes(const NoiseModel& noise, double minute_s, const std::vector<Minutes>& rest) {
  double variance = 0, n = 0;
  for (const Minutes& m : rest) {
    const double weight = m.n * std::pow(m.strength, 2);
    variance += weight * weight * spread_of_minutes(noise_of(noise, m), minute_s, m.n * minute_s), n += m.n;
  }
  return n > 0 ? std::sqrt(variance) / n : 0;
}

} // namespace imucal
