// SPDX-License-Identifier: MIT
// Slow settling after a change of temperature, over decades of time: rate += a (T - mean of x_i), where the
// x_i follow T with time constants tau_i spread evenly in log time from tau_first to tau_last:
// tau_i dx_i/dt = T - x_i.  After a step of T the bias is off by a times the step and comes back as
// [E1(t/tau_last) - E1(t/tau_first)]/ln(tau_last/tau_first), nearly linear in log t in between.
// Source: viscoelastic relaxation with a box spectrum in log time (Fung, Biomechanics, 1993, section 7.6;
// Lakes, Viscoelastic Materials, 2009): adhesives, moulding compounds and solder under thermal stress. Start:
// each x_i is off T by what an earlier change of temperature left of itself, delta exp(-since/tau_i). Drawn:
// delta uniform between minus and plus half of the temperatures of the run, `since` uniform in log time
// between the two time constants.  Cold and settled: delta = 0.
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/error.h"
#include "physics/effects/estimation.h"
#include "physics/effects/start_state.h"

namespace imucal {
namespace {

// Time constants in the middle of equal steps of log time, `step` wide at most.
std::vector<double> time_constants(double first_s, double last_s, double step) {
  const double decades = std::log(last_s / first_s);
  const int n = std::max(1, static_cast<int>(std::ceil(decades / step)));
  std::vector<double> taus;
  for (int i = 0; i < n; ++i) taus.push_back(first_s * std::exp(decades * (i + 0.5) / n));
  return taus;
}

// The mean of T - x_i; exact for a temperature that is linear between the seconds.  `offset_degc`: T - x_i at the start, one per
// time constant.
Column mean_behind(const std::vector<double>& t_s, const std::vector<double>& temp, const std::vector<double>& taus,
                   const std::vector<double>& offset_degc) {
  Column sum(temp.size(), 0.0);
  std::vector<double> decay(taus.size()), behind = offset_degc;
  const double weight = 1.0 / static_cast<double>(taus.size());
  double last_dt = -1;
  for (size_t i = 0; i < temp.size(); ++i) {
    if (i > 0) {
      const double dt = t_s[i] - t_s[i - 1], slope = (temp[i] - temp[i - 1]) / dt;
      for (size_t j = 0; dt != last_dt && j < taus.size(); ++j) decay[j] = std::exp(-dt / taus[j]);
      last_dt = dt;
      for (size_t j = 0; j < taus.size(); ++j) {
        const double distance = taus[j] * slope; // to which a steady ramp tends
        behind[j] = decay[j] * (behind[j] - distance) + distance;
      }
    }
    for (const double degc : behind) sum[i] += weight * degc;
  }
  return sum;
}

constexpr double kStep = 0.35; // of log time: the sum is the integral within 2e-3 of its start value

class ThermalCreep : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "thermal_creep"; }
  std::string label() const override { return "slow creep of the bias after a change of temperature"; }
  std::string description() const override {
    return "Slow settling after a change of temperature, spread evenly in log time between two time "
           "constants "
           "(viscoelastic relaxation with a box spectrum).";
  }
  Family family() const override { return Family::kThermalMemory; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"die attach, moulding compound or underfill that creeps under thermal stress",
             "Lakes, Viscoelastic Materials (2009)"},
            {"solder joints and board that relax after a change of temperature",
             "Acar and Shkel, MEMS Vibratory Gyroscopes (2009), packaging"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph_per_degc", -1e5, 1e5, "offset just after a change of temperature by one degree"},
            {"tau_first_s", 0.1, 1e7, "shortest time constant of the settling"},
            {"tau_last_s", 0.1, 1e8, "longest time constant of the settling"},
            start_parameter()};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = parameters.number("amplitude_dph_per_degc");
    const double first = parameters.number("tau_first_s"), last = parameters.number("tau_last_s");
    if (last < first)
      throw data_error("effects: " + name() + ": tau_last_s is shorter than tau_first_s: exchange them");
    const std::vector<double>& temp = run->case_temp();
    if (temp.empty()) return;
    const Start start = drawn_start(parameters, *run, rng, first, last);
    run->start_state[name() + ".offset_degc"] = start.offset_degc;
    run->start_state[name() + ".since_s"] = start.since_s;
    const std::vector<double> taus = time_constants(first, last, kStep);
    std::vector<double> offset_degc;
    for (const double tau : taus) offset_degc.push_back(start.offset_degc * std::exp(-start.since_s / tau));
    const Column behind = mean_behind(run->t_s, temp, taus, std::move(offset_degc));
    for (size_t i = 0; i < behind.size(); ++i) run->rate_dph[i] += amplitude * behind[i];
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  std::vector<Theta> grid(double, double) const override {
    return {{20, 1500}, {20, 6000}, {20, 60000}, {200, 6000}, {200, 60000}, {2000, 60000}};
  }
  // What settles within minutes is the housing between thermometer and element, not stress that relaxes: T - x of a short
  // time constant is that time constant times the rate of temperature.
  Theta shape_lo() const override { return {5, kShortestLast_s}; }
  Theta shape_hi() const override { return {5000, 2e5}; }
  bool is_shown_in(double log_s, const Theta& shape) const override { return shape[0] < log_s / kLeastSpan; }
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    const std::vector<double> taus = time_constants(shape[0], last_s(shape), kStep);
    return {mean_behind(run.t_s, run.smooth_degc, taus, std::vector<double>(taus.size(), 0.0))};
  }
  // Any earlier change of temperature: exponentials a factor of five apart span their sums (least 0.999).
  std::vector<Column> start_columns(const RunInput& run, const Theta& shape) const override {
    std::vector<Column> columns;
    for (const double tau : time_constants(shape[0], last_s(shape), std::log(kStartFactor))) {
      Column decay(run.size());
      for (size_t i = 0; i < decay.size(); ++i) decay[i] = std::exp(-run.t_s[i] / tau);
      columns.push_back(decay);
    }
    return columns;
  }
  PriorScale prior() const override { return {1.5, true, 1}; }
  Parameters values(const Estimate& e) const override {
    const Measured first = e.shape_at(0);
    Measured last = e.shape_at(1);
    last.value = last_s({first.value, last.value});
    return {{"amplitude_dph_per_degc", e.coefficient(0)}, {"tau_first_s", first}, {"tau_last_s", last}};
  }

private:
  // Stress relaxes over decades of time: what has one time constant is a lag, and is looked for as one.
  static double last_s(const Theta& shape) { return std::max(kNarrowest * shape[0], shape[1]); }
  static constexpr double kNarrowest = 10;
  static constexpr double kStartFactor = 5;
  static constexpr double kLeastSpan = 6;        // from the first time constant to the end of a log
  static constexpr double kShortestLast_s = 600; // housings: one to ten minutes
  struct Start {
    double offset_degc = 0, since_s = 0;
  };

  Start drawn_start(const Parameters& parameters, const SimRun& run, const Rng* rng, double first_s,
                    double last_s) const {
    if (start_of(parameters, run, rng) != StartState::kRandom) return {};
    Rng history = history_of(*this, run);
    const auto [lo, hi] = std::minmax_element(run.case_temp().begin(), run.case_temp().end());
    const double part = 2 * history.uniform() - 1;
    return {0.5 * part * (*hi - *lo), first_s * std::pow(last_s / first_s, history.uniform())};
  }
};

} // namespace

IMUCAL_EFFECT(ThermalCreep)

} // namespace imucal
