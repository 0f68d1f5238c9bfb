// SPDX-License-Identifier: MIT
// A tone (supply ripple, vibration or its alias): rate += A sin(2 pi f t + phase), the phase drawn for every
// run. A is the amplitude as it stands in the 1-s means, after their averaging; a frequency above 0.5 Hz
// appears at its alias, and the log cannot tell which of them it was.
#include <cmath>

#include "base/units.h"
#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

class Sinusoid : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "sinusoid"; }
  std::string description() const override {
    return "A tone with a random phase in every run (interference, vibration), seen in 1-s means: known "
           "only modulo the sampling.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph", 0, 1e6, "amplitude in the 1-s means"},
            {"frequency_hz", 1e-6, 1e5, "frequency"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = effect_number(*this, parameters, "amplitude_dph");
    const double frequency = effect_number(*this, parameters, "frequency_hz");
    const double phase = rng ? 2 * kPi * rng->uniform() : 0.0;
    for (size_t i = 0; i < run->rate_dph.size(); ++i)
      run->rate_dph[i] += amplitude * std::sin(2 * kPi * frequency * run->t_s[i] + phase);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kTone; }
  bool needs_temperature() const override { return false; }
  Json report(const Theta& shape, const std::vector<double>& coefficients) const override {
    return {{"amplitude_dph", coefficients[0]}, {"frequency_hz", shape[0]}};
  }
};

} // namespace

const Effect* sinusoid_effect() {
  static const Sinusoid effect;
  return &effect;
}

} // namespace imucal
