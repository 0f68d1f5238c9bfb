// SPDX-License-Identifier: MIT
// A polynomial of temperature fitted to means over a minute, each log with a constant of its own: what logs are compared with before
// any noise is known.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "analysis/diagnose/logs/campaign.h"

namespace imucal {

// Means over a minute of one run.
struct MinuteMeans {
  Eigen::VectorXd temp_degc, rate_dph;
};
std::vector<MinuteMeans> minute_means(const Campaign& campaign);
// Those of runs that are long enough to say something of a polynomial.
std::vector<MinuteMeans> long_ones(std::vector<MinuteMeans> runs);
bool is_long(const MinuteMeans& means);

class MeanPolynomial {
public:
  // `runs`: at least one; order >= 1.
  MeanPolynomial(const std::vector<MinuteMeans>& runs, int order);
  double rms_dph() const { return rms_dph_; } // of what it leaves
  double lo_degc() const { return middle_degc_ - half_degc_; }
  double hi_degc() const { return middle_degc_ + half_degc_; }
  // Its value without a constant [dph].
  Eigen::VectorXd at(const Eigen::VectorXd& temp_degc) const;

private:
  Eigen::MatrixXd powers_at(const Eigen::VectorXd& temp_degc) const;

  int order_;
  double middle_degc_, half_degc_, rms_dph_;
  Eigen::VectorXd coefficients_;
};

} // namespace imucal
