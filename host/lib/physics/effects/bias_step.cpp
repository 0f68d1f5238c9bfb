// SPDX-License-Identifier: MIT
// The bias jumps at single moments and stays: stress release, a shock, a restarted loop.  Steps belong to one
// log each (its place in the list of logs, from 0).
#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class BiasStep : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "bias_step"; }
  std::string label() const override { return "sudden steps of the bias"; }
  std::string description() const override {
    return "The bias jumps at single moments of single logs and stays there (stress release, shock).";
  }
  Family family() const override { return Family::kFunctionOfTime; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"release of mechanical stress, a shock, a bump of the chamber", "IEEE Std 1431-2004, shock"},
            {"a control loop that locked anew or changed its range", "look at the status words of the device"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"steps", -1e6, 1e6, "list of {log (from 0), t_s, amplitude_dph}", EffectParameter::kSteps}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    for (const StepValue& step : parameters.steps("steps")) {
      if (step.log != static_cast<long>(run->log)) continue;
      for (size_t i = 0; i < run->rate_dph.size(); ++i)
        if (run->t_s[i] >= step.t_s) run->rate_dph[i] += step.amplitude_dph.value;
    }
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kSteps; }
  bool needs_temperature() const override { return false; }
  // shape: log, time, log, time, …; one coefficient each.
  Parameters values(const Estimate& e) const override {
    std::vector<StepValue> steps;
    for (size_t i = 0; i < e.coefficients.size(); ++i)
      steps.push_back({static_cast<long>(e.shape[2 * i]), e.shape[2 * i + 1], e.coefficient(i)});
    return {{"steps", steps}};
  }
};

} // namespace

IMUCAL_EFFECT(BiasStep)

} // namespace imucal
