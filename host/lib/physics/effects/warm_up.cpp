// SPDX-License-Identifier: MIT
// Settling after power-on, the same in every run: rate += A exp(-t/tau), t from the start of the run
// (self-heating of die and board).
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

class WarmUp : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "warm_up"; }
  std::string description() const override {
    return "Exponential settling after the start of every run (self-heating).";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph", -1e6, 1e6, "offset at the start of the run"},
            {"tau_s", 1, 1e5, "time constant of the settling"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = effect_number(*this, parameters, "amplitude_dph");
    const double tau = effect_number(*this, parameters, "tau_s");
    for (size_t i = 0; i < run->rate_dph.size(); ++i)
      run->rate_dph[i] += amplitude * std::exp(-(run->t_s[i] - run->t_s[0]) / tau);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  bool needs_temperature() const override { return false; }
  std::vector<Theta> grid(double, double) const override { return {{40}, {80}, {160}, {320}, {640}, {1280}}; }
  Theta shape_lo() const override { return {20}; }
  Theta shape_hi() const override { return {2500}; }
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    Column column(run.size());
    for (size_t i = 0; i < column.size(); ++i) column[i] = std::exp(-run.t_s[i] / shape[0]);
    return {column};
  }
  Json report(const Theta& shape, const std::vector<double>& coefficients) const override {
    return {{"amplitude_dph", coefficients[0]}, {"tau_s", shape[0]}};
  }
};

} // namespace

const Effect* warm_up_effect() {
  static const WarmUp effect;
  return &effect;
}

} // namespace imucal
