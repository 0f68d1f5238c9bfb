// SPDX-License-Identifier: MIT
// How much of what the nominal model leaves in held-out rates an answer removes, and how well the rates show that.
//
// In a held-out unit the noise-free mean is  m = p1 + f + B c,  p1 what the answer predicts there, f a constant and start
// states, which are free in every run, B columns of what an answer gets wrong (its own size, the polynomial, the shapes of
// its names, the first cosines of time; orthogonal, unit rms).  The rates are m and the noise of the answer.  With
// c ~ N(0, K + g^2), K what the fit to other data leaves of its coefficients, and every g from a twentieth of what the answer
// changes to what is left as likely as the others, the rates leave a posterior of c, and with it one of
//   shrinkage = 1 - |B c|^2 / |B c + p1 - p0|^2,   p0 what the nominal model predicts.
// Noise that hides the gap leaves it wide; many quiet minutes leave it narrow, in one log too.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "analysis/diagnose/logs/campaign.h"
#include "noise/noise_model.h"

namespace imucal {

// What was not fitted, as two hypotheses see it; one row per used row of `run`.
struct HeldOutUnit {
  CampaignRun run;
  Eigen::VectorXd left;   // rates less what the answer predicts
  Eigen::VectorXd change; // what the answer predicts less what the nominal model predicts
  Eigen::MatrixXd starts; // free in every run beside a constant
  Eigen::MatrixXd shapes; // the polynomial, and the columns of the names
  // Columns of the coefficients that were fitted to other data, and their covariance; empty: nothing is known of it.
  Eigen::MatrixXd fitted, covariance;
};

struct Reduction {
  double before_dph2 = 0, after_dph2 = 0; // mean squares of what the models leave, without the noise
  double shrinkage = 0, lo = -1, hi = 1;  // mean and 95 %; values below -1 count as -1
};

// `noise`: of the fitted logs; in each unit it is as strong as its run says.  A unit without a row, or with no more rows than it
// has free columns, says nothing; without any other the result is as it begins.
Reduction reduction_of(const std::vector<HeldOutUnit>& units, const NoiseModel& noise);

} // namespace imucal
