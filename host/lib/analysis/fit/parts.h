// SPDX-License-Identifier: MIT
// Between fit.cpp and the two methods: one axis of all logs, ready to be filtered or solved.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "analysis/fit/factors.h"
#include "analysis/fit/fit.h"
#include "analysis/fit/residual_noise.h"

namespace imucal {

// One axis of one log on a regular grid of seconds; NaN rate: not used (missing, flagged, no temperature).
struct FitRun {
  std::vector<double> rate_dph, temp_degc;
  std::vector<float> noise_ratio; // white variance over that of a whole second
  std::vector<bool> has_row;      // false: the log has no row for this second
  std::vector<uint32_t> flags;    // IMUCAL_FLAG_* (sum.h; a log's bits are the same)
};

// What either method finds, in Chebyshev polynomials of Tn: c0 (mean of the logs' constants), c1 .. cM.
struct ChebyshevFit {
  Eigen::VectorXd coeff;        // M + 1
  Eigen::MatrixXd covariance;   // of these
  std::vector<double> constant; // c0 of each log (one where shared)
  std::string sigma_basis;
  double mean_nis = 0, lag1 = 0;
  long n_refused = 0;
  double expected_residual_dph = 0; // kPolynomial: rms of what the noise leaves beside the polynomial
  std::vector<double> core_coeff;   // kKalman, one log: b_i as the core gives them
};

// What the core's rules say of the runs of one axis.  As on the device, every second goes through
// imucal_health_second and, with a filter, through imucal_kf_update and imucal_health_gate.  Seconds that they leave out
// are marked unused (NaN) in `runs`.  config null: no filter, so no rules on innovations.
struct Checked {
  imucal_health_t health{};
  float lo_degc = 0, hi_degc = 0; // seen, robustly
  bool has_span = false;
};
Checked check_runs(const imucal_health_config_t& expected, const imucal_kf_config_t* config, bool shared_turn_on,
                   std::vector<FitRun>* runs);

// Largest change of temperature within 64 s, as the core's rule of ramps has it, at any distance of the rows.
double fastest_ramp_degc(const std::vector<FitRun>& runs, double dt_s);

// Without a model: the residual is more than the noise that it shows can make.  What is no noise, a loop of hysteresis or a
// slow wave, leaves steps from second to second that are too small for its size.
bool is_beyond_own_noise(const FitAxis& axis);

// Turns verdicts into reasons: the core's rules of each axis, then those over whole logs.
void judge_fit(const FitOptions& options, double dt_s, FitResult* result);

ChebyshevFit fit_kalman(const std::vector<FitRun>& runs, const imucal_kf_config_t& config, bool shared_turn_on);

// Marks as unused what lies far off the polynomial: a second of 1e5 dph would turn the noise of all others into its own.  Only
// for a look at that noise; what is left out of the fit the core's gate decides (check_runs).
void leave_out_far_off(int order, double t0_degc, double range_degc, bool shared_turn_on, std::vector<FitRun>* runs);

// dt_s: step of the grid.
NoiseBelief noise_of_residuals(const std::vector<FitRun>& runs, int order, double t0_degc, double range_degc,
                               double dt_s, bool shared_turn_on);
ChebyshevFit fit_polynomial_qr(const std::vector<FitRun>& runs, int order, double t0_degc, double range_degc,
                               const NoiseBelief& belief, double dt_s, bool shared_turn_on);

} // namespace imucal
