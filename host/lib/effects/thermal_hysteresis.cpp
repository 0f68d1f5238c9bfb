// SPDX-License-Identifier: MIT
// Bias that depends on the direction from which a temperature was reached: rate += A (P[T] - T)/r, where P is
// the play (backlash) operator of half-width r, P_k = clip(P_{k-1}, T_k - r, T_k + r).  After 2r of travel
// the term is -A going up and +A going down: A is half the opening of the loop.  Source: Prandtl-Ishlinskii
// model of hysteresis (Visintin, Differential Models of Hysteresis, 1994). Start: a run that begins in the
// lower half of its temperatures has come down to them (P = T + r), else P = T - r.
#include <algorithm>

#include "effects/library.h"

namespace imucal {
namespace {

class ThermalHysteresis : public Effect {
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
    const std::vector<double>& temp = run->case_temp();
    if (temp.empty()) return;
    const auto [lo, hi] = std::minmax_element(temp.begin(), temp.end());
    double play = temp[0] < 0.5 * (*lo + *hi) ? temp[0] + width : temp[0] - width;
    for (size_t i = 0; i < temp.size(); ++i) {
      play = std::clamp(play, temp[i] - width, temp[i] + width);
      run->rate_dph[i] += amplitude * (play - temp[i]) / width;
    }
  }
};

} // namespace

const Effect* thermal_hysteresis_effect() {
  static const ThermalHysteresis effect;
  return &effect;
}

} // namespace imucal
