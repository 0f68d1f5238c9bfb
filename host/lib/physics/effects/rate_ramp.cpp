// SPDX-License-Identifier: MIT
// The bias drifts linearly in time, the same way in every run: rate += R t, t from the start of the run.
// Source: rate ramp of IEEE Std 952-1997, annex C.
#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

class RateRamp : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "rate_ramp"; }
  std::string description() const override {
    return "The bias drifts linearly in time from the start of every run (rate ramp of IEEE 952).";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"ramp_dph_per_h", -1e6, 1e6, "drift per hour"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double ramp = effect_number(*this, parameters, "ramp_dph_per_h");
    for (size_t i = 0; i < run->rate_dph.size(); ++i)
      run->rate_dph[i] += ramp * (run->t_s[i] - run->t_s[0]) / 3600.0;
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  bool needs_temperature() const override { return false; }
  std::vector<Column> columns(const RunInput& run, const Theta&) const override {
    Column hours = run.t_s;
    for (double& t : hours) t /= 3600.0;
    return {hours};
  }
  double notable() const override { return 0.8; }
  Json report(const Theta& /*shape*/, const std::vector<double>& coefficients) const override {
    return {{"ramp_dph_per_h", coefficients[0]}};
  }
};

} // namespace

const Effect* rate_ramp_effect() {
  static const RateRamp effect;
  return &effect;
}

} // namespace imucal
