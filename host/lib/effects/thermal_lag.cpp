// SPDX-License-Identifier: MIT
// The gyro is not at the temperature of its thermometer: B(T) is evaluated at a low-passed temperature,
// tau dTg/dt = T - Tg (lumped thermal capacity, Newton's law of cooling), in equilibrium at the start.  A
// negative tau means that the thermometer lags: the gyro is then ahead by |tau| dT/dt.
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class ThermalLag : public Effect {
public:
  std::string name() const override { return "thermal_lag"; }
  std::string description() const override {
    return "The gyro lags its thermometer thermally: B is taken at a first-order low-pass of the "
           "temperature (Newton cooling of a lumped capacity).";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"tau_s", -3000, 30000, "time constant; negative: the thermometer lags the gyro"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kTemperature) return;
    const double tau = effect_number(*this, parameters, "tau_s");
    const std::vector<double> temp = run->gyro_temp_degc;
    const size_t n = temp.size();
    if (n < 2) return;
    if (tau < 0) {
      for (size_t i = 0; i < n; ++i) {
        const size_t before = i ? i - 1 : 0, after = i + 1 < n ? i + 1 : i;
        run->gyro_temp_degc[i] += -tau * (temp[after] - temp[before]) / (run->t_s[after] - run->t_s[before]);
      }
      return;
    }
    // Exact for a temperature that is linear between the seconds (Tg follows a ramp at a distance tau dT/dt).
    double gyro = temp[0];
    for (size_t i = 1; i < n && tau > 0; ++i) {
      const double dt = run->t_s[i] - run->t_s[i - 1], a = std::exp(-dt / tau),
                   slope = (temp[i] - temp[i - 1]) / dt;
      gyro = a * (gyro - temp[i - 1] + tau * slope) + temp[i] - tau * slope;
      run->gyro_temp_degc[i] = gyro;
    }
  }
};

} // namespace

const Effect* thermal_lag_effect() {
  static const ThermalLag effect;
  return &effect;
}

} // namespace imucal
