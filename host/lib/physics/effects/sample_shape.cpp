// SPDX-License-Identifier: MIT
#include "physics/effects/sample_shape.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/quantile.h"

namespace imucal {

namespace {

constexpr size_t kHalfWindow = 20;  // rows on either side
constexpr size_t kMoreOften = 5;    // than any other value: no step of a lattice
constexpr double kFar_sigma = 5;    // once in 1.7 million normal samples
constexpr double kSameRate = 1e-12; // relative: rounding of doubles and of short sums of them, far below any digit

// Medians of the finite values within kHalfWindow rows; NaN where `x` is NaN.
std::vector<double> running_median(const std::vector<double>& x) {
  std::vector<double> sorted, out(x.size(), std::nan(""));
  const auto place = [&](double v) { return std::lower_bound(sorted.begin(), sorted.end(), v); };
  for (size_t i = 0, next = 0; i < x.size(); ++i) {
    for (; next < x.size() && next <= i + kHalfWindow; ++next)
      if (std::isfinite(x[next])) sorted.insert(place(x[next]), x[next]);
    if (i > kHalfWindow && std::isfinite(x[i - kHalfWindow - 1])) sorted.erase(place(x[i - kHalfWindow - 1]));
    if (std::isfinite(x[i])) out[i] = sorted[sorted.size() / 2];
  }
  return out;
}

// The value that is found most often, and how often.
std::pair<double, size_t> most_common(std::vector<double> values) {
  std::pair<double, size_t> most = {0, 0};
  const auto all = values_with_counts(std::move(values));
  for (const auto& found : all)
    if (found.second > most.second) most = found;
  return most;
}

// From the jumps between successive samples that differ: repeats say nothing about noise, and neither do
// jumps to a value that many samples share, which may be far away.
double robust_sigma(const std::vector<RunInput>& runs) {
  std::vector<double> jumps;
  const auto [shared, n_shared] = most_common(finite_rates(runs));
  const bool is_lattice = n_shared < kMoreOften * most_common_other(runs, shared);
  const auto is_left_out = [&, value = shared](double y) { return !is_lattice && is_same_rate(y, value); };
  for (const RunInput& run : runs)
    for (size_t i = 1; i < run.rate_dph.size(); ++i) {
      const double now = run.rate_dph[i], before = run.rate_dph[i - 1], jump = std::fabs(now - before);
      if (std::isfinite(jump) && jump > 0 && !is_left_out(now) && !is_left_out(before)) jumps.push_back(jump);
    }
  if (jumps.empty()) return 0;
  const auto middle = jumps.begin() + static_cast<long>(jumps.size() / 2);
  std::nth_element(jumps.begin(), middle, jumps.end());
  return *middle / kMedianJump;
}

} // namespace

LocalLevels local_levels(const std::vector<RunInput>& runs) {
  LocalLevels out;
  for (const RunInput& run : runs) out.level_dph.push_back(running_median(run.rate_dph));
  out.sigma_dph = robust_sigma(runs);
  return out;
}

double expected_between(const LocalLevels& levels, double lo, double hi) {
  if (!(levels.sigma_dph > 0)) return 0;
  double sum = 0;
  for (const auto& run : levels.level_dph)
    for (const double level : run)
      if (std::isfinite(level))
        sum += normal_cdf((hi - level) / levels.sigma_dph) - normal_cdf((lo - level) / levels.sigma_dph);
  return sum;
}

bool is_same_rate(double a, double b) {
  return std::fabs(a - b) <= kSameRate * std::max(std::fabs(a), std::fabs(b));
}

std::vector<double> finite_rates(const RunInput& run) {
  std::vector<double> rates;
  for (const double y : run.rate_dph)
    if (std::isfinite(y)) rates.push_back(y);
  return rates;
}
std::vector<double> finite_rates(const std::vector<RunInput>& runs) {
  std::vector<double> rates;
  for (const RunInput& run : runs) {
    const std::vector<double> own = finite_rates(run);
    rates.insert(rates.end(), own.begin(), own.end());
  }
  return rates;
}

std::vector<std::pair<double, size_t>> values_with_counts(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  std::vector<std::pair<double, size_t>> out;
  for (const double value : values) {
    if (out.empty() || !is_same_rate(value, out.back().first)) out.push_back({value, 0});
    ++out.back().second;
  }
  return out;
}

size_t count_at(const RunInput& run, double value) {
  size_t n = 0;
  for (const double y : run.rate_dph) n += is_same_rate(y, value);
  return n;
}
size_t count_at(const std::vector<RunInput>& runs, double value) {
  size_t n = 0;
  for (const RunInput& run : runs) n += count_at(run, value);
  return n;
}

size_t count_far_at(const std::vector<RunInput>& runs, const LocalLevels& levels, double value) {
  size_t n = 0;
  for (size_t r = 0; r < runs.size(); ++r)
    for (size_t i = 0; i < runs[r].rate_dph.size(); ++i)
      n += is_same_rate(runs[r].rate_dph[i], value) &&
           std::fabs(levels.level_dph[r][i] - value) > kFar_sigma * levels.sigma_dph;
  return n;
}

size_t most_common_other(const std::vector<RunInput>& runs, double value) {
  std::vector<double> others;
  for (const RunInput& run : runs)
    for (const double y : run.rate_dph)
      if (std::isfinite(y) && !is_same_rate(y, value)) others.push_back(y);
  return most_common(std::move(others)).second;
}

std::vector<std::vector<char>> samples_at(const std::vector<RunInput>& runs, double value) {
  std::vector<std::vector<char>> out;
  for (const RunInput& run : runs) {
    std::vector<char> is_at(run.size(), 0);
    for (size_t i = 0; i < is_at.size(); ++i) is_at[i] = is_same_rate(run.rate_dph[i], value);
    out.push_back(is_at);
  }
  return out;
}

} // namespace imucal
