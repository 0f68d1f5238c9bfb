// SPDX-License-Identifier: MIT
// The bias has terms above the order of the model, as Legendre polynomials of the normalised temperature
// (nearly orthogonal to the cubic that is estimated): P4 = (35x^4 - 30x^2 + 3)/8, P5 = (63x^5 - 70x^3 +
// 15x)/8.
#include "effects/library.h"

namespace imucal {
namespace {

class HigherOrderPolynomial : public Effect {
public:
  std::string name() const override { return "higher_order_polynomial"; }
  std::string description() const override {
    return "The bias over temperature has fourth and fifth order terms (Legendre polynomials of the "
           "normalised temperature).";
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"p4_dph", -1e6, 1e6, "coefficient of the Legendre polynomial P4"},
            {"p5_dph", -1e6, 1e6, "coefficient of the Legendre polynomial P5"}};
  }

  void simulate(SimStage stage, const Json& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double p4 = effect_number(*this, parameters, "p4_dph");
    const double p5 = effect_number(*this, parameters, "p5_dph");
    for (size_t i = 0; i < run->rate_dph.size(); ++i) {
      const double x = run->bias.normalised(run->gyro_temp_degc[i]), x2 = x * x;
      run->rate_dph[i] += p4 * (35 * x2 * x2 - 30 * x2 + 3) / 8 + p5 * x * (63 * x2 * x2 - 70 * x2 + 15) / 8;
    }
  }
};

} // namespace

const Effect* higher_order_polynomial_effect() {
  static const HigherOrderPolynomial effect;
  return &effect;
}

} // namespace imucal
