// SPDX-License-Identifier: MIT
// A temperature without the noise of its thermometer, and with its corners and the cycle of its chamber.
//
// The curve z that minimises  sum over seen numbers (y - z)^2 + tau^4 sum (second differences of z)^2  (Whittaker 1923; for
// equal steps a cubic smoothing spline).  It is linear in y, leaves straight lines as they are, also at the ends, and goes
// on smoothly through holes.  Periods shorter than 2 pi tau steps are taken off.  How much to smooth the numbers tell: tau
// has the least cross-validated error (Craven and Wahba 1979) of the candidates.
#pragma once
#include <cstddef>
#include <vector>

namespace imucal {

// y: equal steps; NaN where nothing was seen.  tau in steps.  At least three numbers must be seen.
std::vector<double> whittaker(const std::vector<double>& y, double tau);

// The candidate with the least generalised cross-validation of means over `block` numbers, half of which are seen at least:
// what is left of a thermometer's steps is alike in neighbours, and single numbers would ask for next to no smoothing.  Where
// there are no such means, the first one: candidates increase, and it smooths least.
double best_tau(const std::vector<double>& y, const std::vector<double>& candidates, size_t block);

} // namespace imucal
