// SPDX-License-Identifier: MIT
// The bias follows the square of the rate of temperature change: rate += k (dT/dt)^2, a second-order gradient
// term.  Not one of the contract's names: it stands here as the example of an effect that is one file.
#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class TemperatureRateSquared : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "temperature_rate_squared"; }
  std::string label() const override { return "bias that grows with the square of how fast the temperature changes"; }
  std::string description() const override {
    return "Bias proportional to the square of the rate of change of temperature (second-order gradient "
           "term).";
  }
  Family family() const override { return Family::kThermalMemory; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"heat flow that changes stiffness and offset together", "an example of this project's tests"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"k_dph_per_degc2_min2", -1e5, 1e5, "bias per squared rate of change of temperature"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double k = parameters.number("k_dph_per_degc2_min2");
    const std::vector<double>& temp = run->case_temp();
    const size_t n = run->t_s.size();
    for (size_t i = 0; i < n && n > 1; ++i) {
      const size_t before = i ? i - 1 : 0, after = i + 1 < n ? i + 1 : i;
      const double slope = 60 * (temp[after] - temp[before]) / (run->t_s[after] - run->t_s[before]);
      run->rate_dph[i] += k * slope * slope;
    }
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  std::vector<Column> columns(const RunInput& run, const Theta&) const override {
    Column squares = run.rate_degc_min;
    for (double& rate : squares) rate *= rate;
    return {squares};
  }
  PriorScale prior() const override { return {1, true, 1}; }
  Parameters values(const Estimate& e) const override { return {{"k_dph_per_degc2_min2", e.coefficient(0)}}; }
};

} // namespace

IMUCAL_EFFECT(TemperatureRateSquared)

} // namespace imucal
