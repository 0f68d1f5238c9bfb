// SPDX-License-Identifier: MIT
// The rate is rounded to a lattice: lsb round(rate / lsb).
#include <algorithm>
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/sample_shape.h"

namespace imucal {
namespace {

class Quantization : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "quantization"; }
  std::string label() const override { return "readings rounded to coarse steps"; }
  std::string description() const override { return "The rate is rounded to a coarse lattice."; }
  Family family() const override { return Family::kStructural; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {
        {"few bits of the converter, or rounding in driver or log", "Widrow and Kollar, Quantization Noise (2008)"}};
  }
  std::vector<EffectParameter> parameters() const override { return {{"lsb_dph", 1e-9, 1e7, "step of the output"}}; }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kOutput) return;
    const double lsb = parameters.number("lsb_dph");
    for (double& rate : run->rate_dph) rate = lsb * std::round(rate / lsb);
  }

  std::optional<NoiseComponent> closed_form(const Parameters& p, double /*dt_s*/) const override {
    // Right where the other noise is above half a step.
    return white_component(std::pow(p.number("lsb_dph"), 2) / 12);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kStructural; }
  bool needs_temperature() const override { return false; }
  // Few distinct values, all on a lattice.
  std::optional<Signature> detect(const std::vector<RunInput>& runs) const override {
    std::vector<double> values;
    for (const RunInput& run : runs)
      for (double y : run.rate_dph)
        if (std::isfinite(y)) values.push_back(y);
    const size_t n = values.size();
    std::vector<double> distinct;
    for (const auto& [value, count] : values_with_counts(std::move(values))) distinct.push_back(value);
    if (n < 200 || distinct.size() < 3 || static_cast<double>(distinct.size()) > 0.5 * static_cast<double>(n))
      return std::nullopt;
    double lsb = 1e300;
    for (size_t i = 1; i < distinct.size(); ++i) lsb = std::min(lsb, distinct[i] - distinct[i - 1]);
    // Files with few digits are a lattice too, a fine one: only a step that matters beside the noise is an
    // effect.
    std::vector<double> jumps;
    for (const RunInput& run : runs)
      for (size_t i = 1; i < run.rate_dph.size(); ++i)
        if (std::isfinite(run.rate_dph[i] - run.rate_dph[i - 1]))
          jumps.push_back(std::fabs(run.rate_dph[i] - run.rate_dph[i - 1]));
    std::nth_element(jumps.begin(), jumps.begin() + static_cast<long>(jumps.size() / 2), jumps.end());
    const double noise = jumps[jumps.size() / 2] / 0.954; // median of |N(0, 2 sigma^2)| = 0.954 sigma
    const bool is_fine = lsb < 0.2 * noise;
    const bool has_many_values = static_cast<double>(distinct.size()) > 0.02 * static_cast<double>(n);
    if (is_fine && has_many_values) return std::nullopt;
    size_t off = 0;
    for (size_t i = 1; i < distinct.size(); ++i) {
      const double steps = (distinct[i] - distinct[i - 1]) / lsb;
      off += std::fabs(steps - std::round(steps)) > 0.02 * std::max(1.0, steps);
    }
    if (off * 50 > distinct.size()) return std::nullopt;
    Signature found;
    found.parameters = {{"lsb_dph", lsb}};
    found.evidence_nats = 0.5 * static_cast<double>(n) * std::log(2.0);
    found.white_dph2.assign(runs.size(), lsb * lsb / 12.0);
    found.statement = "all rates lie on a lattice";
    return found;
  }
  int detection_order() const override { return 2; }
  Parameters values(const Estimate& e) const override { return {{"lsb_dph", e.shape_at(0)}}; }
};

} // namespace

IMUCAL_EFFECT(Quantization)

} // namespace imucal
