// SPDX-License-Identifier: MIT
// The time constant of the (first) Markov process depends on temperature: tau times exp(slope x), x the
// normalised temperature; its variance stays.
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class MarkovTauVsTemperature : public Effect {
public:
  std::string name() const override { return "markov_tau_vs_temperature"; }
  std::string description() const override {
    return "The time constant of the bias instability depends on temperature: log-linear.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"slope", -20, 20,
             "change of the logarithm of the time constant per unit of normalised temperature"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    const double slope = effect_number(*this, parameters, "slope");
    if (run->markov.empty()) return;
    std::vector<double>& tau = run->markov[0].tau_s;
    for (size_t i = 0; i < tau.size(); ++i)
      tau[i] *= std::exp(slope * run->bias.normalised(run->gyro_temp_degc[i]));
  }
};

} // namespace

const Effect* markov_tau_vs_temperature_effect() {
  static const MarkovTauVsTemperature effect;
  return &effect;
}

} // namespace imucal
