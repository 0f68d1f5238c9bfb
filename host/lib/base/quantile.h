// SPDX-License-Identifier: MIT
// Distributions and quantiles that confidence intervals and thresholds need, by Boost.Math.
// p in (0, 1), dof and shapes > 0, not necessarily whole; relative error below 1e-12.
#pragma once

namespace imucal {

double normal_cdf(double z);
double normal_quantile(double p);
double chi2_cdf(double x, double dof);
double chi2_quantile(double p, double dof);
// Clopper and Pearson's interval of a proportion is made of these: k of n, beta_quantile(p, k, n - k + 1).
double beta_quantile(double p, double a, double b);
double student_quantile(double p, double dof); // p > 0.5
// Of the ratio of two mean squares, Fisher's F; more than a million degrees of freedom are as many as there can be.
double f_quantile(double p, double dof_above, double dof_below);

// Interval for a true rms from a measured rms with `dof` equivalent degrees of freedom:
// rms * [sqrt(dof / chi2(hi)), sqrt(dof / chi2(lo))].
struct Interval {
  double lo, hi;
};
Interval rms_interval(double rms, double dof, double confidence = 0.95);

} // namespace imucal
