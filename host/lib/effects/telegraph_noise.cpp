// SPDX-License-Identifier: MIT
// Random telegraph (popcorn, burst) noise: the bias jumps between -A and +A; autocorrelation A^2 exp(-t/tau),
// hence the probability to have switched after dt is (1 - exp(-dt/tau))/2 (Machlup, Noise in semiconductors,
// 1954).
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class TelegraphNoise : public Effect {
public:
  std::string name() const override { return "telegraph_noise"; }
  std::string description() const override {
    return "Random telegraph (popcorn) noise: the bias jumps between two levels.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph", 0, 1e6, "half the distance of the two levels"},
            {"tau_s", 0.1, 1e6, "correlation time"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kNoise) return;
    const double amplitude = effect_number(*this, parameters, "amplitude_dph");
    const double tau = effect_number(*this, parameters, "tau_s");
    if (!rng) return;
    double level = rng->uniform() < 0.5 ? -amplitude : amplitude;
    for (size_t i = 0; i < run->rate_dph.size(); ++i) {
      const double dt = i ? run->t_s[i] - run->t_s[i - 1] : 0.0;
      if (rng->uniform() < -0.5 * std::expm1(-dt / tau)) level = -level;
      run->rate_dph[i] += level;
    }
  }
};

} // namespace

const Effect* telegraph_noise_effect() {
  static const TelegraphNoise effect;
  return &effect;
}

} // namespace imucal
