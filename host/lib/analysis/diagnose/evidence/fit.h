// SPDX-License-Identifier: MIT
// A hypothesis (nominal model plus effects) and its exact fit to a campaign.
#pragma once
#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "analysis/diagnose/evidence/kalman.h"

namespace imucal {

// One effect inside a hypothesis.
struct Term {
  const Effect* effect = nullptr;
  const EffectEstimator* estimator = nullptr;
  Theta shape;                      // shape parameters, or theta of a noise effect; steps: run, t_s pairs
  std::vector<double> coefficients; // of its columns (common ones)
  std::vector<double> coefficient_errors;
  // Of the first start column of each run that has one: coefficients, and their covariances with the first of the term (0: it
  // has none).
  std::vector<double> starts, start_errors, start_covariances;
  Theta shape_errors;
  Parameters fixed_parameters; // structural effects: measured, not fitted

  Estimate estimate() const { return {shape, coefficients, shape_errors, coefficient_errors}; }

  Form form() const { return estimator->form(); }
};

struct Hypothesis {
  std::vector<Term> terms;
  std::vector<Term> known;  // taken out of the rates already; only the states they began in are free
  NoiseModel base_noise;    // nominal, or re-estimated
  NoiseModel noise() const; // with what the noise terms make of it
};

// A hypothesis without its jumps in time: they stay with the logs in which they were found.
Hypothesis without_jumps(Hypothesis h);

// What a column of a design is, where it is of no term.
enum ColumnOf : int { kColumnOfStart = -3, kColumnOfConstant = -2, kColumnOfPolynomial = -1 };

// Regressors of one hypothesis: per run a constant, then the polynomial, then the columns of the terms.
struct Design {
  std::vector<Eigen::MatrixXd> x;   // per run: used samples x columns
  Eigen::VectorXd prior_precision;  // per column: 1/s^2 of a random coefficient, else 0
  std::vector<int> term_of_column;  // the term, or a ColumnOf
  std::vector<int> start_of_column; // of the first start state of a run: its term, else -1
  size_t cols() const { return term_of_column.size(); }
};
Design make_design(const Campaign& campaign, const Hypothesis& hypothesis);
// The columns of one term of its hypothesis: those with a coefficient, no start states.
std::vector<long> columns_of(const Design& design, size_t term);
// Rates of the used samples, per run.
std::vector<Eigen::VectorXd> rates(const Campaign& campaign);

// Generalised least squares by QR of the whitened, scaled columns.
struct Fit {
  Eigen::VectorXd beta;
  Eigen::MatrixXd beta_covariance;       // 0 where the logs do not determine a coefficient
  std::vector<Eigen::VectorXd> e;        // standardised innovations of the residual (mixtures: normal scores)
  std::vector<Eigen::VectorXd> residual; // rate minus fitted mean [dph]
  double log_likelihood = 0; // profile; without the constant of 2 pi; hits that stand out as likely as they can be
  double log_det_r = 0;      // of the whitened design: REML = log_likelihood - log_det_r
  double reml() const { return log_likelihood - log_det_r; }
};
// `near`: a residual that the one beside telegraph noise may be like; levels are searched from there too.
Fit fit_hypothesis(const Campaign& campaign, const Hypothesis& hypothesis,
                   const std::vector<Eigen::VectorXd>* near = nullptr);
// True only where both have the same fit to any campaign: nothing beside the nominal mean, and the same noise.
bool is_same_fit(const Hypothesis& a, const Hypothesis& b);

// The matrix that makes columns, given run by run, orthonormal over all runs; dependent ones are left out.
Eigen::MatrixXd orthonormaliser(const std::vector<Eigen::MatrixXd>& columns);

} // namespace imucal
