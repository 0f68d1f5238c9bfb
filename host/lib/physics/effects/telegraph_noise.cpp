// SPDX-License-Identifier: MIT
// Random telegraph (popcorn, burst) noise: the bias jumps between -A and +A; autocorrelation A^2 exp(-t/tau),
// hence the probability to have switched after dt is (1 - exp(-dt/tau))/2 (Machlup, Noise in semiconductors,
// 1954).
#include <cmath>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class TelegraphNoise : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "telegraph_noise"; }
  std::string label() const override { return "telegraph noise: jumps between two levels"; }
  std::string description() const override {
    return "Random telegraph (popcorn) noise: the bias jumps between two levels.";
  }
  Family family() const override { return Family::kSlowNoise; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"one defect in a transistor or dielectric that captures and frees a charge",
             "Kirton and Uren, Advances in Physics 38 (1989)"},
            {"a loop that hunts between two codes", "look at the raw samples"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph", 0, 1e6, "half the distance of the two levels"}, {"tau_s", 0.1, 1e6, "correlation time"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kNoise) return;
    const double amplitude = parameters.number("amplitude_dph");
    const double tau = parameters.number("tau_s");
    if (!rng) return;
    double level = rng->uniform() < 0.5 ? -amplitude : amplitude;
    for (size_t i = 0; i < run->rate_dph.size(); ++i) {
      const double dt = i ? run->t_s[i] - run->t_s[i - 1] : 0.0;
      if (rng->uniform() < -0.5 * std::expm1(-dt / tau)) level = -level;
      run->rate_dph[i] += level;
    }
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool needs_temperature() const override { return false; }
  bool is_slow_noise() const override { return true; }
  // The second-order twin of a Markov process of the same sigma and tau: started where that one starts.
  std::vector<Theta> starts(const NoiseModel& base) const override {
    return {{0.3 * base.white_sigma_dph, 15}, {0.3 * base.white_sigma_dph, 120}, {0.2 * base.white_sigma_dph, 700}};
  }
  Theta like(const Markov& process) const override { return {process.sigma_dph, process.tau_s}; }
  Theta theta_lo() const override { return {1e-3, 2}; }
  Theta theta_hi() const override { return {1e6, 2e4}; }
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    out.telegraph_dph = theta[0];
    out.telegraph_tau_s = theta[1];
    return out;
  }
  bool has_markov_spectrum() const override { return true; }
  bool is_jumping() const override { return true; }
  Parameters values(const Estimate& e) const override {
    return {{"amplitude_dph", e.shape_at(0)}, {"tau_s", e.shape_at(1)}};
  }
};

} // namespace

IMUCAL_EFFECT(TelegraphNoise)

} // namespace imucal
