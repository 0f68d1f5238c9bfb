// SPDX-License-Identifier: MIT
// Flicker (1/f) noise of bias instability B: one-sided density S(f) = B^2 / (pi f), Allan deviation flat at
// 0.664 B (IEEE Std 952-1997, annex C).  A sum of stationary Gauss-Markov processes whose time constants are r apart, variance
// B^2 ln(r)/pi each (Keshner, 1/f noise, Proc. IEEE 1982): r = 2 in the simulation, 18 of them up to a day; r = 4.5 in the
// estimation, seven up to two hours.  They are constant within a second.  The fastest, 0.6 and 0.9 s, stands for all that is
// faster: the Allan deviation of means of a second is then 0.664 B within 3 % from 1 s on, S(f) that of 1/f between 1e-4 and
// 0.01 Hz (the estimation's from 1e-3 Hz).
#include <cmath>
#include <vector>

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
    for (const Markov& process : ladder(parameters.number("b_dph"), 0.6, 2, 18))
      run->markov.push_back({std::vector<double>(run->t_s.size(), process.sigma_dph),
                             std::vector<double>(run->t_s.size(), process.tau_s)});
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
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    const std::vector<Markov> processes = ladder(theta[0], 0.9, 4.5, 7);
    out.markov.insert(out.markov.end(), processes.begin(), processes.end());
    return out;
  }
  Parameters values(const Estimate& e) const override { return {{"b_dph", e.shape_at(0)}}; }

private:
  static std::vector<Markov> ladder(double b_dph, double first_tau_s, double apart, int n) {
    std::vector<Markov> out;
    for (int k = 0; k < n; ++k)
      out.push_back({b_dph * std::sqrt(std::log(apart) / kPi), first_tau_s * std::pow(apart, k)});
    return out;
  }
};

} // namespace

IMUCAL_EFFECT(FlickerNoise)

} // namespace imucal
