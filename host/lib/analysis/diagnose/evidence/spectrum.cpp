// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/spectrum.h"

#include <cmath>

namespace imucal {

SpectrumBins::SpectrumBins(size_t longest_samples, double dt_s) : dt_s_(dt_s) {
  while (n_fft < longest_samples) n_fft *= 2;
  const double longest = static_cast<double>(longest_samples);
  // From one period in the longest run to the Nyquist frequency, 48 bins.
  constexpr int kBins = 48;
  const double lo = 0.75 / (longest * dt_s), hi = 0.5 / dt_s;
  for (int b = 0; b <= kBins; ++b) edge_.push_back(lo * std::pow(hi / lo, static_cast<double>(b) / kBins));
  // Bins narrower than the resolution are merged with the next.
  std::vector<double> kept{edge_.front()};
  for (int b = 1; b <= kBins; ++b)
    if (edge_[static_cast<size_t>(b)] - kept.back() >= 0.99 / (longest * dt_s) || b == kBins)
      kept.push_back(edge_[static_cast<size_t>(b)]);
  edge_ = kept;
  for (size_t b = 0; b + 1 < edge_.size(); ++b) centre_.push_back(std::sqrt(edge_[b] * edge_[b + 1]));
}

void SpectrumBins::add(const std::vector<double>& power, double n, std::vector<double>* sum,
                       std::vector<double>* weight) const {
  size_t b = 0;
  for (size_t i = 1; i <= n_fft / 2 && i < power.size(); ++i) {
    const double hz = static_cast<double>(i) / (static_cast<double>(n_fft) * dt_s_);
    if (hz < edge_.front()) continue;
    while (b + 1 < centre_.size() && hz >= edge_[b + 1]) ++b;
    (*sum)[b] += power[i];
    (*weight)[b] += n;
  }
}

} // namespace imucal
