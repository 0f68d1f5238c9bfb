// SPDX-License-Identifier: MIT
#include "analysis/fit/factors.h"

namespace imucal {

Eigen::VectorXd Factors::coeff() const {
  return r.triangularView<Eigen::UnitUpper>().solve(x);
}

Eigen::MatrixXd Factors::covariance() const {
  const Eigen::MatrixXd inverse =
      r.triangularView<Eigen::UnitUpper>().solve(Eigen::MatrixXd::Identity(r.rows(), r.cols()));
  return inverse * d.cwiseInverse().asDiagonal() * inverse.transpose();
}

Factors Factors::without_constant() const {
  const Eigen::Index m = x.size() - 1;
  return {x.tail(m), d.tail(m), r.bottomRightCorner(m, m)};
}

Factors factors_of(const imucal_kf_t& kf) {
  const int p = kf.config.order + 1;
  Factors f{Eigen::VectorXd(p), Eigen::VectorXd(p), Eigen::MatrixXd::Identity(p, p)};
  for (int k = 0; k < p; ++k) {
    const imucal_kf_row_t& row = kf.row[k];
    f.x[k] = static_cast<double>(row.x.hi) + static_cast<double>(row.x.lo);
    f.d[k] = static_cast<double>(row.d.hi) + static_cast<double>(row.d.lo);
    for (int i = 0; i < k; ++i)
      f.r(i, k) = static_cast<double>(imucal_kf_r(&kf, static_cast<uint32_t>(i), static_cast<uint32_t>(k)));
  }
  return f;
}

} // namespace imucal
