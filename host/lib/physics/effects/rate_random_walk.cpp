// SPDX-License-Identifier: MIT
// The bias performs a random walk, starting at zero in every run: increments over dt have variance K^2 dt.
// Source: rate random walk of IEEE Std 952-1997, annex C (K there per sqrt(h): 60 times this one).
#include <cmath>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class RateRandomWalk : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "rate_random_walk"; }
  std::string label() const override { return "rate random walk"; }
  std::string description() const override {
    return "The bias performs a random walk from the start of every run (rate random walk of IEEE 952).";
  }
  Family family() const override { return Family::kSlowNoise; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"slow random change of stress, charge or alignment without a centre",
             "IEEE Std 952-1997, annex C, rate random walk"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"k_dph_per_rt_s", 0, 1e5, "growth: standard deviation after one second"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kNoise) return;
    const double k = parameters.number("k_dph_per_rt_s");
    if (!rng) return;
    double walk = 0;
    for (size_t i = 1; i < run->rate_dph.size(); ++i) {
      walk += k * std::sqrt(run->t_s[i] - run->t_s[i - 1]) * rng->normal();
      run->rate_dph[i] += walk;
    }
  }

  std::optional<NoiseComponent> closed_form(const Parameters& p, double dt_s) const override {
    return walk_component(std::pow(p.number("k_dph_per_rt_s"), 2) * dt_s);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool needs_temperature() const override { return false; }
  bool is_slow_noise() const override { return true; }
  std::vector<Theta> starts(const NoiseModel& base) const override { return {{0.01 * base.white_sigma_dph}}; }
  // Alike within times that are short against tau.
  Theta like(const Markov& process) const override { return {process.sigma_dph * std::sqrt(2 / process.tau_s)}; }
  Theta theta_lo() const override { return {1e-5}; }
  Theta theta_hi() const override { return {1e4}; }
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    out.walk_dph_per_rt_s = theta[0];
    return out;
  }
  Parameters values(const Estimate& e) const override { return {{"k_dph_per_rt_s", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(RateRandomWalk)

} // namespace imucal
