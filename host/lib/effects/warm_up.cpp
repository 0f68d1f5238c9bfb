// SPDX-License-Identifier: MIT
// Settling after power-on, the same in every run: rate += A exp(-t/tau), t from the start of the run
// (self-heating of die and board).
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class WarmUp : public Effect {
public:
  std::string name() const override { return "warm_up"; }
  std::string description() const override {
    return "Exponential settling after the start of every run (self-heating).";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph", -1e6, 1e6, "offset at the start of the run"},
            {"tau_s", 1, 1e5, "time constant of the settling"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = effect_number(*this, parameters, "amplitude_dph");
    const double tau = effect_number(*this, parameters, "tau_s");
    for (size_t i = 0; i < run->rate_dph.size(); ++i)
      run->rate_dph[i] += amplitude * std::exp(-(run->t_s[i] - run->t_s[0]) / tau);
  }
};

} // namespace

const Effect* warm_up_effect() {
  static const WarmUp effect;
  return &effect;
}

} // namespace imucal
