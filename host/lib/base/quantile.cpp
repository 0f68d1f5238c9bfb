// SPDX-License-Identifier: MIT
#include "base/quantile.h"

#include <boost/math/special_functions/beta.hpp>
#include <boost/math/special_functions/erf.hpp>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>

namespace imucal {

// In double throughout: the same digits on machines whose long double is wider and on those where it is not.
using Doubles = boost::math::policies::policy<boost::math::policies::promote_double<false>>;

double normal_cdf(double z) {
  return 0.5 * std::erfc(-z * std::sqrt(0.5));
}

double normal_quantile(double p) {
  return -std::sqrt(2.0) * boost::math::erfc_inv(2 * p, Doubles());
}

double chi2_cdf(double x, double dof) {
  return x > 0 ? boost::math::gamma_p(0.5 * dof, 0.5 * x, Doubles()) : 0.0;
}

double chi2_quantile(double p, double dof) {
  return 2 * boost::math::gamma_p_inv(0.5 * dof, p, Doubles());
}

double beta_quantile(double p, double a, double b) {
  return boost::math::ibeta_inv(a, b, p, Doubles());
}

double student_quantile(double p, double dof) {
  const double x = beta_quantile(2 * (1 - p), 0.5 * dof, 0.5); // of dof / (dof + t^2)
  return std::sqrt(dof * (1 / x - 1));
}

double f_quantile(double p, double dof_above, double dof_below) {
  constexpr double kMostDof = 1e6;
  if (dof_above > kMostDof) dof_above = kMostDof;
  if (!(dof_below < kMostDof)) return chi2_quantile(p, dof_above) / dof_above;
  const double x = beta_quantile(p, 0.5 * dof_above, 0.5 * dof_below);
  return dof_below * x / (dof_above * (1 - x));
}

Interval rms_interval(double rms, double dof, double confidence) {
  const double tail = 0.5 * (1 - confidence);
  return {rms * std::sqrt(dof / chi2_quantile(1 - tail, dof)), rms * std::sqrt(dof / chi2_quantile(tail, dof))};
}

} // namespace imucal
