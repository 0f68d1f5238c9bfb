// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/start_sizes.h"

#include <algorithm>
#include <cmath>

#include "base/quantile.h"
#include "linear/linear.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kSameErrors = 2;  // of the difference of two runs that may have begun alike, where not all did
constexpr double kAllAlike = 0.99; // of campaigns whose runs all began alike are taken for that

// Sizes of the runs and their covariance.
struct Sizes {
  VectorXd mean;
  MatrixXd covariance;
};

// The size in every run is that which all share and what the start state of the run adds.
MatrixXd sizes_by_coefficients(const Design& design, const std::vector<long>& starts, long common) {
  MatrixXd out = MatrixXd::Zero(static_cast<long>(starts.size()), static_cast<long>(design.cols()));
  for (size_t r = 0; r < starts.size(); ++r) {
    out(static_cast<long>(r), common) = 1;
    out(static_cast<long>(r), starts[r]) = 1;
  }
  return out;
}

// As the logs alone have them: the fit holds start states to be about as large in all runs, which draws a cold start
// and a warm one together.  That prior has the precision q (1 - 11'/n) of n sizes, whatever their mean.
Sizes without_prior(const Sizes& fitted, double q) {
  const long n = fitted.mean.size();
  const MatrixXd information = inverse_symmetric(fitted.covariance);
  const MatrixXd prior = q * (MatrixXd::Identity(n, n) - MatrixXd::Constant(n, n, 1.0 / static_cast<double>(n)));
  const Cholesky alone(information - prior);
  if (!alone.is_positive()) return fitted;
  const MatrixXd covariance = alone.inverse();
  return {covariance * (information * fitted.mean), covariance};
}

// Whether all may be one size: the squares about their best common one.
bool may_be_one(const Sizes& of) {
  const VectorXd ones = VectorXd::Ones(of.mean.size());
  const VectorXd by_ones = solve_symmetric(of.covariance, ones);
  const VectorXd off = of.mean - ones * (by_ones.dot(of.mean) / by_ones.dot(ones));
  const double squares = off.dot(solve_symmetric(of.covariance, off));
  return squares <= chi2_quantile(kAllAlike, static_cast<double>(of.mean.size() - 1));
}

} // namespace

StartSizes start_sizes(const Campaign& campaign, const Design& design, const Fit& fit, const Term& term, size_t place) {
  StartSizes out;
  if (!term.estimator->is_start_a_size()) return out;
  std::vector<long> starts;
  for (size_t c = 0; c < design.cols(); ++c)
    if (design.start_of_column[c] == static_cast<int>(place)) starts.push_back(static_cast<long>(c));
  if (starts.empty() || starts.size() != campaign.runs.size()) return out;
  const MatrixXd of = sizes_by_coefficients(design, starts, columns_of(design, place).front());
  const Sizes alone =
      without_prior({of * fit.beta, of * fit.beta_covariance * of.transpose()}, design.prior_precision[starts.front()]);
  const auto& [sizes, covariance] = alone;
  const bool are_all_alike = sizes.size() < 2 || may_be_one(alone);
  const VectorXd errors = covariance.diagonal().cwiseMax(0).cwiseSqrt();
  Eigen::Index largest = 0;
  (sizes.cwiseAbs() - kSameErrors * errors).maxCoeff(&largest); // surely so large
  VectorXd weights = VectorXd::Zero(sizes.size());
  for (long r = 0; r < sizes.size(); ++r) {
    const double variance = covariance(r, r) + covariance(largest, largest) - 2 * covariance(r, largest);
    const bool is_like =
        are_all_alike || std::fabs(sizes[r] - sizes[largest]) <= kSameErrors * std::sqrt(std::max(0.0, variance));
    if (is_like && errors[r] > 0) weights[r] = 1 / covariance(r, r);
    out.runs.push_back({static_cast<int>(campaign.runs[static_cast<size_t>(r)].input.log), {sizes[r], errors[r]}, 0});
  }
  if (!(weights.sum() > 0)) return {};
  weights /= weights.sum();
  for (long r = 0; r < sizes.size(); ++r) out.runs[static_cast<size_t>(r)].weight = weights[r];
  out.largest = {weights.dot(sizes), std::sqrt(weights.dot(covariance * weights))};
  return out;
}

void tell_largest(SelectedEffect* effect) {
  if (effect->start_sizes.runs.empty()) return;
  effect->term.coefficients = {effect->start_sizes.largest.value};
  effect->term.coefficient_errors = {effect->start_sizes.largest.std_error};
}

} // namespace imucal
