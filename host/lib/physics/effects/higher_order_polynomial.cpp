// SPDX-License-Identifier: MIT
// The bias has terms above the order of the model, as Legendre polynomials of the normalised temperature
// (nearly orthogonal to the cubic that is estimated): P4 = (35x^4 - 30x^2 + 3)/8, P5 = (63x^5 - 70x^3 +
// 15x)/8.
//
// They are estimated over the temperatures of the logs, x = -1 .. 1 from end to end: what size is likely, and how well it is told,
// must not hang on the t0 and range that a model has.  With x = s Tn + c the fourth and fifth powers are those of
//   p4 = s^4 (a4 + 9 c a5),  p5 = s^5 a5
// in Tn, and the rest is a cubic, which the polynomial takes.
#include <cmath>

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
    return {{"p4_dph", -1e9, 1e9, "coefficient of the Legendre polynomial P4"},
            {"p5_dph", -1e9, 1e9, "coefficient of the Legendre polynomial P5"}};
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
    const Line x_of = line(run);
    Column p4(run.size()), p5(run.size());
    for (size_t i = 0; i < run.size(); ++i) {
      const double x = x_of.s * run.normalised(run.smooth_degc[i]) + x_of.c;
      p4[i] = legendre(4, x);
      p5[i] = legendre(5, x);
    }
    return {p4, p5};
  }
  PriorScale prior() const override { return {2, false, 1}; }
  Parameters values(const Estimate& e) const override {
    return {{"p4_dph", e.coefficient(0)}, {"p5_dph", e.coefficient(1)}};
  }
  // Both coefficients are nearly uncorrelated: each is told by half waves of its own.
  Parameters values_on(const RunInput& run, const Estimate& e) const override {
    const Line x_of = line(run);
    const double s4 = std::pow(x_of.s, 4), mix = 9 * x_of.c;
    const Measured a4 = e.coefficient(0), a5 = e.coefficient(1);
    const Measured p4 = {s4 * (a4.value + mix * a5.value), s4 * std::hypot(a4.std_error, mix * a5.std_error)};
    const Measured p5 = {s4 * x_of.s * a5.value, s4 * std::fabs(x_of.s) * a5.std_error};
    return {{"p4_dph", p4}, {"p5_dph", p5}};
  }
  std::vector<double> polynomial_beside(const RunInput& run, const Estimate& e) const override {
    const Line x_of = line(run);
    const Parameters told = values_on(run, e);
    std::vector<double> out(6, 0.0);
    const auto add = [&out](double size, int degree, const Line& of) {
      const std::vector<double> powers = in_powers(degree, of);
      for (size_t i = 0; i < powers.size(); ++i) out[i] += size * powers[i];
    };
    add(e.coefficient(0).value, 4, x_of), add(e.coefficient(1).value, 5, x_of);
    add(-told.number("p4_dph"), 4, {1, 0}), add(-told.number("p5_dph"), 5, {1, 0});
    out.resize(4); // the others are zero
    return out;
  }

private:
  struct Line {
    double s, c; // x = s Tn + c
  };
  // A polynomial of less than the third order does not take the rest: there x is Tn.
  static Line line(const RunInput& run) {
    const double span = run.hi_degc - run.lo_degc;
    if (run.order < 3 || !(span > 0)) return {1, 0};
    return {2 * run.range_degc / span, (2 * run.t0_degc - run.lo_degc - run.hi_degc) / span};
  }
  // Coefficients of the powers of Tn in P_degree(s Tn + c), by the recursion.
  static std::vector<double> in_powers(int degree, const Line& of) {
    std::vector<double> before = {1}, now = {of.c, of.s};
    for (int n = 1; n < degree; ++n) {
      std::vector<double> next(now.size() + 1, 0.0);
      for (size_t i = 0; i < now.size(); ++i) {
        next[i] += (2 * n + 1) * of.c * now[i] / (n + 1);
        next[i + 1] += (2 * n + 1) * of.s * now[i] / (n + 1);
      }
      for (size_t i = 0; i < before.size(); ++i) next[i] -= n * before[i] / (n + 1);
      before = now, now = next;
    }
    return now;
  }
};

} // namespace

IMUCAL_EFFECT(HigherOrderPolynomial)

} // namespace imucal
