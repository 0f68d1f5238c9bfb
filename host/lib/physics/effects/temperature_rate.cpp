// SPDX-License-Identifier: MIT
// Bias proportional to the rate of temperature change: rate += k dT/dt.  Source: thermal gradients over the
// sensor (Shupe 1980 for fibre gyros; the usual T-dot term of MEMS thermal models).
#include "base/units.h"
#include "physics/effects/estimation.h"
#include "physics/effects/lagged.h"

namespace imucal {
namespace {

class TemperatureRate : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "temperature_rate"; }
  std::string label() const override { return "bias proportional to how fast the temperature changes"; }
  std::string description() const override {
    return "Bias proportional to the rate of change of temperature (Shupe-like gradient term): k dT/dt.";
  }
  Family family() const override { return Family::kThermalMemory; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"temperature gradients across die, package or coil while the temperature moves",
             "Shupe, Applied Optics 19 (1980); Weinberg and Kourepenis, J. MEMS 15 (2006)"},
            {"a thermometer at some distance from the sensing element",
             "Prikhodko et al., Sensors and Actuators A 201 (2013)"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"k_dph_per_degc_min", -1e5, 1e5, "bias per rate of change of temperature, dph per (degC/min)"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double k = parameters.number("k_dph_per_degc_min");
    const std::vector<double>& temp = run->case_temp();
    const size_t n = run->t_s.size();
    for (size_t i = 0; i < n && n > 1; ++i) {
      const size_t before = i ? i - 1 : 0, after = i + 1 < n ? i + 1 : i;
      const double minutes = (run->t_s[after] - run->t_s[before]) / kSecondsPerMinute;
      run->rate_dph[i] += k * (temp[after] - temp[before]) / minutes;
    }
  }

  std::optional<TypicalSize> typical_size(int /*order*/) const override {
    return TypicalSize{"rate", 2, true, {{"k_dph_per_degc_min", 10.0}}};
  }
  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  bool is_near_thermometer() const override { return true; }
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    return {lagged(run.t_s, run.rate_degc_min, nearby_lag_s(shape, 0), 0)};
  }
  double notable() const override { return 0.5; }
  PriorScale prior() const override { return {1, true, 1}; }
  Parameters values(const Estimate& e) const override { return {{"k_dph_per_degc_min", e.coefficient(0)}}; }
};

} // namespace

IMUCAL_EFFECT(TemperatureRate)

} // namespace imucal
