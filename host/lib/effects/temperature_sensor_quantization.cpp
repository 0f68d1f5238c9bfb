// SPDX-License-Identifier: MIT
// The thermometer has coarse steps: the log shows lsb round(T / lsb) while the gyro feels T.
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class TemperatureSensorQuantization : public Effect {
public:
  std::string name() const override { return "temperature_sensor_quantization"; }
  std::string description() const override {
    return "The thermometer has coarse steps, so that the polynomial is fed with a rounded temperature.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"lsb_degc", 1e-6, 100, "step of the thermometer"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kTemperature) return;
    const double lsb = effect_number(*this, parameters, "lsb_degc");
    for (double& temp : run->thermometer_degc) temp = lsb * std::round(temp / lsb);
  }
};

} // namespace

const Effect* temperature_sensor_quantization_effect() {
  static const TemperatureSensorQuantization effect;
  return &effect;
}

} // namespace imucal
