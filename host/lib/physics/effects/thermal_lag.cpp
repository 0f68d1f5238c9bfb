// SPDX-License-Identifier: MIT
// The gyro is not at the temperature of its thermometer: B(T) is evaluated at a low-passed temperature,
// tau dTg/dt = T - Tg (lumped thermal capacity, Newton's law of cooling).  A negative tau means that the
// thermometer lags: the gyro is then ahead by |tau| dT/dt, which has no memory.
// Start: the gyro is off its equilibrium by delta, which decays as exp(-t/tau).  Drawn: delta is what a ramp
// as steep as the steepest minutes of this run would have left, times a uniform number from -1 to 1, at most
// half of the temperatures of the run.  Cold and settled: delta = 0.
#include <algorithm>
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/lagged.h"
#include "physics/effects/start_state.h"

namespace imucal {
namespace {

// The distance at which the gyro follows the steepest minute of the run, at most half of its temperatures.
double largest_offset_degc(const std::vector<double>& t_s, const std::vector<double>& temp, double tau) {
  constexpr double kMinute_s = 60;
  double steepest = 0;
  for (size_t i = 0, k = 0; i < temp.size(); ++i) {
    while (k < i && t_s[i] - t_s[k] > kMinute_s) ++k;
    if (k > 0) steepest = std::max(steepest, std::fabs(temp[i] - temp[k]) / (t_s[i] - t_s[k]));
  }
  const auto [lo, hi] = std::minmax_element(temp.begin(), temp.end());
  return std::min(tau * steepest, 0.5 * (*hi - *lo));
}

class ThermalLag : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "thermal_lag"; }
  std::string label() const override { return "the gyro's temperature lags its thermometer"; }
  std::string description() const override {
    return "The gyro lags its thermometer thermally: B is taken at a first-order low-pass of the "
           "temperature (Newton cooling of a lumped capacity).";
  }
  Family family() const override { return Family::kThermalMemory; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"the thermometer sits on another part (housing, other chip) than the sensing element",
             "Prikhodko et al., Sensors and Actuators A 201 (2013)"},
            {"a large thermal mass or poor contact between the two", "Newton cooling of a lumped capacity"}};
  }
  EffectMeaning meaning(const Parameters& values) const override {
    if (values.number_or("tau_s", 0) >= 0) return Effect::meaning(values);
    return {"the thermometer lags the gyro's temperature",
            {{"the thermometer is slow: a large thermal mass of its own, poor contact, or a filter on its readings",
              "response time in the data sheet of the thermometer; settings of driver and log"},
             {"the thermometer sits on another part (housing, other chip) that warms later than the sensing element",
              "Prikhodko et al., Sensors and Actuators A 201 (2013)"}},
            "the thermometer lags the gyro: its time constant is told as a negative one"};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"tau_s", -3000, 30000, "time constant; negative: the thermometer lags the gyro"}, start_parameter()};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kTemperature) return;
    const double tau = parameters.number("tau_s");
    double offset = 0;
    if (tau > 0 && !run->t_s.empty() && start_of(parameters, *run, rng) == StartState::kRandom)
      offset = largest_offset_degc(run->t_s, run->gyro_temp_degc, tau) * (2 * history_of(*this, *run).uniform() - 1);
    run->start_state[name() + ".offset_degc"] = offset;
    run->gyro_temp_degc = lagged(run->t_s, run->gyro_temp_degc, tau, offset);
  }

  std::optional<TypicalSize> typical_size(int /*order*/) const override {
    return TypicalSize{"lag", 1, true, {{"tau_s", 60.0}}};
  }
  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kTemperature; }
  std::vector<Theta> grid(double, double) const override {
    std::vector<Theta> taus;
    for (double tau : {-240., -120., -60., -25., -10., 10., 25., 60., 110., 180., 280., 420., 640., 1000., 1500.})
      taus.push_back({tau});
    return taus;
  }
  Theta shape_lo() const override { return {-400}; }
  Theta shape_hi() const override { return {2500}; }
  Column temperature(const RunInput& run, const Theta& shape) const override {
    return lagged(run.t_s, run.smooth_degc, shape[0], 0);
  }
  // B(Tg + delta exp(-t/tau)) to second order: exp(-t/tau) alone takes 0.99 of the change, worst where the
  // slope of B turns while it decays; with its square 0.999.
  std::vector<Column> start_columns(const RunInput& run, const Theta& shape) const override {
    if (shape[0] <= 0) return {};
    Column first(run.size()), second(run.size());
    for (size_t i = 0; i < first.size(); ++i) {
      first[i] = std::exp(-run.t_s[i] / shape[0]);
      second[i] = first[i] * first[i];
    }
    return {first, second};
  }
  bool is_only_nearby(const Theta& shape) const override { return std::fabs(shape[0]) < kNearby_s; }
  double notable() const override { return 150; }
  PriorScale prior() const override { return {1, false, 2}; }
  Parameters values(const Estimate& e) const override { return {{"tau_s", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(ThermalLag)

} // namespace imucal
