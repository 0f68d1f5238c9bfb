// SPDX-License-Identifier: MIT
// The rate is clipped at plus and minus a limit.
#include <algorithm>

#include "effects/library.h"

namespace imucal {
namespace {

class Saturation : public Effect {
public:
  std::string name() const override { return "saturation"; }
  std::string description() const override { return "The rate is clipped at a limit of the output."; }
  std::vector<EffectParameter> parameters() const override {
    return {{"limit_dph", 1e-9, 1e9, "largest rate the output shows, both signs"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kOutput) return;
    const double limit = effect_number(*this, parameters, "limit_dph");
    for (double& rate : run->rate_dph) rate = std::clamp(rate, -limit, limit);
  }
};

} // namespace

const Effect* saturation_effect() {
  static const Saturation effect;
  return &effect;
}

} // namespace imucal
