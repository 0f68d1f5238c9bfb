// SPDX-License-Identifier: MIT
// The thermal coefficients are not quite the same in every run (day-to-day repeatability): each run adds
// s1 x + s2 (x^2 - 1/3)/2 with s1, s2 ~ N(0, sigma^2), x the normalised temperature.
// Searched over the temperatures of the fitted logs, u from -1 to 1 there, whatever the scale of x: in a room of 4 degC a scale of
// 60 degC knows straight lines alone.  With x = m + h u the two coefficients of u have variances sigma^2 h^2 (1 + m^2) and
// sigma^2 h^4: the sigma that is told changes the curve as much over those temperatures, rms, as the one that was found.
#include <cmath>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

class RunToRun : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "run_to_run"; }
  std::string label() const override { return "the bias curve changes from run to run"; }
  std::string description() const override {
    return "The thermal coefficients change from run to run: random linear and quadratic terms of the "
           "normalised temperature.";
  }
  Family family() const override { return Family::kRunToRun; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"power-on repeatability: stress and loop state differ after every start",
             "IEEE Std 1431-2004, bias repeatability"},
            {"mounting taken off and put on between runs", "repeat runs without touching the device"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"sigma_dph", 0, 1e6, "standard deviation of the change, at the end of the temperature range"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kBias) return;
    const double sigma = parameters.number("sigma_dph");
    if (!rng) return;
    const double linear = sigma * rng->normal(), quadratic = sigma * rng->normal();
    for (size_t i = 0; i < run->rate_dph.size(); ++i) {
      const double x = run->bias.normalised(run->gyro_temp_degc[i]);
      run->rate_dph[i] += linear * x + quadratic * (x * x - 1.0 / 3.0) / 2.0;
    }
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kRunRandom; }
  size_t n_columns() const override { return 2; }
  std::vector<Column> columns(const RunInput& run, const Theta&) const override {
    const Line x_of = line(run);
    Column linear = run.tn;
    for (double& x : linear) x = (x - x_of.m) / x_of.h;
    Column quadratic = linear;
    for (double& u : quadratic) u = (u * u - 1.0 / 3.0) / 2.0;
    return {linear, quadratic};
  }
  PriorScale prior() const override { return {1, false, 1}; }
  Parameters values(const Estimate& e) const override { return {{"sigma_dph", e.shape_at(0)}}; }
  Parameters values_on(const RunInput& run, const Estimate& e) const override {
    const Line x_of = line(run);
    const double h2 = x_of.h * x_of.h, found = kLinear + kQuadratic;
    const double told = h2 * (1 + x_of.m * x_of.m) * kLinear + h2 * h2 * kQuadratic;
    Measured sigma = e.shape_at(0);
    const double scale = std::sqrt(found / told);
    sigma.value *= scale, sigma.std_error *= scale;
    return {{"sigma_dph", sigma}};
  }

private:
  // Mean squares of u and of (u^2 - 1/3)/2 about their means, u uniform from -1 to 1.
  static constexpr double kLinear = 1.0 / 3.0, kQuadratic = 1.0 / 45.0;
  struct Line {
    double m, h; // x = m + h u
  };
  static Line line(const RunInput& run) {
    const double half = 0.5 * (run.hi_degc - run.lo_degc);
    if (!(half > 0)) return {0, 1};
    return {(0.5 * (run.lo_degc + run.hi_degc) - run.t0_degc) / run.range_degc, half / run.range_degc};
  }
};

} // namespace

IMUCAL_EFFECT(RunToRun)

} // namespace imucal
