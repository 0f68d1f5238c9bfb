// SPDX-License-Identifier: MIT
// Quantiles the confidence intervals and thresholds need.
#pragma once

namespace imucal {

double normal_cdf(double z);
double normal_quantile(double p);              // p in (0, 1); relative error below 1e-12
double chi2_cdf(double x, double dof);         // regularised incomplete gamma P(dof/2, x/2)
double chi2_quantile(double p, double dof);    // dof > 0, not necessarily whole

// Interval for a true rms from a measured rms with `dof` equivalent degrees of freedom:
// rms * [sqrt(dof / chi2(hi)), sqrt(dof / chi2(lo))].
struct Interval {
  double lo, hi;
};
Interval rms_interval(double rms, double dof, double confidence = 0.95);

}  // namespace imucal
