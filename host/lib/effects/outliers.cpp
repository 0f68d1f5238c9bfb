// SPDX-License-Identifier: MIT
// Rare wrong samples: each 1-s mean is hit with a probability and then gets an additional N(0, sigma^2)
// (contaminated normal of Tukey 1960).
#include "effects/library.h"

namespace imucal {
namespace {

class Outliers : public Effect {
public:
  std::string name() const override { return "outliers"; }
  std::string description() const override {
    return "Rare wrong samples: contaminated normal noise (Tukey).";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"probability", 0, 1, "probability that a second is hit"},
            {"sigma_dph", 0, 1e7, "standard deviation of the hit"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kNoise) return;
    const double probability = effect_number(*this, parameters, "probability");
    const double sigma = effect_number(*this, parameters, "sigma_dph");
    for (size_t i = 0; rng && i < run->rate_dph.size(); ++i)
      if (rng->uniform() < probability) run->rate_dph[i] += sigma * rng->normal();
  }
};

} // namespace

const Effect* outliers_effect() {
  static const Outliers effect;
  return &effect;
}

} // namespace imucal
