// SPDX-License-Identifier: MIT
// Spectral density of noise models and the logarithmic bins of the periodogram of innovations.
#pragma once
#include <vector>

#include "physics/effects/estimation.h"

namespace imucal {

// Density of the sampled process per sample [dph^2], two-sided, at frequencies in Hz: white R, Markov
// sigma^2 (1 - phi^2)/(1 - 2 phi cos w + phi^2), random walk K^2 dt/(2 - 2 cos w).
std::vector<double> spectral_density(const NoiseModel& noise, const std::vector<double>& hz, double dt_s);

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
