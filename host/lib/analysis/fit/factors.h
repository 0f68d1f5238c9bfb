// SPDX-License-Identifier: MIT
// What the core's filter has learnt, in double.  Only this file of the host knows the layout of
// imucal_kf_t.
#pragma once
#include <Eigen/Core>

#include "kf.h"

namespace imucal {

// On the coefficients c0 .. cM of the Chebyshev polynomials: R c = x with information R' D R, R unit upper
// triangular. Row 0 is c0 given the others: c0 = x0 - r(0, 1..M) c1..M, variance 1/d0; without it the rows
// are those of c1 .. cM alone.
struct Factors {
  Eigen::VectorXd x, d;
  Eigen::MatrixXd r;
  Eigen::VectorXd coeff() const;      // c
  Eigen::MatrixXd covariance() const; // R^-1 D^-1 R^-T
  Factors without_constant() const;   // of c1 .. cM
};
Factors factors_of(const imucal_kf_t& kf);

// T_0 .. T_M at x.
Eigen::VectorXd chebyshev_row(int order, double x);
// b = C c: powers from Chebyshev polynomials.
Eigen::MatrixXd power_from_chebyshev(int order);

} // namespace imucal
