// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/methods.h"

#include <Eigen/Core>
#include <cmath>
#include <limits>

#include "base/error.h"
#include "linear/linear.h"

namespace imucal {

static constexpr int kMostCoefficients = 6;

std::string to_text(Method method) {
  switch (method) {
  case Method::kKalman:
    return "kalman";
  case Method::kLeastSquares:
    return "least_squares";
  case Method::kRisingBins:
    return "rising_bins";
  case Method::kRisingMaximum:
    return "rising_maximum";
  }
  return "";
}

// P_0 … P_order at x.
static void legendre(double x, int order, double* values) {
  values[0] = 1;
  if (order >= 1) values[1] = x;
  for (int n = 1; n < order; ++n) values[n + 1] = ((2 * n + 1) * x * values[n] - n * values[n - 1]) / (n + 1);
}

// Row n: powers of x in P_n.
static Eigen::MatrixXd legendre_powers(int order) {
  Eigen::MatrixXd powers = Eigen::MatrixXd::Zero(order + 1, order + 1);
  powers(0, 0) = 1;
  if (order >= 1) powers(1, 1) = 1;
  for (int n = 1; n < order; ++n)
    for (int i = 0; i <= n + 1; ++i)
      powers(n + 1, i) = ((i > 0 ? (2 * n + 1) * powers(n, i - 1) : 0.0) - n * powers(n - 1, i)) / (n + 1);
  return powers;
}

std::vector<double> fit_polynomial(const std::vector<FitPoint>& points, int order, double t0_degc, double range_degc) {
  const int p = order + 1;
  if (p > kMostCoefficients) throw usage_error("polynomial order above 5");
  double gram[kMostCoefficients][kMostCoefficients] = {}, right[kMostCoefficients] = {}, basis[kMostCoefficients];
  for (const FitPoint& point : points) {
    legendre((point.temp_degc - t0_degc) / range_degc, order, basis);
    for (int i = 0; i < p; ++i) {
      right[i] += basis[i] * point.rate_dph;
      for (int j = 0; j <= i; ++j) gram[i][j] += basis[i] * basis[j];
    }
  }
  Eigen::MatrixXd a(p, p);
  Eigen::VectorXd b(p);
  for (int i = 0; i < p; ++i) {
    b(i) = right[i];
    for (int j = 0; j <= i; ++j) a(i, j) = a(j, i) = gram[i][j];
  }
  const Eigen::VectorXd eigenvalues = symmetric_spectrum(a).values;
  const double largest = eigenvalues(p - 1), smallest = eigenvalues(0);
  if (static_cast<int>(points.size()) < p || !(smallest > 1e-10 * largest)) return {};
  const Eigen::VectorXd in_legendre = solve_symmetric(a, b);
  const Eigen::VectorXd coeff = legendre_powers(order).transpose() * in_legendre;
  return {coeff.data(), coeff.data() + p};
}

static std::vector<FitPoint> rising_bins(const std::vector<FitPoint>& seconds, double bin_degc) {
  std::vector<FitPoint> out;
  if (seconds.empty()) return out;
  double sum_temp = 0, sum_rate = 0;
  long n = 0;
  double last_degc = seconds.front().temp_degc;
  for (const FitPoint& s : seconds) {
    sum_temp += s.temp_degc;
    sum_rate += s.rate_dph;
    ++n;
    if (s.temp_degc < last_degc + bin_degc) {
      // Fallen by a bin: what was gathered belongs to no rise.
      if (s.temp_degc < last_degc - bin_degc) sum_temp = sum_rate = 0, n = 0;
      continue;
    }
    out.push_back({sum_temp / static_cast<double>(n), sum_rate / static_cast<double>(n)});
    last_degc = s.temp_degc;
    sum_temp = sum_rate = 0;
    n = 0;
  }
  return out;
}

static std::vector<FitPoint> rising_maximum(const std::vector<FitPoint>& seconds) {
  std::vector<FitPoint> out;
  double highest = -std::numeric_limits<double>::infinity();
  for (const FitPoint& s : seconds) {
    if (s.temp_degc <= highest) continue;
    highest = s.temp_degc;
    out.push_back(s);
  }
  return out;
}

std::vector<FitPoint> points_of(Method method, const std::vector<FitPoint>& seconds, double bin_degc) {
  switch (method) {
  case Method::kRisingBins:
    return rising_bins(seconds, bin_degc);
  case Method::kRisingMaximum:
    return rising_maximum(seconds);
  case Method::kKalman:
  case Method::kLeastSquares:
    break;
  }
  return seconds;
}

} // namespace imucal
