// SPDX-License-Identifier: MIT
// The white noise depends on temperature: variance times exp(slope x), x the normalised temperature.
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class WhiteNoiseVsTemperature : public Effect {
public:
  std::string name() const override { return "white_noise_vs_temperature"; }
  std::string description() const override {
    return "The white noise (angle random walk) depends on temperature: log-linear variance.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"slope", -20, 20, "change of the log-variance per unit of normalised temperature"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    const double slope = effect_number(*this, parameters, "slope");
    for (size_t i = 0; i < run->white_sigma_dph.size(); ++i)
      run->white_sigma_dph[i] *= std::exp(0.5 * slope * run->bias.normalised(run->gyro_temp_degc[i]));
  }
};

} // namespace

const Effect* white_noise_vs_temperature_effect() {
  static const WhiteNoiseVsTemperature effect;
  return &effect;
}

} // namespace imucal
