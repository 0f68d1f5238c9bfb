// SPDX-License-Identifier: MIT
// Small rates read as zero: |rate| < width becomes 0.
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class DeadBand : public Effect {
public:
  std::string name() const override { return "dead_band"; }
  std::string description() const override { return "Small rates read as zero."; }
  std::vector<EffectParameter> parameters() const override {
    return {{"width_dph", 0, 1e7, "rates between minus and plus this read as zero"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kOutput) return;
    const double width = effect_number(*this, parameters, "width_dph");
    for (double& rate : run->rate_dph)
      if (std::fabs(rate) < width) rate = 0.0;
  }
};

} // namespace

const Effect* dead_band_effect() {
  static const DeadBand effect;
  return &effect;
}

} // namespace imucal
