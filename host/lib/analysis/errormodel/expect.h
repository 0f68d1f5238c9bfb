// SPDX-License-Identifier: MIT
// Closed-form expectation of Allan deviation and Direct Predictor: no Monte Carlo needed.
//
// With V(k) the variance of the sum of k samples (noise/components.h), AV and DP1 from m samples before:
//   E d^2 = V(n)/n^2 + V(m)/m^2 - (V(n+m) - V(n) - V(m)) / (n m)                    (AV: m = n)
// DP2 and DP3 predict with weights w_j = sum_m c_m pole_m^j (nominal_filter.h); white variance r gives
//   r/n + r sum_mm' c_m c_m' / (1 - pole_m pole_m')
// and a Markov term of unit variance gives
//   [n + 2 sum_k (n-k) phi^k]/n^2 + sum_mm' c_m c_m' [1/(1 - pole_m phi) + 1/(1 - pole_m' phi) - 1]/(1 - pole_m pole_m')
//   - 2/n (1 - phi^n)/(1 - phi) sum_m c_m phi/(1 - pole_m phi),
// which for one nominal term is the formula of reference figures C, tests/README.md.  Sinusoids: half the amplitude squared times the
// squared gain of the operator.  DP = sqrt(E d^2 / 2).
//
// Where the expectation depends on the record (random walk and ramp under DP2 or DP3, every detrended record),
// expected_record_* take it: with C the covariance of the samples, G the operator as a matrix and Q an
// orthonormal basis of what was fitted and removed from the same data,
//   E mean d^2 = E d^2 - [2 <C Q, G'G Q> - trace(Q'CQ Q'G'GQ)] / windows,
// exact for a record without gaps.  The bracket is the noise that the fit has removed together with the trend.
#pragma once
#include <optional>
#include <vector>

#include "analysis/dp/dp.h"
#include "noise/components.h"

namespace imucal {

// E d^2 [dph^2] of one component for windows of n samples.  usage_error where it depends on the record.
double expected_square(const NoiseComponent& component, const DpOperator& op, long n);

// DP [dph] of a whole model at tau_s = n dt.
std::vector<double> expected_dp_dph(const ErrorModel& model, const DpOperator& op, const std::vector<double>& tau_s);

// E mean d^2 of each component over the windows of a record after detrending, one value per n: result[component][i_n].
// `shape` gives length, missing samples and temperatures; its rates do not matter.
std::vector<std::vector<double>> expected_record_squares(const std::vector<NoiseComponent>& components,
                                                         const DpOperator& op, const Series& shape,
                                                         const Detrend& detrend, const std::vector<long>& n);
std::vector<double> expected_record_dp_dph(const ErrorModel& model, const DpOperator& op, const Series& shape,
                                           const Detrend& detrend, const std::vector<double>& tau_s);

// A record of `n` samples of nothing, for expectations that depend on its length only.
Series empty_record(long n, double dt_s);

} // namespace imucal
