// SPDX-License-Identifier: MIT
// The time constant of the (first) Markov process depends on temperature: tau times exp(slope x), x the
// normalised temperature; its variance stays.
#include <cmath>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class MarkovTauVsTemperature : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "markov_tau_vs_temperature"; }
  std::string label() const override { return "slow noise whose time constant depends on temperature"; }
  std::string description() const override {
    return "The time constant of the bias instability depends on temperature: log-linear.";
  }
  Family family() const override { return Family::kSlowNoise; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"thermally activated defects: the time constant follows an Arrhenius law",
             "Kirton and Uren, Advances in Physics 38 (1989)"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"slope", -20, 20,
             "change of the logarithm of the time constant per unit of Tn = (T - t0)/range of the model's bias (30 and "
             "30 degC without one)"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    const double slope = parameters.number("slope");
    if (run->markov.empty()) return;
    std::vector<double>& tau = run->markov[0].tau_s;
    for (size_t i = 0; i < tau.size(); ++i) tau[i] *= std::exp(slope * run->bias.normalised(run->gyro_temp_degc[i]));
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool is_logarithmic() const override { return false; }
  std::vector<Theta> starts(const NoiseModel&) const override { return {{0.0}}; }
  Theta theta_lo() const override { return {-8}; }
  Theta theta_hi() const override { return {8}; }
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    out.tau_slope = theta[0];
    return out;
  }
  bool is_slow_noise() const override { return true; }
  Parameters values(const Estimate& e) const override { return {{"slope", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(MarkovTauVsTemperature)

} // namespace imucal
