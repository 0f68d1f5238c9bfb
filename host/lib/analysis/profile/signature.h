// SPDX-License-Identifier: MIT
// Which effects a profile can tell apart.
//
// The signature of an effect is what it adds to the record of a noise-free sensor, less the nominal polynomial
// of the thermometer.  The simulation of the effect computes it (physics/effects/effect.h).  The signatures are whitened
// by the noise model, and what every calibration estimates anew (polynomial, one turn-on constant per run) is
// projected off, by the Schur complement of the Gram matrix.  If two signatures then have correlation 1, no
// statistical test can tell the two effects apart.  In general the expected margin of the log-likelihood between
// them is d^2/2 (1 - correlation^2), where d is the norm of the whitened signature.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "analysis/profile/covariance.h"
#include "io/model.h"

namespace imucal {

struct SignatureTable {
  std::vector<EffectSpec> effects;
  std::vector<double> correlation;  // of the signatures, row-major; rows of invisible effects are 0
  std::vector<double> strength;     // d: norm of the projected whitened signature at the given parameters
  std::vector<double> visible_frac; // part of the signature's energy (less its constant) that the projection leaves
  // d sqrt(1 - largest correlation^2): what is left of the signature beside the effect most like it.  4 is
  // about what naming an effect takes.
  std::vector<double> separable;
  std::vector<std::string> amplitude; // per effect: its first parameter that is not 0
  std::vector<double> needed;         // value of the effect's first parameter at which separable is 4; 0: invisible
  double mean_separable = 0;          // geometric mean of separable (an invisible effect counts as 1e-6)
  double worst = 0;                   // largest |correlation| of two visible effects
  size_t worst_a = 0, worst_b = 0;
  std::vector<std::string> invisible; // effects with visible_frac below 1e-6: no test can see them on this profile
};

// The effects that are judged when none are given, at the typical size that each of them says (Effect::typical_size):
// thermal lag, dT/dt, hysteresis, turn-on transient, ageing (ramp in time), 4th order (5th for order 4).
std::vector<EffectSpec> standard_effects(int order);
// Effects by name ("thermal_lag,warm_up", short names too) with the standard parameters.
// usage_error lists the names there are.
std::vector<EffectSpec> effects_by_name(const std::string& names, int order);

// The polynomial used where the model has none: the thermal lag acts through it.
ThermalPolynomial standard_polynomial(const CalibrationSetup& setup);

// Judges many profiles by the same effects: what does not depend on the profile is made once.
struct SignatureTask;
class SignatureJudge {
public:
  SignatureJudge(const CalibrationSetup& setup, const std::vector<EffectSpec>& effects);
  SignatureTable operator()(const std::vector<CalibrationRun>& runs) const;

private:
  std::shared_ptr<const SignatureTask> task_;
};

SignatureTable signature_table(const std::vector<CalibrationRun>& runs, const CalibrationSetup& setup,
                               const std::vector<EffectSpec>& effects);

} // namespace imucal
