// SPDX-License-Identifier: MIT
// Offline calibration: from recorded logs to the thermal polynomial with its predicted error, two ways.
//
//   kKalman      the C core itself (common/kf.c), second by second in float32 as on the device.  From one log it
//                gives the coefficients that the device would send, bit for bit.
//   kPolynomial  least squares on scaled variables (Chebyshev polynomials) by Householder QR with column pivoting.
//                Without a model the noise is what the residuals show (residual_noise.h).  On 8400-s tests of the paper's model
//                its predicted error holds the true one in 72 % (one sigma) and 96 % (two); of slow noise of 400 s in
//                79 and 97 %, of 1000 s in 60 and 89 %; of 40 dph over 3 s beside 20 dph over 100 s in 73 and 96 %, over 300 s in
//                78 and 97 % (test_fit.cpp, test_fit_noise.cpp): a record must be long against its slow noise.
//
// Several logs are runs of one device with power cycles between.  Each has its own turn-on constant (unless
// shared_turn_on): rate = b0 + a_l + sum_{i>=1} b_i Tn^i + noise in log l, with sum_l a_l = 0; b0 is the mean.
//   kKalman: before each further log the core forgets the Markov state and the constant term (imucal_kf_new_run).
//   At the end the constants of the earlier logs are computed again from the final values of the other coefficients.
//   This is exact: given the others, c0 is Gaussian, and the filter's factors hold its regression on them.
//   kPolynomial: one column of ones per log.
#pragma once
#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "analysis/fit/renewal.h"
#include "base/axis_unit.h"
#include "health.h"
#include "io/log.h"
#include "io/model.h"
#include "kf.h"
#include "noise/noise_model.h"
#include "table.h"

namespace imucal {

constexpr double kMaxErrorDph = 100, kMaxErrorMg = 10;

struct FitOptions {
  enum class Method { kKalman, kPolynomial };
  Method method = Method::kKalman;
  int order = 3;                             // 1..5
  std::optional<ErrorModel> model;           // kKalman: required; kPolynomial: makes sigma honest (see FitAxis)
  std::optional<ErrorModel> accel_model;     // of the accelerometers, where `model` is the gyros' (unit "mg")
  std::optional<double> t0_degc, range_degc; // else the model's bias, else middle and half width of the logs' span
  double prior_sigma_dph = kPriorSigma;      // kKalman: of every coefficient
  bool shared_turn_on = false;               // all logs have one constant
  std::vector<std::string> axes;   // empty: every axis of the models' units that are stated, else every gyro of
                                   // the first log (every axis where it has none)
  bool ignore_metadata = false;    // logs of different devices or serial numbers
  std::vector<std::string> accept; // rules (fit_rules) that shall not refuse
  double max_error_dph = 0;        // as in JudgeOptions

