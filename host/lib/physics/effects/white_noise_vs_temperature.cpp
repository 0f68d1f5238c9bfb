// SPDX-License-Identifier: MIT
// The white noise depends on temperature: variance times exp(slope x), x the normalised temperature.
#include <cmath>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class WhiteNoiseVsTemperature : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "white_noise_vs_temperature"; }
  std::string label() const override { return "white noise that depends on temperature"; }
  std::string description() const override {
    return "The white noise (angle random walk) depends on temperature: log-linear variance.";
  }
  Family family() const override { return Family::kFastNoise; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"thermal noise of front end and damping grow with temperature",
             "Leland, Mechanical-thermal noise in MEMS gyroscopes, IEEE Sensors J. 5 (2005)"},
            {"quality factor and drive amplitude change with temperature",
             "Acar and Shkel, MEMS Vibratory Gyroscopes (2009)"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"slope", -20, 20,
             "change of the log-variance per unit of Tn = (T - t0)/range of the model's bias (30 and 30 degC without "
             "one)"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    const double slope = parameters.number("slope");
    for (size_t i = 0; i < run->white_sigma_dph.size(); ++i)
      run->white_sigma_dph[i] *= std::exp(0.5 * slope * run->bias.normalised(run->gyro_temp_degc[i]));
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool is_logarithmic() const override { return false; }
  std::vector<Theta> starts(const NoiseModel&) const override { return {{0.0}}; }
  Theta theta_lo() const override { return {-12}; }
  Theta theta_hi() const override { return {12}; }
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    out.white_slope = theta[0];
    return out;
  }
  Parameters values(const Estimate& e) const override { return {{"slope", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(WhiteNoiseVsTemperature)

} // namespace imucal
