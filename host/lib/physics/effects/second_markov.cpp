// SPDX-License-Identifier: MIT
// A second first-order Gauss-Markov process beside the nominal one (Berman's model with two instabilities).
#include <cmath>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class SecondMarkov : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "second_markov"; }
  std::string label() const override { return "a second slow (Markov) noise process"; }
  std::string description() const override {
    return "A second first-order Gauss-Markov process beside the nominal one.";
  }
  Family family() const override { return Family::kSlowNoise; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"bias instability with two time scales: electronics and mechanics",
             "IEEE Std 952-1997, annex C, correlated noise"},
            {"slow air currents or temperature wander that the thermometer does not see",
             "compare runs with the device covered"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"sigma_dph", 0, 1e6, "standard deviation"}, {"tau_s", 0.1, 1e6, "time constant"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    SimRun::MarkovPath path;
    path.sigma_dph.assign(run->t_s.size(), parameters.number("sigma_dph"));
    path.tau_s.assign(run->t_s.size(), parameters.number("tau_s"));
    run->markov.push_back(path);
  }

  std::optional<NoiseComponent> closed_form(const Parameters& p, double dt_s) const override {
    return markov_component(std::pow(p.number("sigma_dph"), 2), p.number("tau_s"), dt_s);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool needs_temperature() const override { return false; }
  bool is_slow_noise() const override { return true; }
  std::vector<Theta> starts(const NoiseModel& base) const override {
    return {{0.3 * base.white_sigma_dph, 15}, {0.2 * base.white_sigma_dph, 700}};
  }
  Theta like(const Markov& process) const override { return {process.sigma_dph, process.tau_s}; }
  Theta theta_lo() const override { return {1e-3, 2}; }
  Theta theta_hi() const override { return {1e6, 2e4}; }
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    out.markov.push_back({theta[0], theta[1]});
    return out;
  }
  bool has_markov_spectrum() const override { return true; }
  Parameters values(const Estimate& e) const override {
    return {{"sigma_dph", e.shape_at(0)}, {"tau_s", e.shape_at(1)}};
  }
};

} // namespace

IMUCAL_EFFECT(SecondMarkov)

} // namespace imucal
