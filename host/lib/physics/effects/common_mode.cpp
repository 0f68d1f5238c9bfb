// SPDX-License-Identifier: MIT
// Noise that the axes share (supply, reference, vibration): every axis gets additional white noise of sigma,
// and the additions of two axes have the given correlation: sigma (sqrt|c| common + sqrt(1 - |c|) own); a
// negative correlation alternates the sign of the common part from axis to axis.
#include <cmath>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

constexpr uint32_t kCommonStream = 900; // purpose of the stream shared by the axes

class CommonMode : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "common_mode"; }
  std::string label() const override { return "noise that the axes share"; }
  std::string description() const override { return "Additional white noise that the axes share."; }
  Family family() const override { return Family::kExternal; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"shared supply, voltage reference or clock", "IEEE Std 1431-2004, supply sensitivity"},
            {"real motion of the table or building", "cover and isolate the table, compare with another device"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"correlation", -1, 1, "correlation of the additional noise between axes"},
            {"sigma_dph", 0, 1e6, "standard deviation of the additional noise"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kNoise) return;
    const double correlation = parameters.number("correlation");
    const double sigma = parameters.number("sigma_dph");
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
  Parameters values(const Estimate& e) const override {
    return {{"correlation", e.shape_at(0)}, {"sigma_dph", e.shape_at(1)}};
  }
};

} // namespace

IMUCAL_EFFECT(CommonMode)

} // namespace imucal
