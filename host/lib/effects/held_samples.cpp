// SPDX-License-Identifier: MIT
// The output is sometimes not refreshed: with a probability a second repeats the value before it.
#include "effects/library.h"

namespace imucal {
namespace {

class HeldSamples : public Effect {
public:
  std::string name() const override { return "held_samples"; }
  std::string description() const override {
    return "The output sometimes repeats the value before it (missed update).";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"probability", 0, 1, "probability that a second repeats the one before"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kOutput) return;
    const double probability = effect_number(*this, parameters, "probability");
    for (size_t i = 1; rng && i < run->rate_dph.size(); ++i)
      if (rng->uniform() < probability) run->rate_dph[i] = run->rate_dph[i - 1];
  }
};

} // namespace

const Effect* held_samples_effect() {
  static const HeldSamples effect;
  return &effect;
}

} // namespace imucal
