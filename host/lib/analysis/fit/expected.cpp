// SPDX-License-Identifier: MIT
#include "analysis/fit/expected.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "health.h"

namespace imucal {

namespace {

constexpr size_t kBlock = 256; // rows of a block of `slow`, as the core has it
constexpr size_t kBlocks = 32; // beyond so many blocks nothing that a test of hours can judge is correlated
constexpr double kSettled = 1e-12;
constexpr double kZ = IMUCAL_HEALTH_Z;

// The filter in its steady state.
struct Steady {
  double m = 0, gain = 0, s = 1;
};

Steady steady_of(const imucal_kf_config_t& config) {
  const double m = 1 - static_cast<double>(config.m), q = static_cast<double>(config.q),
               r = static_cast<double>(config.r);
  double variance = static_cast<double>(config.markov_variance), before = 0;
  for (int k = 0; k < 10000000 && std::abs(variance - before) > kSettled * (variance + r); ++k) {
    before = variance;
    variance = m * m * variance * r / (variance + r) + q;
  }
  return {m, variance / (variance + r), variance + r};
}

// c(h), h = 0 .. n - 1.
std::vector<double> covariances(const Steady& filter, const NoiseModel& noise, double dt_s, size_t n) {
  const double p = filter.m * (1 - filter.gain), b = filter.m * filter.gain;
  const double white = noise.white_sigma_dph * noise.white_sigma_dph / dt_s;
  std::vector<double> phi, with_innovation; // E s_i nu
  double z = white, s_x = 0;                // E z^2, sum of E s_i x
  for (const Markov& term : noise.markov) {
    phi.push_back(std::exp(-dt_s / term.tau_s));
    const double variance = term.sigma_dph * term.sigma_dph;
    const double cross = phi.back() * b * variance / (1 - phi.back() * p);
    with_innovation.push_back(variance - cross);
    z += variance;
    s_x += cross;
  }
  const double x_x = (2 * p * b * s_x + b * b * z) / (1 - p * p);
  double x = s_x - x_x; // E x nu
  std::vector<double> c = {z + x_x - 2 * s_x};
  for (size_t h = 1; h < n; ++h) {
    double s = 0, next = 0;
    for (size_t i = 0; i < phi.size(); ++i) {
      s += with_innovation[i];
      next += with_innovation[i] *= phi[i];
    }
    x = p * x + b * (s + (h == 1 ? white : 0));
    c.push_back(next - x);
  }
  return c;
}

// Covariance of the sums over two blocks that lie so many blocks apart, over their rows.
double of_blocks(const std::vector<double>& c, size_t apart) {
  double sum = 0;
  for (long u = 1 - static_cast<long>(kBlock); u < static_cast<long>(kBlock); ++u) {
    const auto lag = static_cast<size_t>(std::abs(static_cast<long>(apart * kBlock) + u));
    sum += (1 - static_cast<double>(std::abs(u)) / kBlock) * c[lag];
  }
  return sum;
}

bool is_judged(const FitAxis& axis, uint32_t rule) {
  return (axis.health.judged >> rule & 1U) != 0;
}

void set(uint32_t rule, double value, double limit, bool is_broken, FitAxis* axis) {
  axis->health.value[rule] = static_cast<float>(value);
  axis->health.limit[rule] = static_cast<float>(limit);
  axis->health.bits = (axis->health.bits & ~(1U << rule)) | (is_broken ? 1U << rule : 0U);
}

} // namespace

ExpectedInnovations expected_innovations(const imucal_kf_config_t& filter, const NoiseModel& noise, double dt_s) {
  const Steady steady = steady_of(filter);
  const std::vector<double> c = covariances(steady, noise, dt_s, (kBlocks + 1) * kBlock);
  ExpectedInnovations out;
  out.nis = c[0] / steady.s;
  out.lag1 = c[1] / c[0];
  const double block = of_blocks(c, 0);
  out.slow = block / steady.s;
  out.rejects = std::erfc(std::sqrt(static_cast<double>(IMUCAL_HEALTH_GATE) / out.nis / 2));
  for (size_t h = 1; h < c.size(); ++h) out.nis_spread += 2 * std::pow(c[h] / c[0], 2);
  for (size_t j = 1; j < kBlocks; ++j) out.slow_spread += 2 * std::pow(of_blocks(c, j) / block, 2);
  return out;
}

void judge_by_expected(const ExpectedInnovations& expected, long n, FitAxis* axis) {
  const auto value = [&](uint32_t rule) { return static_cast<double>(axis->health.value[rule]); };
  const auto limit = [&](uint32_t rule) { return static_cast<double>(axis->health.limit[rule]); };
  double ratio = 1;
  if (is_judged(*axis, IMUCAL_HEALTH_NIS)) {
    const double nis = value(IMUCAL_HEALTH_NIS) / expected.nis;
    const double spread = kZ * std::sqrt(2 * expected.nis_spread / std::max(1.0, static_cast<double>(n)));
    const double most = static_cast<double>(IMUCAL_HEALTH_MOST_NIS) * (1 + spread),
                 least = static_cast<double>(IMUCAL_HEALTH_LEAST_NIS) * (1 - spread);
    set(IMUCAL_HEALTH_NIS, nis, nis < 0.5 ? least : most, nis < 0.5 ? nis < least : nis > most, axis);
    ratio = std::max(ratio, nis);
  }
  if (is_judged(*axis, IMUCAL_HEALTH_LAG1)) {
    const double lag1 = value(IMUCAL_HEALTH_LAG1) - expected.lag1, most = std::abs(limit(IMUCAL_HEALTH_LAG1));
    set(IMUCAL_HEALTH_LAG1, lag1, std::copysign(most, lag1), std::abs(lag1) > most, axis);
  }
  if (is_judged(*axis, IMUCAL_HEALTH_SLOW)) {
    const double slow = value(IMUCAL_HEALTH_SLOW) / expected.slow, most = IMUCAL_HEALTH_MOST_SLOW;
    const double wider = most * (1 + (limit(IMUCAL_HEALTH_SLOW) / most - 1) * std::sqrt(expected.slow_spread));
    set(IMUCAL_HEALTH_SLOW, slow, wider, slow > wider, axis);
    ratio = std::max(ratio, slow);
  }
  if (is_judged(*axis, IMUCAL_HEALTH_REJECTS)) {
    const double share = value(IMUCAL_HEALTH_REJECTS), most = limit(IMUCAL_HEALTH_REJECTS) + 2 * expected.rejects;
    set(IMUCAL_HEALTH_REJECTS, share, most, share > most, axis);
  }
  axis->error_factor = std::sqrt(ratio);
}

} // namespace imucal
