// SPDX-License-Identifier: MIT
// The thermometer has coarse steps: the log shows lsb round(T / lsb) while the gyro feels T.
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

class TemperatureSensorQuantization : public Effect, public EffectEstimator {
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

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kTemperature; }
  // The shape is the step itself: measured from the logged temperatures, not fitted.
  Column temperature(const RunInput& run, const Theta&) const override { return run.smooth_degc; }
  Json report(const Theta& shape, const std::vector<double>& /*coefficients*/) const override {
    return {{"lsb_degc", shape.empty() ? 0.0 : shape[0]}};
  }
};

} // namespace

const Effect* temperature_sensor_quantization_effect() {
  static const TemperatureSensorQuantization effect;
  return &effect;
}

} // namespace imucal
