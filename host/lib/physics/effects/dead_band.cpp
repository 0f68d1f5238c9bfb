// SPDX-License-Identifier: MIT
// Small rates read as zero: |rate| < width becomes 0.
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

class DeadBand : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "dead_band"; }
  std::string description() const override { return "Small rates read as zero."; }
  std::vector<EffectParameter> parameters() const override {
    return {{"width_dph", 0, 1e7, "rates between minus and plus this read as zero"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kOutput) return;
    const double width = effect_number(*this, parameters, "width_dph");
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
  Json report(const Theta& shape, const std::vector<double>& /*coefficients*/) const override {
    return {{"width_dph", shape[0]}};
  }
};

} // namespace

const Effect* dead_band_effect() {
  static const DeadBand effect;
  return &effect;
}

} // namespace imucal
