// SPDX-License-Identifier: MIT
// Flicker (1/f) noise of bias instability B: one-sided density S(f) = B^2 / (pi f), Allan deviation flat at
// 0.664 B (IEEE Std 952-1997, annex C).  Simulated as the sum of stationary Gauss-Markov processes with time
// constants 2^k s, 1 s … 2^16 s, variance B^2 ln(2)/pi each: S(f) is then 1/f within 3 % between 1e-4 and
// 0.01 Hz (Keshner, 1/f noise, Proc. IEEE 1982).  The estimation uses seven processes, four times apart.
#include <cmath>

#include "base/units.h"
#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class FlickerNoise : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "flicker_noise"; }
  std::string label() const override { return "flicker (1/f) noise"; }
  std::string description() const override {
    return "Flicker (1/f) noise of bias instability B (IEEE 952): sum of Gauss-Markov processes with "
           "time constants two apart.";
  }
  Family family() const override { return Family::kSlowNoise; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"1/f noise of the front-end electronics",
             "IEEE Std 952-1997, annex C, bias instability; Keshner, Proc. IEEE 70 (1982)"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"b_dph", 0, 1e6, "bias instability B; the Allan deviation is flat at 0.664 B"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    const double variance = std::pow(parameters.number("b_dph"), 2) * std::log(2.0) / kPi;
    for (int k = 0; k <= 16; ++k) {
      SimRun::MarkovPath path;
      path.sigma_dph.assign(run->t_s.size(), std::sqrt(variance));
      path.tau_s.assign(run->t_s.size(), std::ldexp(1.0, k));
      run->markov.push_back(path);
    }
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool needs_temperature() const override { return false; }
  bool is_slow_noise() const override { return true; }
  std::vector<Theta> starts(const NoiseModel& base) const override { return {{0.2 * base.white_sigma_dph}}; }
  // Alike where the Allan deviation is largest: 0.618 sigma there, 0.664 B everywhere.
  Theta like(const Markov& process) const override { return {0.93 * process.sigma_dph}; }
  Theta theta_lo() const override { return {1e-3}; }
  Theta theta_hi() const override { return {1e5}; }
  // Time constants four apart: sigma^2 = B^2 ln(4)/pi each.
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    for (int k = 0; k < 7; ++k)
      out.markov.push_back({theta[0] * std::sqrt(std::log(4.0) / kPi), 2.0 * std::pow(4.0, k)});
    return out;
  }
  Parameters values(const Estimate& e) const override { return {{"b_dph", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(FlickerNoise)

} // namespace imucal