  const std::optional<ErrorModel>& model_of(const std::string& axis) const;
};

// Something that speaks against an axis: a rule of the core (common/health.h) or one of a whole log (see fit_rules).
struct FitReason {
  std::string axis, rule;
  double value = 0, limit = 0;
  std::string text;         // one sentence with the figures and what to do
  bool is_accepted = false; // named in FitOptions::accept
};

struct FitAxis {
  std::string axis; // column name in internal units: gx_dph, ax_mg
  int order = 0;
  double t0_degc = 0, range_degc = 1;
  std::vector<double> coeff_dph;             // b0 .. bM (mg for accelerometers)
  std::vector<double> covariance_dph2;       // of the coefficients, row-major (M+1) x (M+1)
  double span_lo_degc = 0, span_hi_degc = 0; // temperatures seen, inside t0 +- range: the table's valid span
  std::vector<double> temp_degc, sigma_dph;  // predicted one-sigma error of B(T) at 9 temperatures of the span
  std::string sigma_basis;                   // "filter", "model" or "residuals" (no model was given)
  std::optional<NoiseModel> residual_noise;  // the likeliest by the residuals, where sigma rests on them
  std::vector<double> turn_on_dph;           // a_l, one per log, mean 0; empty for one log or shared_turn_on
  double residual_rms_dph = 0;               // rate - B(T) - a_l over all seconds used
  double expected_residual_dph = 0; // of residual_noise, what it leaves beside the polynomial; 0: a model was given
  double dt_s = 1;                  // step of the rows that n_used and n_missing count
  long n_used = 0, n_missing = 0;   // seconds used; flagged, empty, refused or missing between the first and last
  Renewal renewal;                  // of the thermometer, where a log's quantum is known and it is renewed seldom
  double renewal_cost_dph = 0;      // what its delay may have cost
  double repeated_frac = 0;         // of the seconds, those that repeat the one before beyond chance (base/repeats.h)
  double lossy_frac = 0;            // of the seconds used, those in which samples are missing
  double mean_nis = 0, lag1 = 0;    // kKalman: innovation statistics (1 and 0 with a right model)
  imucal_health_verdict_t health{}; // the core's rules; those that compare with a model only where one was given
  long n_rejected = 0, n_bad_temperature = 0; // seconds left out: knocks, readings that no thermometer reaches
  std::string first_left_out;                 // "LOG at T s" of the first one, empty where there is none
  long n_far_off = 0;                  // single seconds far off the polynomial, where the rules speak of the rate
  std::string first_far_off;           // "LOG at T s"
  std::vector<std::string> not_judged; // rules that the logs, or no model, leave without a verdict
  double error_factor = 1;             // how many times sigma_dph is too small by what the innovations say
  const char* unit() const { return axis_unit(axis); } // of every member named _dph
  double worst_sigma_dph() const { return *std::max_element(sigma_dph.begin(), sigma_dph.end()); }
  // What is said of `renewal` where no rule (temp-held) says it; empty: nothing.
  std::string renewal_note() const;
  // Gravity along the axis, as it lay in the test: a static test cannot tell it from the bias.
  bool holds_gravity() const { return is_accelerometer(axis); }
  double bias_dph(double temp_degc) const;
  double bias_sigma_dph(double temp_degc) const;
};

struct FitResult {
  FitOptions::Method method = FitOptions::Method::kKalman;
  std::vector<std::string> logs;
  std::vector<FitAxis> axes;         // empty: never ran
  std::vector<std::string> warnings; // e.g. several Markov terms merged for the filter
  std::optional<ErrorModel> model, accel_model;
  std::map<std::string, std::string> metadata; // of the first log
  std::vector<FitReason> reasons;              // empty: nothing speaks against it
  bool is_accepted() const;                    // every reason was accepted beforehand
};

// Names of all rules: those of the core, and over a whole log
//   repeated      also: rows that repeat the one before, more than by chance (sample and hold; base/repeats.h)
//   residual      rate - B(T), rms over what the model predicts: 4 standard deviations beyond 1.5 in variance; without a
//                 model over what the noise makes that the residuals themselves show: 1.5 in variance
//   temp-held     the thermometer is renewed so seldom that the delay may have cost more than the predicted error (renewal.h)
//   measurements  an axis with less than 90 % of the seconds of the best one
//   error         worst predicted error above max_error_dph
//   units         temperatures above 200 degC throughout (kelvin?), rows 1000 s apart (milliseconds?)
std::vector<std::string> fit_rules();

// usage_error: kKalman without model, order outside 1..5.  data_error names the log and what is wrong: axis missing,
// no temperature, temperature that never moves (span below 0.5 degC), fewer seconds than coefficients, other sample
// interval, span outside t0 +- range, coefficients not determined, logs of different devices (the key, both values).
// Every second goes through the core's health rules and its gate first: what they leave out is counted and not learnt.
FitResult fit_logs(const std::vector<Log>& logs, const FitOptions& options);

// The filter's configuration for a model: m, q, r computed in double.  Several Markov terms become one of the same
// variance and the same density at low frequency (sigma^2 = sum sigma_i^2, tau = sum sigma_i^2 tau_i/sigma^2).
// other_white_dph2: white variance of a row besides the model's, e.g. from quantisation.
// data_error: no white noise, or a value the core refuses.
imucal_kf_config_t kf_config(const ErrorModel& model, int order, double t0_degc, double range_degc,
                             double prior_sigma_dph = kPriorSigma, double dt_s = 1.0, double other_white_dph2 = 0);

// What a table holds besides the fit.  What is not given here is taken from the first log's metadata: serial,
// <stem>_counts_scale_dph (or _mg), <stem>_full_scale_counts, temp_counts_scale_degc, temp_counts_offset_degc; else
// from the defaults named.  data_error: no serial anywhere, text where a number belongs, a table the core refuses.
struct TableInfo {
  std::string serial;
  uint32_t created_s = 0;                             // 0: now
  std::optional<double> degc_per_count, degc_at_zero; // 0.01, 25
  std::optional<double> unit_per_count;               // 18 dph (1 mg) per count
  std::optional<long> full_scale_counts;              // 32767
};
imucal_table_t make_table(const FitResult& result, const TableInfo& info);

} // namespace imucal
