// SPDX-License-Identifier: MIT
// An unmodelled effect: what a real sensor does and the nominal model leaves out.  This header is the door to
// the simulation side, used by `gyrosim --effects`, and to the words for people; the estimation side is in
// physics/effects/estimation.h.
#pragma once
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/rng.h"
#include "io/model.h"
#include "noise/components.h"
#include "physics/effects/parameters.h"

namespace imucal {

// In which state an effect with a memory begins a run.  Real devices are never thermally reset: the state is
// what their history left.
enum class StartState {
  kRandom, // drawn anew in every run, the same for all axes of the run (they share the history)
  kCold,   // hysteresis came from the far side, lag and creep in equilibrium, warm-up from switched off
  kSettled // everything in equilibrium, nothing left of warm-up, play in the middle
};

// One simulated run of one axis, second by second.  The simulator goes through the stages in order and calls
// every effect at each; an effect changes what belongs to its stage and leaves the rest.
struct SimRun {
  size_t axis = 0, n_axes = 1, log = 0, n_logs = 1; // which of them this is (logs count from 0)
  uint64_t seed = 0;                                // for random draws shared by axes or logs
  const ErrorModel* model = nullptr;                // the nominal model with its polynomial
  StartState start = StartState::kRandom;           // an effect's own parameter `start` goes before it
  std::map<std::string, double> start_state;        // what effects with a memory began with, for the record

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

  const std::vector<double>& case_temp() const { return case_temp_degc.empty() ? gyro_temp_degc : case_temp_degc; }
};

enum class SimStage {
  kTemperature, // thermometer and gyro temperature
  kBias,        // polynomial, deterministic additions
  kNoise,       // noise levels, additional noise; afterwards white and Markov noise are generated
  kOutput       // the complete rate_dph: quantisation, saturation, held samples, …
};

// Effects that leave the same kind of trace and that one profile may fail to tell apart.
enum class Family {
  kThermalMemory,         // the bias depends on the temperatures before
  kFunctionOfTemperature, // a fixed curve over temperature
  kFunctionOfTime,        // a fixed curve over the time since the start
  kSlowNoise,
  kFastNoise,
  kTone,
  kStructural, // what the converter or the recorder did to the samples
  kExternal,   // a cause outside the axis
  kRunToRun
};
std::string family_name(Family family);  // of the contract: "thermal_memory"
std::string family_label(Family family); // for people: "a memory of earlier temperatures"
const std::vector<Family>& all_families();

// What an effect usually is in the hardware, and where that is written.
struct HardwareCause {
  std::string what, source;
};

// What an effect of these parameters is: a sign may turn it round.
struct EffectMeaning {
  std::string label;
  std::vector<HardwareCause> hardware_causes;
  std::string remark; // what the sign says; empty: the label is that of the effect
};

// The size by which profiles are judged: can this effect be told from others at it (profile evaluate)?
struct TypicalSize {
  std::string short_name;  // for command lines
  int place = 0;           // in tables of signatures
  bool is_standard = true; // compared when no effects are named
  Parameters parameters;   // amplitude first
};

class EffectEstimator;

class Effect {
public:
  virtual ~Effect() = default;
  virtual std::string name() const = 0;        // never changed once released
  virtual std::string label() const = 0;       // a few plain words: "thermal hysteresis: …"
  virtual std::string description() const = 0; // one sentence with its source
  virtual Family family() const = 0;
  virtual std::vector<HardwareCause> hardware_causes() const = 0;
  virtual std::vector<EffectParameter> parameters() const = 0;
  virtual EffectMeaning meaning(const Parameters& /*values*/) const { return {label(), hardware_causes(), ""}; }

  // Adds the effect to a run at one stage.  `rng` is the effect's own stream for this run and axis; nullptr
  // asks for the expected, noise-free run: random effects then add nothing (or their mean), phases are zero,
  // a random start state is the cold one.  `parameters`: from read_parameters of this effect.
  // Throws data_error for values that do not go together.
  virtual void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const = 0;

  // The effect as a noise component of samples dt_s apart, where its covariance has a closed form (noise/components.h);
  // parameters from read_parameters.  Empty: it can only be simulated.
  virtual std::optional<NoiseComponent> closed_form(const Parameters& /*parameters*/, double /*dt_s*/) const {
    return std::nullopt;
  }

  // Of an effect with a signature in the mean; `order`: of the polynomial that is fitted.
  virtual std::optional<TypicalSize> typical_size(int /*order*/) const { return std::nullopt; }

  // The form for estimation (physics/effects/estimation.h).
  virtual const EffectEstimator* estimator() const { return nullptr; }
};

// All effects of the library in a fixed order: by family, then by name.  find_effect: data_error lists the
// known names.
const std::vector<const Effect*>& effect_library();
const Effect& find_effect(const std::string& name);
const Effect& find_effect(const EffectSpec& spec); // the message names its place too

// Adds an effect from outside the folder (a test's, a user's) to the library; before anything asks for it.
void add_effect(const Effect& effect);

// The last line of an effect's file: the list of the library is made from these lines.
#define IMUCAL_EFFECT(Type)                                                                                            \
  const Effect* library_entry_##Type() {                                                                               \
    static const Type effect;                                                                                          \
    return &effect;                                                                                                    \
  }

} // namespace imucal
