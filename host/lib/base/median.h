// SPDX-License-Identifier: MIT
// The middle of a sample.
#pragma once
#include <vector>

namespace imucal {

// The upper one of an even number; x is not empty.
double median(std::vector<double> x);

// Standard deviation of Gaussian values over the median of their sizes.
constexpr double kSigmaOfMedianSize = 1.4826;

} // namespace imucal
