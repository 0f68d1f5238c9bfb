// SPDX-License-Identifier: MIT
// Small rates read as zero: |rate| < width becomes 0.
#include <cmath>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class DeadBand : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "dead_band"; }
  std::string label() const override { return "a dead band: small rates read as zero"; }
  std::string description() const override { return "Small rates read as zero."; }
  Family family() const override { return Family::kStructural; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"a threshold in firmware (\"zero-rate\" filter) or stiction of a loop",
             "IEEE Std 1431-2004, threshold and dead band"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"width_dph", 0, 1e7, "rates between minus and plus this read as zero"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kOutput) return;
    const double width = parameters.number("width_dph");
    for (double& rate : run->rate_dph)
      if (std::fabs(rate) < width) rate = 0.0;
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kStructural; }
  bool needs_temperature() const override { return false; }
  // Many exact zeros and nothing between them and the edge of the band.
  std::optional<Signature> detect(const std::vector<RunInput>& runs) const override {
    size_t zeros = 0;
    double edge = 1e300, largest = 0;
    for (const RunInput& run : runs)
      for (double y : run.rate_dph) {
        if (!std::isfinite(y)) continue;
        if (y == 0)
          ++zeros;
        else
          edge = std::min(edge, std::fabs(y)), largest = std::max(largest, std::fabs(y));
      }
    if (zeros < 8 || !(largest > 0)) return std::nullopt;
    // On a lattice zero is a value like its neighbours: then the band would be one step wide.
    size_t next = 0;
    for (const RunInput& run : runs)
      for (double y : run.rate_dph) next += y != 0 && std::fabs(y) <= edge * (1 + 1e-6);
    if (3 * next > zeros) return std::nullopt;
    Signature found;
    found.parameters = {{"width_dph", edge}};
    found.evidence_nats = 5.0 * static_cast<double>(zeros);
    found.statement = "exact zeros, and no rate between them and the edge of a band";
    for (const RunInput& run : runs) {
      std::vector<char> bad(run.size(), 0);
      for (size_t i = 0; i < bad.size(); ++i) bad[i] = run.rate_dph[i] == 0;
      found.unusable.push_back(bad);
    }
    return found;
  }
  bool is_censoring() const override { return true; }
  int detection_order() const override { return 1; }
  Parameters values(const Estimate& e) const override { return {{"width_dph", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(DeadBand)

} // namespace imucal
