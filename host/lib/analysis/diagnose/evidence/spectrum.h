// SPDX-License-Identifier: MIT
// The logarithmic bins of the periodogram of innovations.
#pragma once
#include <cstddef>
#include <vector>

namespace imucal {

class SpectrumBins {
public:
  // `longest`: seconds (samples) of the longest run: sets the lowest frequency and the length of the
  // transform.
  SpectrumBins(size_t longest, double dt_s);

  size_t n_bins() const { return centre_.size(); }
  const std::vector<double>& centres() const { return centre_; }
  // Adds the powers of n transforms of length n_fft, summed frequency by frequency, to the sums of the bins.
  void add(const std::vector<double>& power, double n, std::vector<double>* sum, std::vector<double>* weight) const;

  size_t n_fft = 64;

private:
  std::vector<double> edge_, centre_;
  double dt_s_;
};

} // namespace imucal
