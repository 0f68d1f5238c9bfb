// SPDX-License-Identifier: MIT
#include "errormodel/trend.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/error.h"

namespace imucal {

namespace {

constexpr long kBlocks = 32, kMinBlocks = 12;
constexpr double kMinSpanDegc = 0.5;

struct Block {
  double rate_dph = 0, temp_degc = 0;
};

// Means of blocks that have at least half of their samples.
std::vector<Block> blocks_of(const Series& s) {
  std::vector<Block> blocks;
  const long length = s.size() / kBlocks;
  for (long b = 0; length > 0 && b < kBlocks; ++b) {
    Block block;
    long n = 0;
    for (long i = b * length; i < (b + 1) * length; ++i) {
      const auto k = static_cast<size_t>(i);
      if (!std::isfinite(s.rate_dph[k]) || !std::isfinite(s.temp_degc[k])) continue;
      block.rate_dph += s.rate_dph[k];
      block.temp_degc += s.temp_degc[k];
      ++n;
    }
    if (2 * n < length) continue;
    blocks.push_back({block.rate_dph / static_cast<double>(n), block.temp_degc / static_cast<double>(n)});
  }
  return blocks;
}

} // namespace

double temperature_f(const Series& series) {
  if (series.temp_degc.empty()) return 0;
  const std::vector<Block> blocks = blocks_of(series);
  const auto n = static_cast<Eigen::Index>(blocks.size());
  if (n < kMinBlocks) return 0;
  const auto [lo, hi] = std::minmax_element(blocks.begin(), blocks.end(),
                                            [](const Block& a, const Block& b) { return a.temp_degc < b.temp_degc; });
  const double middle = (lo->temp_degc + hi->temp_degc) / 2, half = (hi->temp_degc - lo->temp_degc) / 2;
  if (2 * half < kMinSpanDegc) return 0;
  Eigen::MatrixXd a(n, 4);
  Eigen::VectorXd z(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double x = (blocks[static_cast<size_t>(i)].temp_degc - middle) / half;
    a.row(i) << 1, x, 2 * x * x - 1, (4 * x * x - 3) * x;
    z[i] = blocks[static_cast<size_t>(i)].rate_dph;
  }
  const double around_mean = (z.array() - z.mean()).square().sum();
  const double left = (z - a * a.colPivHouseholderQr().solve(z)).squaredNorm();
  return left > 0 ? (around_mean - left) / 3 / (left / static_cast<double>(n - 4)) : (around_mean > 0 ? 1e300 : 0);
}

void choose_detrend(const std::vector<std::string>& logs, const std::vector<std::string>& axes, std::string* detrend) {
  const bool is_chosen = !detrend->empty();
  if (is_chosen && *detrend != "mean" && *detrend != "none") return;
  for (const std::string& log : logs) {
    if (log == "-") continue; // standard input cannot be read twice
    for (const Series& s : load_series(log, axes, true)) {
      const double f = temperature_f(s);
      if (f <= kTemperatureF) continue;
      std::fprintf(stderr, "errormodel: note: %s %s: the rate follows the temperature (F = %.3g, limit %.3g): %s\n",
                   printable(log).c_str(), s.axis.c_str(), f, kTemperatureF,
                   is_chosen ? ("with --detrend " + *detrend + " that counts as noise").c_str()
                             : "a cubic is taken out (--detrend poly:3); to choose: --detrend");
      if (!is_chosen) *detrend = "poly:3";
      return;
    }
  }
  if (!is_chosen) *detrend = "mean";
}

} // namespace imucal
