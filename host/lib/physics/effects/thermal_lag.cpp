// SPDX-License-Identifier: MIT
// The gyro is not at the temperature of its thermometer: B(T) is evaluated at a low-passed temperature,
// tau dTg/dt = T - Tg (lumped thermal capacity, Newton's law of cooling), in equilibrium at the start.  A
// negative tau means that the thermometer lags: the gyro is then ahead by |tau| dT/dt.
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

// The gyro's temperature behind (tau > 0) or ahead (tau < 0) of `temp`.
Column lagged(const std::vector<double>& t_s, const std::vector<double>& temp, double tau) {
  const size_t n = temp.size();
  Column out = temp;
  if (n < 2) return out;
  if (tau < 0) {
    for (size_t i = 0; i < n; ++i) {
      const size_t before = i ? i - 1 : 0, after = i + 1 < n ? i + 1 : i;
      out[i] -= tau * (temp[after] - temp[before]) / (t_s[after] - t_s[before]);
    }
    return out;
  }
  // Exact for a temperature that is linear between the seconds (Tg follows a ramp at a distance tau dT/dt).
  double last_dt = -1, a = 0;
  for (size_t i = 1; i < n && tau > 0; ++i) {
    const double dt = t_s[i] - t_s[i - 1];
    if (dt != last_dt) a = std::exp(-dt / tau), last_dt = dt;
    const double distance = tau * (temp[i] - temp[i - 1]) / dt;
    out[i] = a * (out[i - 1] - temp[i - 1] + distance) + temp[i] - distance;
  }
  return out;
}

class ThermalLag : public Effect, public EffectEstimator {
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
    run->gyro_temp_degc = lagged(run->t_s, run->gyro_temp_degc, tau);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kTemperature; }
  std::vector<Theta> grid(double, double) const override {
    std::vector<Theta> taus;
    for (double tau : {-240., -120., -60., -25., 25., 60., 110., 180., 280., 420., 640., 1000., 1500.})
      taus.push_back({tau});
    return taus;
  }
  Theta shape_lo() const override { return {-400}; }
  Theta shape_hi() const override { return {2500}; }
  Column temperature(const RunInput& run, const Theta& shape) const override {
    return lagged(run.t_s, run.smooth_degc, shape[0]);
  }
  double notable() const override { return 150; }
  Json report(const Theta& shape, const std::vector<double>& /*coefficients*/) const override {
    return {{"tau_s", shape[0]}};
  }
};

} // namespace

const Effect* thermal_lag_effect() {
  static const ThermalLag effect;
  return &effect;
}

} // namespace imucal
