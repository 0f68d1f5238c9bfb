// SPDX-License-Identifier: MIT
#include "base/quantile.h"

#include <cmath>

namespace imucal {

double normal_cdf(double z) { return 0.5 * std::erfc(-z * std::sqrt(0.5)); }

// Acklam's rational approximation, then one step of Halley's method on erfc.
double normal_quantile(double p) {
  static const double a[] = {-3.969683028665376e+01, 2.209460984245205e+02, -2.759285104469687e+02,
                             1.383577518672690e+02,  -3.066479806614716e+01, 2.506628277459239e+00};
  static const double b[] = {-5.447609879822406e+01, 1.615858368580409e+02, -1.556989798598866e+02,
                             6.680131188771972e+01, -1.328068155288572e+01};
  static const double c[] = {-7.784894002430293e-03, -3.223964580411365e-01, -2.400758277161838e+00,
                             -2.549732539343734e+00, 4.374664141464968e+00,  2.938163982698783e+00};
  static const double d[] = {7.784695709041462e-03, 3.224671290700398e-01, 2.445134137142996e+00,
                             3.754408661907416e+00};
  const double tail = p < 0.5 ? p : 1 - p;
  double x;
  if (tail < 0.02425) {
    const double q = std::sqrt(-2 * std::log(tail));
    x = (((((c[0] * q + c[1]) * q + c[2]) * q + c[3]) * q + c[4]) * q + c[5]) /
        ((((d[0] * q + d[1]) * q + d[2]) * q + d[3]) * q + 1);
    if (p > 0.5) x = -x;
  } else {
    const double q = p - 0.5, r = q * q;
    x = (((((a[0] * r + a[1]) * r + a[2]) * r + a[3]) * r + a[4]) * r + a[5]) * q /
        (((((b[0] * r + b[1]) * r + b[2]) * r + b[3]) * r + b[4]) * r + 1);
  }
  const double e = (x < 0 ? normal_cdf(x) - p : (1 - p) - normal_cdf(-x));
  const double u = e * 2.5066282746310002 * std::exp(0.5 * x * x);
  return x - u / (1 + 0.5 * x * u);
}

double chi2_cdf(double x, double dof) {
  if (x <= 0) return 0;
  const double a = 0.5 * dof, y = 0.5 * x;
  const double scale = std::exp(-y + a * std::log(y) - std::lgamma(a));
  if (y < a + 1) {  // series
    double term = 1 / a, sum = term;
    for (int k = 1; k < 10000 && term > sum * 1e-16; ++k) sum += term *= y / (a + k);
    return sum * scale;
  }
  double b = y + 1 - a, c = 1e300, d = 1 / b, h = d;  // continued fraction (Lentz)
  for (int k = 1; k < 10000; ++k) {
    const double an = -k * (k - a);
    b += 2;
    d = 1 / (an * d + b);
    c = b + an / c;
    const double factor = d * c;
    h *= factor;
    if (std::fabs(factor - 1) < 1e-15) break;
  }
  return 1 - scale * h;
}

double chi2_quantile(double p, double dof) {
  // Wilson and Hilferty bracket the root loosely; bisection on the logarithm finishes it.
  double lo = 1e-300, hi = dof + 10 * std::sqrt(2 * dof) + 50;
  while (chi2_cdf(hi, dof) < p) hi *= 2;
  double log_lo = std::log(lo), log_hi = std::log(hi);
  const double z = normal_quantile(p), h = 2 / (9 * dof);
  const double guess = dof * std::pow(1 - h + z * std::sqrt(h), 3);
  double middle = guess > 0 && dof > 2 ? std::log(guess) : 0.5 * (log_lo + log_hi);
  for (int k = 0; k < 200 && log_hi - log_lo > 1e-13; ++k) {
    if (middle <= log_lo || middle >= log_hi) middle = 0.5 * (log_lo + log_hi);
    const double x = std::exp(middle), f = chi2_cdf(x, dof) - p;
    (f < 0 ? log_lo : log_hi) = middle;
    // Newton in log x, kept inside the bracket.
    const double slope = std::exp(0.5 * dof * std::log(0.5 * x) - 0.5 * x - std::lgamma(0.5 * dof));
    const double next = slope > 0 ? middle - f / slope : log_lo;
    if (std::fabs(next - middle) < 1e-14) break;
    middle = next;
  }
  return std::exp(middle);
}

Interval rms_interval(double rms, double dof, double confidence) {
  const double tail = 0.5 * (1 - confidence);
  return {rms * std::sqrt(dof / chi2_quantile(1 - tail, dof)), rms * std::sqrt(dof / chi2_quantile(tail, dof))};
}

}  // namespace imucal
