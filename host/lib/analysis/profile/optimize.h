// SPDX-License-Identifier: MIT
// The best temperature profile under the limits of a chamber (the paper's second open question).
//
// A profile is a chain of soaks joined by ramps (schedule.h).  Shapes tried: one to several passes between
// the ends of the range, from cold and from hot, with the interior soaks of the G-optimal design (order - 1
// of them) or without; for diagnosability also staircases with partial loops and ramps of different rates.
// Search: NLopt's BOBYQA (Powell 2009) from one deterministic and several random starts on a coarse time grid
// with the p-norm of the error over the span; the best shapes are polished with Subplex (Rowan 1990) on the
// true objective; figures reported are exact, at 1-s steps.  All budgets are counts of evaluations: the
// result depends on the seed only.
#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "analysis/profile/bound.h"
#include "analysis/profile/covariance.h"
#include "analysis/profile/schedule.h"
#include "analysis/profile/signature.h"

namespace imucal {

enum class Objective { kWorst, kRms };

struct OptimizeRequest {
  CalibrationSetup setup; // model, order, span; points, shape_only, turn_on_constants as for the error
  ChamberLimits limits;
  double duration_s = 0; // or 0 with required_dph: the shortest duration that reaches it
  double required_dph = 0;
  Objective objective = Objective::kWorst;
  std::vector<EffectSpec> tell_apart; // empty: accuracy alone
  double max_correlation = 0.75;
  // How much larger the objective may become than without tell_apart, as a part of it.  This is spent on strong
  // signatures: the geometric mean of SignatureTable::separable is made as large as possible.  0: the least
  // error at which the correlation is low enough.
  double spend_frac = 0;
  uint64_t seed = 1;
  int effort = 1;                                                  // multiplies the number of evaluations
  std::function<void(double done_frac, double best_dph)> progress; // may be empty
};

struct OptimizeResult {
  Profile profile;
  std::string shape;
  CalibrationError error;    // of the rounded profile, exact
  double objective_dph = 0;  // worst or rms of it
  SignatureTable signatures; // of tell_apart, or of the standard effects
  bool meets_correlation = true;
  bool meets_error = true;
  Profile paper;        // the paper's ramps and equal soaks at both ends, best number of passes
  int paper_passes = 0; // 0: does not fit into the duration
  CalibrationError paper_error;
  double accuracy_only_dph = 0; // with tell_apart: the objective without it
  long evaluations = 0;
};

// usage_error for impossible requests, with the smallest change that makes them possible.
OptimizeResult optimize_profile(const OptimizeRequest& request);

// Throws where the limits contradict each other or the duration (range that cannot be traversed, soaks too
// long …).
void check_limits(const ChamberLimits& limits, int order, double duration_s);

} // namespace imucal
