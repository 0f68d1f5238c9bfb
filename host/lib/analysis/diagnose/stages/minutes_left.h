// SPDX-License-Identifier: MIT
// What an answer leaves in the minutes of held-out rates, beside what noise and errors of the fit are expected to leave in them.
#pragma once
#include <vector>

#include "analysis/diagnose/evidence/constants.h"
#include "analysis/diagnose/evidence/minutes.h"

namespace imucal {

constexpr double kMoreThanNoise = 1.2; // times what is expected: worth a word, and of noise alone no explanation

// Means over a minute (minutes.h), each unit about its mean; rms in dph.
struct MinutesLeft {
  double minute_s = 60;   // length of a mean
  double part_within = 1; // of the held-out rates that are at temperatures that were fitted
  // Without any such rate the residual is that of an extrapolated polynomial, which may be anything.
  bool has_residual() const { return part_within > 0; }

  double rms_before_dph = 0, rms_after_dph = 0;
  bool is_before_least_squares = false; // "before" is a polynomial that no slow noise bends
  double run_to_run_rms_dph = 0; // of what is left: what an effect that differs from run to run by chance would take
  std::vector<Minutes> after;    // of the held-out units
  double ms_after_dph2(bool with_run_to_run) const;

  // What the noise that was found would leave, and its standard error: by how far one draw of that noise scatters; NaN: not known.
  double noise_rms_dph = 0, noise_error_dph = 0;
  // The same by the believed noise, or by that estimated without a cause.
  double believed_rms_dph = 0;
  // Hours of these minutes per hour of the logs on which the noise was estimated; 0: it is believed, or estimated on these too.
  double per_hour_fitted = 0;
  // What the errors of the fitted coefficients are expected to add to the mean square (a polynomial of one log goes astray in
  // others), and its standard deviation.
  double fit_ms_dph2 = 0, fit_ms_error_dph2 = 0;
  double expected_ms_dph2() const { return noise_rms_dph * noise_rms_dph + fit_ms_dph2; } // of noise and these errors

  // What a noise alone would leave, in each log as strong as it is there.
  double rms_of_noise_dph(const NoiseModel& noise) const;
  // Of the mean square above the noise.
  double part_left(bool with_run_to_run = true) const;
  // How many times what is expected is left, without what differs from run to run.
  double times_expected() const;
  // Of noise_rms_dph, by which the minutes exceed it; NaN: its error is not known.
  double errors_above_noise() const;
  // How many times the mean square that is expected is left, or less, in a part p of such logs, by the scatter of noise and
  // errors and, where the fitted logs told the noise, of what they told (the same per hour): the ratio of two such mean
  // squares has an F distribution, of as many degrees of freedom as its scatter has.  NaN: not known.
  double times_square_by_chance(double p) const;
  // Whether more is left than by chance: that of a normal number beyond constants.noise_errors (3: 1 in 740 logs).  What is
  // named as different from run to run is not missed.
  bool exceed_noise(const SelectorConstants& constants) const;
  // So much more that the answer misses something of weight.
  bool leave_mean(const SelectorConstants& constants) const;
};

} // namespace imucal
