// SPDX-License-Identifier: MIT
// An error model as a list of independent components.  Each has its power and its covariance.  The closed forms,
// the fits and the simulation all use this list.
//
// The model's own terms stand here; an effect of the model is asked for its closed form (physics/effects/closed_forms.h).
#pragma once
#include <string>
#include <vector>

#include "io/model.h"

namespace imucal {

struct NoiseComponent {
  enum class Kind { kWhite, kMarkov, kAngleQuantization, kRandomWalk, kRamp, kSinusoid };
  Kind kind = Kind::kWhite;
  // White, Markov: variance of a sample [dph^2].  Angle quantisation: variance of one of the two angle errors,
  // as rate.  Random walk: variance of a step.  Ramp: (slope per sample)^2.  Sinusoid: amplitude^2.
  double power_dph2 = 0;
  double alpha = 0;     // Markov: dt/tau
  double omega_rad = 0; // sinusoid: phase per sample

  bool is_stationary() const { return kind != Kind::kRandomWalk && kind != Kind::kRamp; }
};

// White noise and Markov terms of the model; not its effects.  The thermal polynomial and the turn-on constant are not
// noise: they are detrended or estimated.
std::vector<NoiseComponent> model_components(const ErrorModel& model, double dt_s = 1.0);
NoiseComponent white_component(double variance_dph2);
NoiseComponent markov_component(double variance_dph2, double tau_s, double dt_s = 1.0);
NoiseComponent walk_component(double step_variance_dph2);
NoiseComponent ramp_component(double slope_dph_per_sample);
NoiseComponent sinusoid_component(double amplitude_dph, double omega_rad_per_sample);
NoiseComponent angle_component(double angle_error_dph); // standard deviation of one of the two angle errors, as rate

// Variance of the sum of k samples [dph^2], less the part that a constant would have (power * k^2 for Markov).
// AV and DP1 do not see constants: for them nothing is missing, no digits are lost, and the random walk has a
// value too.  White r k; Markov -2 power sum_{l<k} (k-l)(1-phi^l); angle quantisation 2 power;
// random walk -power k (k^2-1)/6; ramp and sinusoid have none (internal error).
double sum_variance(const NoiseComponent& component, double k);

// C v for the covariance matrix C of consecutive samples.  Random walk: the generalised covariance
// -power |i-j| / 2, which is right only where constants are projected out.  Not for ramp and sinusoid.
std::vector<double> covariance_times(const NoiseComponent& component, const std::vector<double>& v);

} // namespace imucal
