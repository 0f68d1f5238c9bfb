// SPDX-License-Identifier: MIT
// All candidates and all library-free tests of one hypothesis, scored on its innovations.
//
// The innovations e of a true model are independent N(0,1), so a simulation of the nominal model on the very
// profiles of the logs is a draw of e: the same panel scores data and nulls.  Mean effects are scored in the
// reduced domain of the bank.
#pragma once
#include <Eigen/Dense>
#include <memory>
#include <string>
#include <vector>

#include "analysis/diagnose/bank.h"
#include "analysis/diagnose/fit.h"

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

enum class PanelScope {
  kDesign,     // only gains of single candidates on demand
  kCandidates, // the whole library
  kAll         // and the library-free tests
};

class Panel {
public:
  Panel(ColumnBank* bank, const Hypothesis& hypothesis, PanelScope scope);
  ~Panel();

  // Scores of the hypothesis on data.
  PanelScores score(const Fit& fit, const SpectrumNull& spectrum) const;
  // Scores of a draw of the model itself: e is N(0,1), one vector per run; the replaced-temperature
  // candidates take the polynomial of the nominal model as the signal.
  PanelScores score_null(std::vector<Eigen::VectorXd> e, const SpectrumNull& spectrum) const;

  // The part of the scores that needs only the binned periodogram: stationary noise candidates by Whittle
  // likelihood and the spectrum test.  Done by score and score_null when `spectrum` is given.
  void score_whittle(const SpectrumNull& spectrum, PanelScores* scores) const;

  // Gain of one candidate (kColumns, kTemperature, kSteps, kTone) at any shape, on data.
  double gain_at(const EffectEstimator& estimator, const Theta& shape, const Fit& fit) const;
  CandidateScore best_step(const Fit& fit) const;

  // Reduced whitened columns, free of the design.
  Eigen::MatrixXd project(Eigen::MatrixXd reduced) const;
  const WhitenedColumns& columns() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

} // namespace imucal
