// SPDX-License-Identifier: MIT
// The bias drifts linearly in time, the same way in every run: rate += R t, t from the start of the run.
// Source: rate ramp of IEEE Std 952-1997, annex C.
#include "base/units.h"
#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class RateRamp : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "rate_ramp"; }
  std::string label() const override { return "steady drift with the time since the start"; }
  std::string description() const override {
    return "The bias drifts linearly in time from the start of every run (rate ramp of IEEE 952).";
  }
  Family family() const override { return Family::kFunctionOfTime; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {
        {"slow warming of electronics after power-on, longer than the run", "IEEE Std 952-1997, annex C, rate ramp"},
        {"ageing or slow stress relaxation", "Lakes, Viscoelastic Materials (2009)"}};
  }
  std::vector<EffectParameter> parameters() const override { return {{"ramp_dph_per_h", -1e6, 1e6, "drift per hour"}}; }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double ramp = parameters.number("ramp_dph_per_h");
    for (size_t i = 0; i < run->rate_dph.size(); ++i)
      run->rate_dph[i] += ramp * (run->t_s[i] - run->t_s[0]) / kSecondsPerHour;
  }

  std::optional<NoiseComponent> closed_form(const Parameters& p, double dt_s) const override {
    return ramp_component(p.number("ramp_dph_per_h") * dt_s / kSecondsPerHour);
  }

  std::optional<TypicalSize> typical_size(int /*order*/) const override {
    return TypicalSize{"ramp", 5, true, {{"ramp_dph_per_h", 10.0}}};
  }
  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  bool needs_temperature() const override { return false; }
  std::vector<Column> columns(const RunInput& run, const Theta&) const override {
    Column hours = run.t_s;
    for (double& t : hours) t /= kSecondsPerHour;
    return {hours};
  }
  double notable() const override { return 0.8; }
  PriorScale prior() const override { return {1, true, 1}; }
  Parameters values(const Estimate& e) const override { return {{"ramp_dph_per_h", e.coefficient(0)}}; }
};

} // namespace

IMUCAL_EFFECT(RateRamp)

} // namespace imucal
