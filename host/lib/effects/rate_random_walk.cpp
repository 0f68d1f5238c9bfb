// SPDX-License-Identifier: MIT
// The bias performs a random walk, starting at zero in every run: increments over dt have variance K^2 dt.
// Source: rate random walk of IEEE Std 952-1997, annex C (K there per sqrt(h): 60 times this one).
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class RateRandomWalk : public Effect {
public:
  std::string name() const override { return "rate_random_walk"; }
  std::string description() const override {
    return "The bias performs a random walk from the start of every run (rate random walk of IEEE 952).";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"k_dph_per_rt_s", 0, 1e5, "growth: standard deviation after one second"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kNoise) return;
    const double k = effect_number(*this, parameters, "k_dph_per_rt_s");
    if (!rng) return;
    double walk = 0;
    for (size_t i = 1; i < run->rate_dph.size(); ++i) {
      walk += k * std::sqrt(run->t_s[i] - run->t_s[i - 1]) * rng->normal();
      run->rate_dph[i] += walk;
    }
  }
};

} // namespace

const Effect* rate_random_walk_effect() {
  static const RateRandomWalk effect;
  return &effect;
}

} // namespace imucal
