// SPDX-License-Identifier: MIT
// The noise of a least-squares problem whose noise is not known: white and Markov, by what the residuals show.
//
// Restricted likelihood (the unknowns x of z = A x + noise are integrated out under a flat prior, as errormodel fit does) over a
// grid of the time constant and of g, how many times a Markov process' density at low frequency is that of white noise.
// Priors: flat in the logarithm of the time constant, up to a third of the record, beyond which nothing is known; half-Cauchy
// in sqrt(g) (Gelman 2006, Bayesian Analysis 1, 515: of a scale that may be 0).  The scale is at its best value.  Every point of
// the grid keeps its weight: what is not known of the noise is then part of the predicted error.
//
// More processes than one, up to three, where BIC wants them (2 ln n of the deviance for each): the faster ones stay at their
// likeliest values and the grid is of the slowest, on which the predicted error rests.  One process alone would follow the fast
// part of such noise and be blind for the slow one.
// A still slower process that BIC does not want is as likely beforehand as none: what the residuals leave of it is added.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "noise/noise_model.h"

namespace imucal {

// One run's rows: z, the column of ones (its constant), then the columns that all runs share.
struct ResidualRun {
  std::vector<int> steps; // rows of the grid from the row before (noise/gains.h)
  Eigen::MatrixXd columns;
};

// The covariance of the noise is believed to be the sum of those of the models, each times its weight.  The likeliest one first;
// the weights of whole models sum to one, slower processes that may be there beside them (no white noise) follow.
struct NoiseBelief {
  std::vector<NoiseModel> noise;
  std::vector<double> weight;
};

// dt_s: step of the grid.  is_shared: one constant for all runs.
NoiseBelief believe_residuals(const std::vector<ResidualRun>& runs, double dt_s, bool is_shared);

} // namespace imucal
