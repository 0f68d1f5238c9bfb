// SPDX-License-Identifier: MIT
// Studies by simulation: how far curves of two models stand apart (the paper's Figs. 3-5), how well a fit of a test of
// given length can be trusted, and standard errors of a fit by parametric bootstrap.
// Every draw is addressed by (seed, run): results do not depend on the number of threads.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "analysis/errormodel/curve_fit.h"
#include "analysis/errormodel/likelihood.h"

namespace imucal {

struct Spread {
  double mean = 0, sd = 0, q05 = 0, median = 0, q95 = 0;
};
Spread spread_of(std::vector<double> values);

struct SeparationSettings {
  ErrorModel model, versus;
  double duration_s = 6000, dt_s = 1;
  int runs = 5; // of each model per draw
  int draws = 200;
  std::vector<double> tau_s;
  uint64_t seed = 1;
  int threads = 1;
};
struct Separation {
  std::vector<double>
      longest_s; // per draw: longest stretch of tau where all runs of one model lie above all of the other
  Spread spread;
  std::vector<double> separated_frac;                           // per tau: part of the draws that separate there
  std::vector<std::vector<double>> model_curves, versus_curves; // of the first draw
};
Separation separation(const SeparationSettings& settings, const DpOperator& op);

// What to fit and how.
struct FitSettings {
  std::string criterion = "bound"; // bound, ls, ml
  int n_markov = -1;
  Across across = Across::kRms;
  Detrend detrend;
  std::vector<double> tau_s; // bound, ls
  double confidence = 0;     // bound: of the data's upper limit at each tau; 0: the data themselves
};
// Fit of detrended (bound, ls) or raw (ml) series.
ErrorModel fit_model(const std::vector<Series>& series, const DpOperator& op, const FitSettings& settings);

struct ParameterError {
  std::string name;
  double value = 0, std_error = 0, log_std_error = 0, ci95_lo = 0, ci95_hi = 0;
  double vanished_frac = 0; // of refits that had no such term
  long n_refits = 0;        // bootstrap: that it rests on
  std::string verdict;      // "yes", "weak", "no"
  std::string reason;
};
// Refits simulated records of the fitted model, of the same shape and detrended alike.  The expectation that they share,
// `basis`, is made once (nullptr: here), and their curves are of some windows (curve_fit.h).
// `watch`: called now and then with the number of refits that are done; once it says false no further one begins, and the
// errors are of those done: infinite where they are too few.
std::vector<ParameterError> bootstrap_errors(const std::vector<Series>& series, const DpOperator& op,
                                             const FitSettings& settings, const ErrorModel& fitted, int runs,
                                             uint64_t seed, int threads,
                                             std::shared_ptr<const CurveBasis> basis = nullptr,
                                             const std::function<bool(long)>& watch = {});
// From the likelihood's information.
std::vector<ParameterError> likelihood_errors(const MlFit& fit);
// Fills verdict and reason: a relative error below 35 % is "yes", below 80 % "weak"; a time constant near or beyond a
// third of the record, near the sampling time, or a term that vanishes in more than a tenth of the refits is "no".
void judge_parameters(double record_s, double dt_s, std::vector<ParameterError>* parameters);

struct ValidateSettings {
  ErrorModel truth;
  double duration_s = 6000, dt_s = 1;
  int runs = 100;
  FitSettings fit;
  uint64_t seed = 1;
  int threads = 1;
};
struct Validation {
  int runs = 0;
  double bounded_frac = 0;      // fits that bound the test they were made from, at every tau
  double bounds_truth_frac = 0; // and the expected curve of the truth
  double bounds_new_frac = 0;   // and a new test of the same truth, at every tau
  Spread new_worst_ratio;       // smallest model over data of the new test
  Spread excess_mean, excess_worst, objective_over_grid, fit_ms;
  std::vector<Spread> parameters;              // ln(estimate/truth), where the number of terms is right
  std::vector<double> rms_log_error, coverage; // per parameter (coverage: ml only)
  std::vector<std::string> names;
  std::vector<double> terms_frac; // part of the fits with 0, 1, 2 … Markov terms
};
Validation validate(const ValidateSettings& settings, const DpOperator& op);

} // namespace imucal
