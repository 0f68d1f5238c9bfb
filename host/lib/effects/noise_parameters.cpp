// SPDX-License-Identifier: MIT
// The nominal noise is mis-tuned: white noise and the (first) Markov process have other parameters than
// believed.
#include "base/units.h"
#include "effects/library.h"

namespace imucal {
namespace {

class NoiseParameters : public Effect {
public:
  std::string name() const override { return "noise_parameters"; }
  std::string description() const override {
    return "The noise parameters of the model are wrong: other angle random walk, Markov sigma and time "
           "constant.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"arw_deg_rt_h", 0, 1e4, "angle random walk"},
            {"sigma_dph", 0, 1e6, "standard deviation of the Markov process"},
            {"tau_s", 0.1, 1e6, "time constant of the Markov process"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kNoise) return;
    const double white = white_sigma_dph(effect_number(*this, parameters, "arw_deg_rt_h"));
    const double sigma = effect_number(*this, parameters, "sigma_dph");
    const double tau = effect_number(*this, parameters, "tau_s");
    const size_t n = run->t_s.size();
    run->white_sigma_dph.assign(n, white);
    if (run->markov.empty()) run->markov.emplace_back();
    run->markov[0].sigma_dph.assign(n, sigma);
    run->markov[0].tau_s.assign(n, tau);
  }
};

} // namespace

const Effect* noise_parameters_effect() {
  static const NoiseParameters effect;
  return &effect;
}

} // namespace imucal
