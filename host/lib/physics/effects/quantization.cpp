// SPDX-License-Identifier: MIT
// The rate is rounded to a lattice: lsb round(rate / lsb).
#include <cmath>
#include <utility>

#include "base/median.h"
#include "physics/effects/estimation.h"
#include "physics/effects/lattice.h"
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
  // Few distinct values, all on a lattice: one finding for each step.
  std::vector<Signature> detect(const std::vector<RunInput>& runs) const override {
    std::vector<Signature> out;
    for (const Lattice& lattice : lattices(runs)) {
      std::vector<RunInput> rounded;
      for (const size_t r : lattice.runs) rounded.push_back(runs[r]);
      if (!is_coarse(rounded, lattice.step_dph)) continue;
      Signature found;
      found.parameters = {{"lsb_dph", lattice.step_dph}};
      found.evidence_nats = 0.5 * static_cast<double>(finite_rates(rounded).size()) * std::log(2.0);
      found.white_dph2.assign(runs.size(), 0);
      for (const size_t r : lattice.runs) found.white_dph2[r] = std::pow(lattice.step_dph, 2) / 12;
      const bool is_everywhere = rounded.size() == runs.size();
      found.statement = is_everywhere ? "all rates are multiples of one step" : "rates are multiples of one step";
      out.push_back(found);
    }
    return out;
  }
  int detection_order() const override { return 2; }
  Parameters values(const Estimate& e) const override { return {{"lsb_dph", e.shape_at(0)}}; }

private:
  static constexpr double kFine = 0.2;       // of the noise: what is finer adds nothing to it
  static constexpr double kFewValues = 0.02; // per sample

  // Files with few digits are a lattice too, a fine one: only a step that matters beside the noise is an effect.
  static bool is_coarse(const std::vector<RunInput>& runs, double step_dph) {
    std::vector<double> jumps, rates = finite_rates(runs);
    const double n = static_cast<double>(rates.size());
    const bool has_few_values = static_cast<double>(values_with_counts(std::move(rates)).size()) <= kFewValues * n;
    for (const RunInput& run : runs)
      for (size_t i = 1; i < run.rate_dph.size(); ++i)
        if (const double jump = run.rate_dph[i] - run.rate_dph[i - 1]; std::isfinite(jump))
          jumps.push_back(std::fabs(jump));
    return has_few_values || jumps.empty() || step_dph >= kFine * median(std::move(jumps)) / kMedianJump;
  }
};

} // namespace

IMUCAL_EFFECT(Quantization)

} // namespace imucal
