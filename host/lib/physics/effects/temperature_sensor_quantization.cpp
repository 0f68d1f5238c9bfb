// SPDX-License-Identifier: MIT
// The thermometer has coarse steps: the log shows lsb round(T / lsb) while the gyro feels T.
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/lagged.h"

namespace imucal {
namespace {

class TemperatureSensorQuantization : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "temperature_sensor_quantization"; }
  std::string label() const override { return "the thermometer's steps are too coarse"; }
  std::string description() const override {
    return "The thermometer has coarse steps, so that the polynomial is fed with a rounded temperature.";
  }
  Family family() const override { return Family::kFunctionOfTemperature; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"few bits of the temperature converter, or rounding in the log",
             "Widrow and Kollar, Quantization Noise (2008)"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"lsb_degc", 1e-6, 100, "step of the thermometer"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kTemperature) return;
    const double lsb = parameters.number("lsb_degc");
    for (double& temp : run->thermometer_degc) temp = lsb * std::round(temp / lsb);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kTemperature; }
  // The shape is the step itself: measured from the logged temperatures, not fitted.
  bool is_near_thermometer() const override { return true; }
  Column temperature(const RunInput& run, const Theta& shape) const override {
    return lagged(run.t_s, run.smooth_degc, nearby_lag_s(shape, 1), 0);
  }
  bool concerns_coarse_thermometer() const override { return true; }
  Parameters values(const Estimate& e) const override { return {{"lsb_degc", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(TemperatureSensorQuantization)

} // namespace imucal
