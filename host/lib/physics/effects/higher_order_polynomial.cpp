// SPDX-License-Identifier: MIT
// The bias has terms above the order of the model, as Legendre polynomials of the normalised temperature
// (nearly orthogonal to the cubic that is estimated): P4 = (35x^4 - 30x^2 + 3)/8, P5 = (63x^5 - 70x^3 +
// 15x)/8.
#include "physics/effects/estimation.h"

namespace imucal {

double legendre(int degree, double x) {
  double before = 1.0, now = x;
  if (degree == 0) return before;
  for (int n = 1; n < degree; ++n) {
    const double next = ((2 * n + 1) * x * now - n * before) / (n + 1);
    before = now;
    now = next;
  }
  return now;
}

namespace {

class HigherOrderPolynomial : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "higher_order_polynomial"; }
  std::string label() const override { return "the bias curve is more curved than the polynomial allows"; }
  std::string description() const override {
    return "The bias over temperature has fourth and fifth order terms (Legendre polynomials of the "
           "normalised temperature).";
  }
  Family family() const override { return Family::kFunctionOfTemperature; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"stress, quadrature and gain each follow temperature by a curve of their own",
             "Weinberg and Kourepenis, J. MEMS 15 (2006)"},
            {"a model of too low an order for this range of temperature", "compare fits of several orders"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"p4_dph", -1e6, 1e6, "coefficient of the Legendre polynomial P4"},
            {"p5_dph", -1e6, 1e6, "coefficient of the Legendre polynomial P5"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double p4 = parameters.number("p4_dph");
    const double p5 = parameters.number("p5_dph");
    for (size_t i = 0; i < run->rate_dph.size(); ++i) {
      const double x = run->bias.normalised(run->gyro_temp_degc[i]);
      run->rate_dph[i] += p4 * legendre(4, x) + p5 * legendre(5, x);
    }
  }

  // Of an order-4 fit the first term left out is the fifth.
  std::optional<TypicalSize> typical_size(int order) const override {
    const double p4 = order < 4 ? 10 : 0;
    return TypicalSize{"poly", 6, true, {{"p4_dph", p4}, {"p5_dph", 10 - p4}}};
  }
  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  size_t n_columns() const override { return 2; }
  std::vector<Column> columns(const RunInput& run, const Theta&) const override {
    Column p4(run.size()), p5(run.size());
    for (size_t i = 0; i < run.size(); ++i) {
      const double x = run.normalised(run.smooth_degc[i]);
      p4[i] = legendre(4, x);
      p5[i] = legendre(5, x);
    }
    return {p4, p5};
  }
  PriorScale prior() const override { return {2, false, 1}; }
  Parameters values(const Estimate& e) const override {
    return {{"p4_dph", e.coefficient(0)}, {"p5_dph", e.coefficient(1)}};
  }
};

} // namespace

IMUCAL_EFFECT(HigherOrderPolynomial)

} // namespace imucal
