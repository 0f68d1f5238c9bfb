// SPDX-License-Identifier: MIT
#include "analysis/errormodel/trend.h"

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/range.h"

namespace imucal {

namespace {

constexpr long kBlocks = 32, kMinBlocks = 12;

// Means of blocks that have at least half of their samples.
Series blocks_of(const Series& s) {
  Series blocks;
  const long length = s.size() / kBlocks;
  for (long b = 0; length > 0 && b < kBlocks; ++b) {
    double rate_dph = 0, temp_degc = 0;
    long n = 0;
    for (long i = b * length; i < (b + 1) * length; ++i) {
      const auto k = static_cast<size_t>(i);
      if (!std::isfinite(s.rate_dph[k]) || !std::isfinite(s.temp_degc[k])) continue;
      rate_dph += s.rate_dph[k];
      temp_degc += s.temp_degc[k];
      ++n;
    }
    if (2 * n < length) continue;
    blocks.rate_dph.push_back(rate_dph / static_cast<double>(n));
    blocks.temp_degc.push_back(temp_degc / static_cast<double>(n));
  }
  return blocks;
}

double sum_of_squares(const std::vector<double>& x) {
  double sum = 0;
  for (double value : x) sum += value * value;
  return sum;
}

// What `detrend` leaves of the blocks; less order where the temperatures cannot tell so many apart.
double left_over(Series blocks, int* order) {
  for (; *order > 0; --*order) {
    try {
      remove_trend({Detrend::Kind::kPolyTemperature, *order}, &blocks);
      break;
    } catch (const Error&) { // of too few temperatures; the blocks are untouched
    }
  }
  if (*order == 0) remove_trend({Detrend::Kind::kMean, 0}, &blocks);
  return sum_of_squares(blocks.rate_dph);
}

} // namespace

double temperature_f(const Series& series) {
  if (series.temp_degc.empty()) return 0;
  const Series blocks = blocks_of(series);
  const long n = blocks.size();
  if (n < kMinBlocks) return 0;
  const auto [lo, hi] = std::minmax_element(blocks.temp_degc.begin(), blocks.temp_degc.end());
  if (*hi - *lo < kMinSpanDegc) return 0;
  int mean = 0, order = 3;
  const double around_mean = left_over(blocks, &mean), left = left_over(blocks, &order);
  if (order == 0) return 0;
  return left > 0 ? (around_mean - left) / order / (left / static_cast<double>(n - 1 - order))
                  : (around_mean > 0 ? 1e300 : 0);
}

} // namespace imucal
