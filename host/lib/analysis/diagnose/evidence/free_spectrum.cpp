// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/free_spectrum.h"

#include <cmath>

#include "base/units.h"
#include "physics/effects/estimation.h"

namespace imucal {

namespace {

// Sum of Gauss-Markov processes, time constants four apart, variances a power of the time constant (Keshner, 1/f noise, Proc.
// IEEE 1982, generalised).
constexpr int kProcesses = 7;
constexpr double kFastest_s = 2, kApart = 4, kMiddle_s = 128;

class FreeSpectrum : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "free_spectrum"; }
  std::string label() const override { return "slow noise of a free spectrum"; }
  std::string description() const override { return "Noise with a power law between white noise and a random walk."; }
  Family family() const override { return Family::kSlowNoise; }
  std::vector<HardwareCause> hardware_causes() const override { return {}; }
  std::vector<EffectParameter> parameters() const override { return {}; }
  void simulate(SimStage, const Parameters&, SimRun*, Rng*) const override {} // only ever estimated

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kNoise; }
  bool needs_temperature() const override { return false; }
  bool is_slow_noise() const override { return true; }
  std::vector<Theta> starts(const NoiseModel& base) const override {
    std::vector<Theta> starts;
    for (const double exponent : {0.5, 1.0, 1.5}) starts.push_back({0.2 * base.white_sigma_dph, exponent});
    return starts;
  }
  Theta like(const Markov& process) const override { return {0.93 * process.sigma_dph, 1}; }
  Theta theta_lo() const override { return {1e-3, 0.05}; }
  Theta theta_hi() const override { return {1e5, 2}; }
  NoiseModel noise(const NoiseModel& base, const Theta& theta) const override {
    NoiseModel out = base;
    double tau_s = kFastest_s;
    for (int k = 0; k < kProcesses; ++k, tau_s *= kApart) {
      const double variance = std::log(kApart) / kPi * std::pow(tau_s / kMiddle_s, theta[1] - 1);
      out.markov.push_back({theta[0] * std::sqrt(variance), tau_s});
    }
    return out;
  }
  Parameters values(const Estimate&) const override { return {}; }
};

} // namespace

const Effect& free_spectrum() {
  static const FreeSpectrum spectrum;
  return spectrum;
}

} // namespace imucal
