// SPDX-License-Identifier: MIT
// What the importers ask of all samples of a log (imucal/seconds.py and imucal/still.py), without arrays in between.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace imucal {

// Mean and standard deviation of the samples of one second, in two passes over what the cache holds.
// values: n >= 1 samples of k columns, one sample after the other.  mean, deviation: k values each.  The deviation is
// of a sample (n - 1), 0 for a single one.
inline void spread_of(const double* values, int64_t n, size_t k, double* mean, double* deviation) {
  std::fill(mean, mean + k, 0.0);
  std::fill(deviation, deviation + k, 0.0);
  const double* const end = values + static_cast<size_t>(n) * k;
  for (const double* row = values; row < end; row += k)
    for (size_t c = 0; c < k; ++c) mean[c] += row[c];
  for (size_t c = 0; c < k; ++c) mean[c] /= static_cast<double>(n);
  for (const double* row = values; row < end; row += k)
    for (size_t c = 0; c < k; ++c) deviation[c] += (row[c] - mean[c]) * (row[c] - mean[c]);
  for (size_t c = 0; c < k; ++c)
    deviation[c] = std::sqrt(deviation[c] / static_cast<double>(std::max<int64_t>(n - 1, 1)));
}

namespace seconds_detail {

// Of positive numbers; the mean of the two in the middle where their number is even.
inline double median(std::vector<int64_t>* values) {
  const size_t half = values->size() / 2;
  const auto middle = values->begin() + static_cast<long>(half);
  std::nth_element(values->begin(), middle, values->end());
  if (values->size() % 2 == 1) return static_cast<double>(*middle);
  const int64_t below = *std::max_element(values->begin(), middle);
  return 0.5 * (static_cast<double>(below) + static_cast<double>(*middle));
}

// The same by counting how often each number occurs: most steps of a log are short and of few sizes.
inline double median_of_steps(std::vector<int64_t>* values) {
  constexpr size_t kMost = 1 << 15; // longer ones are counted together
  const size_t half = values->size() / 2;
  std::vector<uint32_t> times(kMost + 1);
  for (const int64_t v : *values) ++times[std::min(static_cast<size_t>(v), kMost)];
  if (values->size() - times[kMost] <= half) return median(values);
  size_t value = 0, passed = times[0];
  const auto advance_to = [&](size_t rank) {
    while (passed <= rank) passed += times[++value];
    return static_cast<double>(value);
  };
  if (values->size() % 2 == 1) return advance_to(half);
  const double below = advance_to(half - 1);
  return 0.5 * (below + advance_to(half));
}

} // namespace seconds_detail

// The median step of n >= 2 times in us, and how many there are in each second that has any.  False, nothing found, where
// the times do not increase or begin before 0.
inline bool find_steps(const int64_t* t_us, size_t n, double* step_us, std::vector<int64_t>* counts) {
  if (t_us[0] < 0) return false;
  std::vector<int64_t> steps(n - 1);
  int64_t second = -1;
  for (size_t i = 0; i < n; ++i) {
    if (t_us[i] / 1000000 != second) counts->push_back(0), second = t_us[i] / 1000000;
    ++counts->back();
    if (i == 0) continue;
    if (t_us[i] <= t_us[i - 1]) return false;
    steps[i - 1] = t_us[i] - t_us[i - 1];
  }
  *step_us = seconds_detail::median_of_steps(&steps);
  return true;
}

// Medians of a centred window of 2 half + 1 of n >= 1 values, `stride` apart; beyond the ends stands the last one.  All finite.
inline void median_of_windows(const double* values, size_t n, size_t stride, size_t half, double* medians) {
  std::vector<double> window;
  const auto value_at = [&](size_t i) { // i is half a window ahead
    return values[std::min(i < half ? 0 : i - half, n - 1) * stride];
  };
  for (size_t i = 0; i <= 2 * half; ++i) window.push_back(value_at(i));
  std::sort(window.begin(), window.end());
  for (size_t i = 0; i < n; ++i) {
    medians[i * stride] = window[half];
    const double gone = value_at(i), come = value_at(i + 2 * half + 1);
    auto at = std::lower_bound(window.begin(), window.end(), gone);
    for (; at + 1 != window.end() && *(at + 1) < come; ++at) *at = *(at + 1);
    for (; at != window.begin() && *(at - 1) > come; --at) *at = *(at - 1);
    *at = come;
  }
}

} // namespace imucal
