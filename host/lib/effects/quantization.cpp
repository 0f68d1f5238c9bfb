// SPDX-License-Identifier: MIT
// The rate is rounded to a lattice: lsb round(rate / lsb).
#include <cmath>

#include "effects/library.h"

namespace imucal {
namespace {

class Quantization : public Effect {
public:
  std::string name() const override { return "quantization"; }
  std::string description() const override { return "The rate is rounded to a coarse lattice."; }
  std::vector<EffectParameter> parameters() const override {
    return {{"lsb_dph", 1e-9, 1e7, "step of the output"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kOutput) return;
    const double lsb = effect_number(*this, parameters, "lsb_dph");
    for (double& rate : run->rate_dph) rate = lsb * std::round(rate / lsb);
  }
};

} // namespace

const Effect* quantization_effect() {
  static const Quantization effect;
  return &effect;
}

} // namespace imucal
