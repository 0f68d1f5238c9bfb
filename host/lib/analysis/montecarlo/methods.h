// SPDX-License-Identifier: MIT
// Other ways to get the thermal polynomial out of the same 1-s means, to compare the Kalman filter with.
//
// kLeastSquares    polynomial fit of every second, unweighted (paper, Fig. 14).
// kRisingBins      as hobby autopilots learn on the board: seconds are averaged until the temperature has risen by
//                  0.5 degC, each mean is one equally weighted point of a polynomial fit; falling temperature
//                  contributes nothing.
// kRisingMaximum   only seconds at a temperature above all earlier ones enter a least-squares fit (so does PX4's
//                  thermal calibration: a sample that is not warmer than the warmest before is left out).
#pragma once
#include <string>
#include <vector>

namespace imucal {

enum class Method { kKalman, kLeastSquares, kRisingBins, kRisingMaximum };
std::string to_text(Method method);

struct FitPoint {
  double temp_degc, rate_dph;
};

// Coefficients b0 … bM of sum b_i Tn^i by least squares, computed in Legendre polynomials of Tn (orthogonal
// over the span, so that the Gram matrix is well conditioned) and a Cholesky solution.  Empty where the
// points do not determine the polynomial (fewer than order + 1 points, or a condition number above 1e10).
std::vector<double> fit_polynomial(const std::vector<FitPoint>& points, int order, double t0_degc, double range_degc);

// The points a method takes from the seconds of a test.
std::vector<FitPoint> points_of(Method method, const std::vector<FitPoint>& seconds, double bin_degc = 0.5);

} // namespace imucal
