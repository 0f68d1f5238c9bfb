// SPDX-License-Identifier: MIT
// Exact calibration error of a temperature profile, in double, without simulation.
//
// Purpose: tells the covariance of the polynomial that the calibration filter (common/README.md: states b0 … bM and
// the Markov errors) holds after a test, and, where the filter's error model is not the true one, the
// covariance of the error that it actually makes ("truth covariance", Gelb 1974, ch. 7).
//
// Equations.  All samples of one run: y = X b + c 1 + n, row k of X being f(T_k) = [1 Tn … Tn^M],
// Tn = (T - t0)/range.  The Kalman filter with prior P0 = prior_sigma^2 I is generalised least squares:
//     M = X' Vf^-1 X + P0^-1,   b^ = M^-1 X' Vf^-1 y,        believed covariance M^-1,
// Vf: the noise covariance that the filter assumes.  With the true Vt the error of the same estimator has
//     C = M^-1 (U' Vt U + P0^-1) M^-1,   U = Vf^-1 X.
// Vf^-1 is never formed: the noise room whitens every column (e'e = X' Vf^-1 X), solves for U and applies Vt.
// Turn-on constants (one per run, sigma_on) are the term sigma_on^2 1 1' of V, by Sherman-Morrison.  Runs are
// independent: each has its own start of the Markov processes; information adds up.
//
// Memory: n (columns + Markov terms + 2) doubles.  Time: O(n).  8400 s, order 3, one Markov term: below 1 ms.
// Threads: pure functions.
#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "io/log.h"
#include "io/model.h"
#include "io/profile.h"
#include "noise/gains.h"

namespace imucal {

constexpr int kMaxOrder = 5;

// Temperatures of one uninterrupted operation of the device.
struct CalibrationRun {
  std::string name;
  std::vector<double> temp_degc; // one per sample, finite
  double dt_s = 1.0;             // a sample is the mean over this time
  std::vector<double> step_s;    // empty: every step is dt_s; else step_s[k] from sample k-1 to k (gaps)
  double duration_s() const;
};

// A profile as one run, or as one run per repeat (device switched off in between).
std::vector<CalibrationRun> runs_of_profile(const Profile& profile, double dt_s = 1.0, bool restart_each_cycle = false);
// The rows of a log that have a temperature, with the gaps that there are.  data_error: no temperatures.
CalibrationRun run_of_log(const Log& log);

struct CalibrationSetup {
  int order = 3;      // of the polynomial, 0 … kMaxOrder
  double lo_degc = 0; // span of the calibration: Tn = -1 at lo, +1 at hi
  double hi_degc = 0;
  double prior_sigma_dph = kPriorSigma; // of each coefficient
  ErrorModel truth;                     // how the sensor behaves
  ErrorModel filter;                    // what the calibration filter assumes
  bool turn_on_constants = false;       // one constant per run with the models' turn_on_sigma_dph
  // Judge B(T) less its mean over the span: the day-to-day constant is removed anyhow (paper, III).
  bool shape_only = false;
  int points = 61; // temperatures reported, evenly over the span

  double normalised(double temp_degc) const { return (2 * temp_degc - lo_degc - hi_degc) / (hi_degc - lo_degc); }
};

struct CalibrationError {
  std::vector<double> temp_degc;
  std::vector<double> sigma_dph;          // one-sigma error that is made
  std::vector<double> believed_sigma_dph; // what the filter says it is
  double worst_dph = 0, rms_dph = 0;      // over the span: highest of 601 temperatures; mean square, exact
  double believed_worst_dph = 0;
  double duration_s = 0;
  std::vector<double> covariance; // of b0 … bM, row-major [dph^2], in Tn of the setup
  std::vector<double> believed_covariance;
};

// Throws usage_error (reversed range, order) or data_error (no noise at all, fewer distinct temperatures than
// coefficients, no samples), each with the smallest change that makes the request possible.
CalibrationError calibration_error(const std::vector<CalibrationRun>& runs, const CalibrationSetup& setup);

// The filter's information matrix alone (believed covariance^-1 without the prior), row-major, (order+1)^2.
std::vector<double> information_matrix(const std::vector<CalibrationRun>& runs, const CalibrationSetup& setup);

// Columns 0 to order of n rows: powers of the normalised temperature.
void set_powers(const CalibrationRun& run, const CalibrationSetup& setup, Eigen::MatrixXd* columns);

// The samples of a run as the noise room takes them: a view of the run.
SampleTimes sample_times(const CalibrationRun& run);

// Throw as above.  Separate so that programs can refuse before they compute.
void check_setup(const CalibrationSetup& setup);
void check_noise(const ErrorModel& model, const std::string& whose);
void check_distinct_temperatures(const std::vector<CalibrationRun>& runs, int order);

} // namespace imucal
