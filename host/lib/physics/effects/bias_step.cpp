// SPDX-License-Identifier: MIT
// The bias jumps at single moments and stays: stress release, a shock, a restarted loop.  Steps belong to one
// log each (its place in the list of logs, from 0).
#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

class BiasStep : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "bias_step"; }
  std::string description() const override {
    return "The bias jumps at single moments of single logs and stays there (stress release, shock).";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"steps", -1e6, 1e6, "list of {log (from 0), t_s, amplitude_dph}", EffectParameter::kSteps}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    check_parameters(*this, parameters);
    for (const auto& step : parameters.at("steps")) {
      if (step.at("log").get<size_t>() != run->log) continue;
      const double start = step.at("t_s").get<double>(), amplitude = step.at("amplitude_dph").get<double>();
      for (size_t i = 0; i < run->rate_dph.size(); ++i)
        if (run->t_s[i] >= start) run->rate_dph[i] += amplitude;
    }
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kSteps; }
  bool needs_temperature() const override { return false; }
  // shape: log, time, log, time, …; one coefficient each.
  Json report(const Theta& shape, const std::vector<double>& coefficients) const override {
    Json steps = Json::array();
    for (size_t i = 0; i < coefficients.size(); ++i)
      steps.push_back({{"log", static_cast<long>(shape[2 * i])},
                       {"t_s", shape[2 * i + 1]},
                       {"amplitude_dph", coefficients[i]}});
    return {{"steps", steps}};
  }
};

} // namespace

const Effect* bias_step_effect() {
  static const BiasStep effect;
  return &effect;
}

} // namespace imucal
