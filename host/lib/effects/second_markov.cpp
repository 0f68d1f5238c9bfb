// SPDX-License-Identifier: MIT
// A second first-order Gauss-Markov process beside the nominal one (Berman's model with two instabilities).
#include "effects/library.h"

namespace imucal {
namespace {

class SecondMarkov : public Effect {
public:
  std::string name() const override { return "second_markov"; }
  std::string description() const override {
    return "A second first-order Gauss-Markov process beside the nominal one.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"sigma_dph", 0, 1e6, "standard deviation"}, {"tau_s", 0.1, 1e6, "time constant"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    SimRun::MarkovPath path;
    path.sigma_dph.assign(run->t_s.size(), effect_number(*this, parameters, "sigma_dph"));
    path.tau_s.assign(run->t_s.size(), effect_number(*this, parameters, "tau_s"));
    run->markov.push_back(path);
  }
};

} // namespace

const Effect* second_markov_effect() {
  static const SecondMarkov effect;
  return &effect;
}

} // namespace imucal
