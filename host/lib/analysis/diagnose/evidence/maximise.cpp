// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/maximise.h"

#include <algorithm>
#include <cmath>
#include <nlopt.hpp>

#include "linear/linear.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

double maximise(const std::function<double(const Theta&)>& f, Theta* theta, const Theta& lo, const Theta& hi,
                const SearchOptions& options) {
  const auto inward = [&](double v) { return options.is_logarithmic ? std::log(v) : v; };
  const auto outward = [&](const std::vector<double>& x) {
    Theta real(x.size());
    for (size_t i = 0; i < x.size(); ++i)
      real[i] = std::clamp(options.is_logarithmic ? std::exp(x[i]) : x[i], lo[i], hi[i]);
    return real;
  };
  std::vector<double> x, least, most;
  for (size_t i = 0; i < theta->size(); ++i) {
    x.push_back(inward(std::clamp((*theta)[i], lo[i], hi[i])));
    least.push_back(inward(lo[i])), most.push_back(inward(hi[i]));
  }
  nlopt::opt search(nlopt::LN_NELDERMEAD, static_cast<unsigned>(x.size()));
  std::function<double(const std::vector<double>&)> value = [&](const std::vector<double>& at) {
    return f(outward(at));
  };
  search.set_max_objective(
      [](const std::vector<double>& at, std::vector<double>&, void* data) {
        return (*static_cast<std::function<double(const std::vector<double>&)>*>(data))(at);
      },
      &value);
  search.set_lower_bounds(least), search.set_upper_bounds(most);
  search.set_initial_step(options.step);
  search.set_ftol_abs(options.tolerance);
  search.set_maxeval(options.max_evaluations);
  double reached = 0;
  try {
    search.optimize(x, reached);
  } catch (const nlopt::roundoff_limited&) { // x and reached hold the best point so far
  }
  *theta = outward(x);
  return reached;
}

// Rounds in which a step is brought near one standard error: each changes it tenfold at most.
constexpr int kMostRounds = 12;

MatrixXd curvature_covariance(const std::function<double(const Theta&)>& f, const Theta& theta, const Theta& lo,
                              const Theta& hi) {
  const long n = static_cast<long>(theta.size());
  const MatrixXd unknown = MatrixXd::Constant(n, n, std::nan(""));
  const double top = f(theta);
  const auto at = [&](long i, double di, long j, double dj) {
    Theta x = theta;
    x[static_cast<size_t>(i)] += di;
    x[static_cast<size_t>(j)] += dj;
    return f(x);
  };
  VectorXd step(n);
  MatrixXd hessian(n, n);
  for (long i = 0; i < n; ++i) {
    const size_t at_i = static_cast<size_t>(i);
    // The smaller distance to a bound limits the step; a parameter on its bound has no curvature.
    const double room = std::min(theta[at_i] - lo[at_i], hi[at_i] - theta[at_i]);
    double h = std::min(0.5 * room, 0.1 * std::max(std::fabs(theta[at_i]), 0.1 * (hi[at_i] - lo[at_i])));
    if (!(h > 0)) return unknown;
    double second = 0;
    for (int round = 1;; ++round) {
      second = at(i, h, i, 0) + at(i, -h, i, 0) - 2 * top;
      if (!(second < 0) || round == kMostRounds) break;
      const double wanted = h / std::sqrt(-second); // one standard error: the two drops sum to 1
      if (wanted > 0.6 * h && wanted < 1.7 * h) break;
      const double next = std::clamp(wanted, 0.1 * h, std::min(10 * h, 0.9 * room));
      if (std::fabs(next - h) < 0.05 * h) break;
      h = next;
    }
    if (!(second < 0)) return unknown;
    step[i] = h;
    hessian(i, i) = second / (h * h);
  }
  for (long i = 0; i < n; ++i)
    for (long j = i + 1; j < n; ++j)
      hessian(i, j) = hessian(j, i) =
          (at(i, 0.5 * step[i], j, 0.5 * step[j]) - at(i, 0.5 * step[i], j, -0.5 * step[j]) -
           at(i, -0.5 * step[i], j, 0.5 * step[j]) + at(i, -0.5 * step[i], j, -0.5 * step[j])) /
          (step[i] * step[j]);
  const Cholesky information(-hessian);
  return information.is_positive() ? information.inverse() : unknown;
}
Theta curvature_errors(const std::function<double(const Theta&)>& f, const Theta& theta, const Theta& lo,
                       const Theta& hi) {
  return roots_of_diagonal(curvature_covariance(f, theta, lo, hi));
}
Theta roots_of_diagonal(const MatrixXd& covariance) {
  Theta errors;
  for (long i = 0; i < covariance.rows(); ++i) errors.push_back(std::sqrt(covariance(i, i)));
  return errors;
}

} // namespace imucal
