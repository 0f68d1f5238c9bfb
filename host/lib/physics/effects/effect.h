// SPDX-License-Identifier: MIT
// An unmodelled effect: what a real sensor does and the nominal model leaves out.  This header is the door to
// the simulation side, used by `gyrosim --effects`; the estimation side is in effects/estimation.h.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "io/model.h"
#include "base/rng.h"

namespace imucal {

// One simulated run of one axis, second by second.  The simulator goes through the stages in order and calls
// every effect at each; an effect changes what belongs to its stage and leaves the rest.
struct SimRun {
  size_t axis = 0, n_axes = 1, log = 0, n_logs = 1; // which of them this is (logs count from 0)
  uint64_t seed = 0;                                // for random draws shared by axes or logs
  const ErrorModel* model = nullptr;                // the nominal model with its polynomial

  std::vector<double> t_s;              // end of each second
  std::vector<double> case_temp_degc;   // the true temperature of the case (the chamber's); effects do not
                                        // change it.  Empty: the effects take gyro_temp_degc for it
  std::vector<double> thermometer_degc; // what the log shows         (stage kTemperature)
  std::vector<double> gyro_temp_degc;   // where B(T) is evaluated     (stage kTemperature)
  ThermalPolynomial bias;               // this run's coefficients     (stage kBias)
  std::vector<double> rate_dph;         // the sum so far: effects of kBias and kNoise add to it

  std::vector<double> white_sigma_dph; // of the 1-s means, per second (stage kNoise may scale it)
  struct MarkovPath {
    std::vector<double> sigma_dph, tau_s; // per second
  };
  std::vector<MarkovPath> markov; // stage kNoise may scale or append

  // Auxiliary columns by name (supply_v, …).  `auxiliary_channel` reads its column or, where there is none,
  // makes one (the same for all axes of a run); the simulator writes what is here into the log.
  std::map<std::string, std::vector<double>> auxiliary;

  const std::vector<double>& case_temp() const {
    return case_temp_degc.empty() ? gyro_temp_degc : case_temp_degc;
  }
};

enum class SimStage {
  kTemperature, // thermometer and gyro temperature
  kBias,        // polynomial, deterministic additions
  kNoise,       // noise levels, additional noise; afterwards white and Markov noise are generated
  kOutput       // the complete rate_dph: quantisation, saturation, held samples, …
};

struct EffectParameter {
  std::string name; // carries its unit
  double lo, hi;    // bounds of what makes sense
  std::string meaning;
  enum Kind { kNumber, kText, kSteps } kind = kNumber; // kSteps: list of {log, t_s, amplitude_dph}
};

class EffectEstimator;

class Effect {
public:
  virtual ~Effect() = default;
  virtual std::string name() const = 0;        // contract: diagnosis.md
  virtual std::string description() const = 0; // one sentence with its source
  virtual std::vector<EffectParameter> parameters() const = 0;

  // Adds the effect to a run at one stage.  `rng` is the effect's own stream for this run and axis; nullptr
  // asks for the expected, noise-free run: random effects then add nothing (or their mean), phases are zero.
  // Throws data_error for parameters that are missing, unknown or out of bounds.
  virtual void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* rng) const = 0;

  // The form for estimation (effects/estimation.h).
  virtual const EffectEstimator* estimator() const { return nullptr; }
};

// All effects of the library, in a fixed order.  find_effect: data_error lists the known names.
const std::vector<const Effect*>& effect_library();
const Effect& find_effect(const std::string& name);

// Throws data_error, naming the place, for parameters that the effect does not take.  For programs that want
// to say so before they start.
void check_parameters(const Effect& effect, const Json& parameters, const std::string& place = "effects");

// One checked number of an effect's parameters.
double effect_number(const Effect& effect, const Json& parameters, const std::string& name);

} // namespace imucal
