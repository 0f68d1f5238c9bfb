// SPDX-License-Identifier: MIT
// Settling after power-on: rate += A (1 - w) exp(-t/tau), t from the start of the run (self-heating of die
// and board).  w is the part that is warm already: 0 after a cold start, exp(-off/tau) after a restart that
// follows the run before by a time `off`.  Drawn: log(off/tau) uniform from log(1/10) to log(10).  Settled: w
// = 1.
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/start_state.h"

namespace imucal {
namespace {

class WarmUp : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "warm_up"; }
  std::string label() const override { return "warm-up after switch-on"; }
  std::string description() const override {
    return "Exponential settling after the start of every run (self-heating).";
  }
  Family family() const override { return Family::kFunctionOfTime; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"self-heating of die and board until they are in balance with the case",
             "Titterton and Weston, Strapdown Inertial Navigation Technology (2004)"},
            {"settling of drive loop, references or high voltage after power-on",
             "Acar and Shkel, MEMS Vibratory Gyroscopes (2009)"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph", -1e6, 1e6, "offset at the start of a run from cold"},
            {"tau_s", 1, 1e5, "time constant of the settling"},
            start_parameter()};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = parameters.number("amplitude_dph");
    const double tau = parameters.number("tau_s");
    const double left = drawn_start(parameters, *run, rng);
    run->start_state[name() + ".left_frac"] = left;
    for (size_t i = 0; i < run->rate_dph.size(); ++i)
      run->rate_dph[i] += amplitude * left * std::exp(-(run->t_s[i] - run->t_s[0]) / tau);
  }

  std::optional<TypicalSize> typical_size(int /*order*/) const override {
    return TypicalSize{"warmup", 4, true, {{"amplitude_dph", 30.0}, {"tau_s", 300.0}}};
  }
  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  bool needs_temperature() const override { return false; }
  std::vector<Theta> grid(double, double) const override { return {{40}, {80}, {160}, {320}, {640}, {1280}}; }
  Theta shape_lo() const override { return {20}; }
  Theta shape_hi() const override { return {2500}; }
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    Column column(run.size());
    for (size_t i = 0; i < column.size(); ++i) column[i] = std::exp(-run.t_s[i] / shape[0]);
    return {column};
  }
  // A restart from warm has less of the same in its run.
  std::vector<Column> start_columns(const RunInput& run, const Theta& shape) const override {
    return columns(run, shape);
  }
  bool is_start_a_size() const override { return true; }
  Parameters values(const Estimate& e) const override {
    return {{"amplitude_dph", e.coefficient(0)}, {"tau_s", e.shape_at(0)}};
  }

private:
  // 1 - w.
  double drawn_start(const Parameters& parameters, const SimRun& run, const Rng* rng) const {
    switch (start_of(parameters, run, rng)) {
    case StartState::kSettled:
      return 0;
    case StartState::kCold:
      return 1;
    case StartState::kRandom:
      break;
    }
    const double off_over_tau = std::pow(10.0, 2 * history_of(*this, run).uniform() - 1);
    return -std::expm1(-off_over_tau);
  }
};

} // namespace

IMUCAL_EFFECT(WarmUp)

} // namespace imucal
