// SPDX-License-Identifier: MIT
// The top of a function of few parameters, and how sharp it is.
#pragma once
#include <Eigen/Core>
#include <functional>

#include "physics/effects/estimation.h"

namespace imucal {

// Maximises by the Nelder-Mead search of NLopt inside bounds; `theta` is start and result; returns the value reached.
struct SearchOptions {
  int max_evaluations = 60;
  double step = 0.3;       // of the first simplex (in the logarithm where is_logarithmic)
  double tolerance = 0.01; // in nats
  bool is_logarithmic = false;
};
double maximise(const std::function<double(const Theta&)>& f, Theta* theta, const Theta& lo, const Theta& hi,
                const SearchOptions& options);

// Covariance from the curvature of a log-likelihood at its maximum `theta`: inverse of its negative Hessian, by central
// differences about one standard error wide.  NaN where a bound is too near or the curvature is not that of a maximum.
Eigen::MatrixXd curvature_covariance(const std::function<double(const Theta&)>& f, const Theta& theta, const Theta& lo,
                                     const Theta& hi);
// Standard errors from it: roots of its diagonal.
Theta curvature_errors(const std::function<double(const Theta&)>& f, const Theta& theta, const Theta& lo,
                       const Theta& hi);
Theta roots_of_diagonal(const Eigen::MatrixXd& covariance);

} // namespace imucal
