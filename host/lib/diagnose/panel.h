// SPDX-License-Identifier: MIT
// All candidates and all library-free tests of one hypothesis, scored on its innovations.
//
// The innovations e of a true model are independent N(0,1), so a simulation of the nominal model on the very
// profiles of the logs is a draw of e: the same panel scores data and nulls.  Mean effects are scored in a
// reduced domain, block sums of e over sqrt(block length), where a whitened column is represented by the same
// sums: exact for whatever changes little within a block (12 s in logs of usual length).
#pragma once
#include <Eigen/Dense>
#include <memory>
#include <string>
#include <vector>

#include "diagnose/fit.h"

namespace imucal {

struct CandidateScore {
  double gain_nats = 0;
  Theta shape; // where the gain was found
};

struct PanelScores {
  std::vector<CandidateScore> named; // in the order of the library; structural and shared effects stay 0
  std::vector<double> generic;       // in the order of generic_names()
  std::vector<double> psd;           // binned periodogram of e; mean 1 for a true model
};

// Library-free tests.
const std::vector<std::string>& generic_names();
std::string generic_statement(size_t generic); // what it means when it fires

// Mean and spread of the binned periodogram under the null (the estimated mean takes power from the lowest
// bins).
struct SpectrumNull {
  std::vector<double> mean, dof;
  bool empty() const { return mean.empty(); }
};

class Panel {
public:
  // `library`: the effects to score.  `with_generic`: the library-free tests too.
  Panel(const Campaign& campaign, const Hypothesis& hypothesis, const std::vector<const Effect*>& library,
        bool with_generic);
  ~Panel();

  // Scores of the hypothesis on data.
  PanelScores score(const Fit& fit, const SpectrumNull& spectrum) const;
  // Scores of a draw of the model itself: e is N(0,1), one vector per run; `signal` is the polynomial of the
  // nominal model, which the replaced-temperature candidates need.
  PanelScores score_null(std::vector<Eigen::VectorXd> e, const SpectrumNull& spectrum) const;

  // The part of the scores that needs only the binned periodogram: stationary noise candidates by Whittle
  // likelihood and the spectrum test.  Done by score and score_null when `spectrum` is given.
  void score_whittle(const SpectrumNull& spectrum, PanelScores* scores) const;

  // Gain of one candidate (kColumns, kTemperature, kSteps, kTone) at any shape, on data.
  double gain_at(const EffectEstimator& estimator, const Theta& shape, const Fit& fit) const;

  size_t n_blocks() const;
  // ln(energy) projections for identifiability and decomposition: reduced whitened column, projected off the
  // design.
  Eigen::MatrixXd reduce(const std::vector<Eigen::MatrixXd>& columns) const;
  double absorbed(size_t candidate,
                  const Eigen::VectorXd& reduced) const; // largest energy a candidate explains

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

} // namespace imucal
