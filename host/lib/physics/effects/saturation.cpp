// SPDX-License-Identifier: MIT
// The rate is clipped at plus and minus a limit.
#include <algorithm>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class Saturation : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "saturation"; }
  std::string label() const override { return "readings clipped at a limit"; }
  std::string description() const override { return "The rate is clipped at a limit of the output."; }
  Family family() const override { return Family::kStructural; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"range of sensor or converter too small for rate and bias together",
             "IEEE Std 1431-2004, input limits"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"limit_dph", 1e-9, 1e9, "largest rate the output shows, both signs"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kOutput) return;
    const double limit = parameters.number("limit_dph");
    for (double& rate : run->rate_dph) rate = std::clamp(rate, -limit, limit);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kStructural; }
  bool needs_temperature() const override { return false; }
  // Many samples exactly at the extreme value.
  std::optional<Signature> detect(const std::vector<RunInput>& runs) const override {
    double lo = 1e300, hi = -1e300;
    for (const RunInput& run : runs)
      for (double y : run.rate_dph)
        if (std::isfinite(y)) lo = std::min(lo, y), hi = std::max(hi, y);
    size_t at_lo = 0, at_hi = 0;
    for (const RunInput& run : runs)
      for (double y : run.rate_dph) {
        at_lo += std::isfinite(y) && y - lo <= 1e-6 * (1 + std::fabs(lo));
        at_hi += std::isfinite(y) && hi - y <= 1e-6 * (1 + std::fabs(hi));
      }
    // On a lattice the extreme repeats too, but less often than the value beside it.
    constexpr size_t kFewest = 8;
    double next_lo = 1e300, next_hi = -1e300;
    for (const RunInput& run : runs)
      for (double y : run.rate_dph) {
        if (!std::isfinite(y)) continue;
        if (y - lo > 1e-6 * (1 + std::fabs(lo))) next_lo = std::min(next_lo, y);
        if (hi - y > 1e-6 * (1 + std::fabs(hi))) next_hi = std::max(next_hi, y);
      }
    size_t beside_lo = 0, beside_hi = 0;
    for (const RunInput& run : runs)
      for (double y : run.rate_dph) {
        beside_lo += std::isfinite(y) && std::fabs(y - next_lo) <= 1e-6 * (1 + std::fabs(next_lo));
        beside_hi += std::isfinite(y) && std::fabs(y - next_hi) <= 1e-6 * (1 + std::fabs(next_hi));
      }
    const bool is_lo = at_lo >= kFewest && at_lo > 2 * beside_lo,
               is_hi = at_hi >= kFewest && at_hi > 2 * beside_hi;
    if (!(hi > lo) || (!is_lo && !is_hi)) return std::nullopt;
    Signature found;
    found.parameters = {{"limit_dph", is_hi ? std::fabs(hi) : std::fabs(lo)}};
    found.evidence_nats = 5.0 * static_cast<double>((is_lo ? at_lo : 0) + (is_hi ? at_hi : 0));
    found.statement = "samples pile up at the extreme value";
    for (const RunInput& run : runs) {
      std::vector<char> bad(run.size(), 0);
      for (size_t i = 0; i < bad.size(); ++i) {
        const double y = run.rate_dph[i];
        bad[i] = (is_lo && y - lo <= 1e-6 * (1 + std::fabs(lo))) ||
                 (is_hi && hi - y <= 1e-6 * (1 + std::fabs(hi)));
      }
      found.unusable.push_back(bad);
    }
    return found;
  }
  bool is_censoring() const override { return true; }
  int detection_order() const override { return 0; }
  Parameters values(const Estimate& e) const override { return {{"limit_dph", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(Saturation)

} // namespace imucal
