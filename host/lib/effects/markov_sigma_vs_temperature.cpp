// SPDX-License-Identifier: MIT
// The strength of the (first) Markov process depends on temperature: variance times exp(slope x), x the
// normalised temperature.
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class MarkovSigmaVsTemperature : public Effect {
public:
  std::string name() const override { return "markov_sigma_vs_temperature"; }
  std::string description() const override {
    return "The strength of the bias instability depends on temperature: log-linear variance of the "
           "Markov process.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"slope", -20, 20, "change of the log-variance per unit of normalised temperature"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    const double slope = effect_number(*this, parameters, "slope");
    if (run->markov.empty()) return;
    std::vector<double>& sigma = run->markov[0].sigma_dph;
    for (size_t i = 0; i < sigma.size(); ++i)
      sigma[i] *= std::exp(0.5 * slope * run->bias.normalised(run->gyro_temp_degc[i]));
  }
};

} // namespace

const Effect* markov_sigma_vs_temperature_effect() {
  static const MarkovSigmaVsTemperature effect;
  return &effect;
}

} // namespace imucal
