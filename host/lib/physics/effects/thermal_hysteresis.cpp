// SPDX-License-Identifier: MIT
// Bias that depends on the direction from which a temperature was reached: rate += A (P[T] - T)/r, where P is
// the play (backlash) operator of half-width r, P_k = clip(P_{k-1}, T_k - r, T_k + r).  After 2r of travel
// the term is -A going up and +A going down: A is half the opening of the loop.  Source: Prandtl-Ishlinskii
// model of hysteresis (Visintin, Differential Models of Hysteresis, 1994). Start: a run that begins in the
// lower half of its temperatures has come down to them (P = T + r), else P = T - r.
#include <algorithm>

#include "physics/effects/estimation.h"
#include "physics/effects/library.h"

namespace imucal {
namespace {

// (P[T] - T)/r of the play operator, row by row.
Column play_column(const std::vector<double>& temp, double width) {
  Column column(temp.size());
  if (temp.empty()) return column;
  const auto [lo, hi] = std::minmax_element(temp.begin(), temp.end());
  double play = temp[0] < 0.5 * (*lo + *hi) ? temp[0] + width : temp[0] - width;
  for (size_t i = 0; i < temp.size(); ++i) {
    play = std::clamp(play, temp[i] - width, temp[i] + width);
    column[i] = (play - temp[i]) / width;
  }
  return column;
}

class ThermalHysteresis : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "thermal_hysteresis"; }
  std::string description() const override {
    return "Bias that depends on the direction from which a temperature was reached: play (backlash) "
           "operator of the Prandtl-Ishlinskii hysteresis model.";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph", -1e6, 1e6,
             "half the opening of the loop (negative: the loop is run the other way round)"},
            {"width_degc", 0.05, 200,
             "travel of temperature until half of the loop is crossed (play half-width)"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = effect_number(*this, parameters, "amplitude_dph");
    const double width = effect_number(*this, parameters, "width_degc");
    const Column column = play_column(run->case_temp(), width);
    for (size_t i = 0; i < column.size(); ++i) run->rate_dph[i] += amplitude * column[i];
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  std::vector<Theta> grid(double lo, double hi) const override {
    std::vector<Theta> widths;
    for (double r : {1.0, 2.0, 3.5, 5.5, 8.0, 11.0, 15.0, 20.0, 26.0})
      if (widths.empty() || r < 0.6 * (hi - lo)) widths.push_back({r});
    return widths;
  }
  Theta shape_lo() const override { return {0.4}; }
  Theta shape_hi() const override { return {60}; }
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    return {play_column(run.smooth_degc, shape[0])};
  }
  double notable() const override { return 0.8; }
  Json report(const Theta& shape, const std::vector<double>& coefficients) const override {
    return {{"amplitude_dph", coefficients[0]}, {"width_degc", shape[0]}};
  }
};

} // namespace

const Effect* thermal_hysteresis_effect() {
  static const ThermalHysteresis effect;
  return &effect;
}

} // namespace imucal
