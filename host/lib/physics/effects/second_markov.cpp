// SPDX-License-Identifier: MIT
// A second first-order Gauss-Markov process beside the nominal one (Berman's model with two instabilities).
#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

class SecondMarkov : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "second_markov"; }
  std::string description() const override {
    return "A second first-order Gauss-Markov process beside the nominal one.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"sigma_dph", 0, 1e6, "standard deviation"}, {"tau_s", 0.1, 1e6, "time constant"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    SimRun::MarkovPath path;
    path.sigma_dph.assign(run->t_s.size(), effect_number(*this, parameters, "sigma_dph"));
    path.tau_s.assign(run->t_s.size(), effect_number(*this, parameters, "tau_s"));
    run->markov.push_back(path);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool needs_temperature() const override { return false; }
  bool is_slow_noise() const override { return true; }
  std::vector<Theta> starts(const NoiseModel& base) const override {
    return {{0.3 * base.white_sigma_dph, 15}, {0.2 * base.white_sigma_dph, 700}};
  }
  Theta theta_lo() const override { return {1e-3, 2}; }
  Theta theta_hi() const override { return {1e6, 2e4}; }
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    out.markov.push_back({theta[0], theta[1]});
    return out;
  }
  Json report(const Theta& theta, const std::vector<double>& /*coefficients*/) const override {
    return {{"sigma_dph", theta[0]}, {"tau_s", theta[1]}};
  }
};

} // namespace

const Effect* second_markov_effect() {
  static const SecondMarkov effect;
  return &effect;
}

} // namespace imucal
