// SPDX-License-Identifier: MIT
// Noise that the axes share (supply, reference, vibration): every axis gets additional white noise of sigma,
// and the additions of two axes have the given correlation: sigma (sqrt|c| common + sqrt(1 - |c|) own); a
// negative correlation alternates the sign of the common part from axis to axis.
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

constexpr uint32_t kCommonStream = 900; // purpose of the stream shared by the axes

class CommonMode : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "common_mode"; }
  std::string description() const override { return "Additional white noise that the axes share."; }
  std::vector<EffectParameter> parameters() const override {
    return {{"correlation", -1, 1, "correlation of the additional noise between axes"},
            {"sigma_dph", 0, 1e6, "standard deviation of the additional noise"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kNoise) return;
    const double correlation = effect_number(*this, parameters, "correlation");
    const double sigma = effect_number(*this, parameters, "sigma_dph");
    if (!rng) return;
    // The common part comes from a stream that does not depend on the axis.
    Rng common(run->seed, run->log, 0xffffffffu, kCommonStream);
    const double sign = correlation < 0 && run->axis % 2 ? -1.0 : 1.0;
    const double shared = sign * sigma * std::sqrt(std::fabs(correlation));
    const double own = sigma * std::sqrt(1.0 - std::fabs(correlation));
    for (double& rate : run->rate_dph) rate += shared * common.normal() + own * rng->normal();
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kAxes; }
  bool needs_temperature() const override { return false; }
  Json report(const Theta& theta, const std::vector<double>& /*coefficients*/) const override {
    return {{"correlation", theta[0]}, {"sigma_dph", theta[1]}};
  }
};

} // namespace

const Effect* common_mode_effect() {
  static const CommonMode effect;
  return &effect;
}

} // namespace imucal
