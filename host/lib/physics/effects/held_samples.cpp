// SPDX-License-Identifier: MIT
// The output is sometimes not refreshed: with a probability a second repeats the value before it.
#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class HeldSamples : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "held_samples"; }
  std::string label() const override { return "readings that were not refreshed"; }
  std::string description() const override {
    return "The output sometimes repeats the value before it (missed update).";
  }
  Family family() const override { return Family::kStructural; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"reader and sensor run on different clocks, or a read failed",
             "look at data-ready and the flags of the recorder"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"probability", 0, 1, "probability that a second repeats the one before"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kOutput) return;
    const double probability = parameters.number("probability");
    for (size_t i = 1; rng && i < run->rate_dph.size(); ++i)
      if (rng->uniform() < probability) run->rate_dph[i] = run->rate_dph[i - 1];
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kStructural; }
  bool needs_temperature() const override { return false; }
  // Exact repeats of the value before, more than a lattice of values would give.
  std::optional<Signature> detect(const std::vector<RunInput>& runs) const override {
    size_t repeats = 0, pairs = 0, equal_two_apart = 0;
    for (const RunInput& run : runs)
      for (size_t i = 2; i < run.size(); ++i) {
        if (!std::isfinite(run.rate_dph[i]) || !std::isfinite(run.rate_dph[i - 1])) continue;
        ++pairs;
        repeats += run.rate_dph[i] == run.rate_dph[i - 1];
        equal_two_apart += run.rate_dph[i] == run.rate_dph[i - 2] && run.rate_dph[i] != run.rate_dph[i - 1];
      }
    if (repeats < 6 || repeats < 5 * equal_two_apart) return std::nullopt;
    Signature found;
    found.parameters = {{"probability", static_cast<double>(repeats) / static_cast<double>(pairs)}};
    found.evidence_nats = 5.0 * static_cast<double>(repeats);
    found.statement = "samples repeat the one before exactly";
    for (const RunInput& run : runs) {
      std::vector<char> bad(run.size(), 0);
      for (size_t i = 1; i < bad.size(); ++i) bad[i] = run.rate_dph[i] == run.rate_dph[i - 1];
      found.unusable.push_back(bad);
    }
    return found;
  }
  int detection_order() const override { return 3; }
  Parameters values(const Estimate& e) const override { return {{"probability", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(HeldSamples)

} // namespace imucal
