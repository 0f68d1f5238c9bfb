// SPDX-License-Identifier: MIT
// A local bump in the bias over temperature, A exp(-(T - T0)^2 / (2 w^2)): what a mode crossing or a package
// resonance leaves, and no polynomial of low order follows.
#include <array>
#include <cmath>

#include "physics/effects/estimation.h"

namespace imucal {
namespace {

// Over the usual 60 to 80 degC a wider bump is hardly local: fourth and fifth orders come near it.
constexpr double kWidest_degc = 10;

// Every `apart` widths from end to end.
std::vector<Theta> places(double lo, double hi, double apart, std::initializer_list<double> widths) {
  std::vector<Theta> points;
  for (double width : widths)
    for (double center = lo + 0.5; center < hi; center += apart * width) points.push_back({center, width});
  return points;
}

// What bumps of all shapes share: centre and width, and that the logs pass their top, to half a width.  A flank alone tells
// neither height nor place.
class Bump : public EffectEstimator {
public:
  Form form() const override { return Form::kColumns; }
  Theta shape_lo() const override { return {-250, 0.4}; }
  Theta shape_hi() const override { return {2000, kWidest_degc}; }
  bool is_repeated(const std::vector<const RunInput*>& runs, const Theta& shape) const override {
    const double lo_degc = shape[0] - 0.5 * shape[1], hi_degc = shape[0] + 0.5 * shape[1];
    bool is_colder = false, is_hotter = false; // somewhere than the far side of the top
    for (const RunInput* run : runs)
      for (const double degc : run->smooth_degc) {
        if (degc <= hi_degc) is_colder = true;
        if (degc >= lo_degc) is_hotter = true;
        if (is_colder && is_hotter) return true;
      }
    return false;
  }
};

// A bump of any shape about one temperature: a resonance has the wide skirts of a Lorentz curve, a transition is steep on
// one side.  Gaussians of two widths about the same place, each with its first derivative (Hermite functions).
class AnyBump : public Bump {
public:
  size_t n_columns() const override { return 2 * kWider.size(); }
  // Its derivatives move and widen a bump: one width, twice as wide steps.
  std::vector<Theta> grid(double lo, double hi) const override { return places(lo, hi, 2, {1.5}); }
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    std::vector<Column> out;
    for (const double wider : kWider) {
      Column even(run.size()), odd(run.size());
      for (size_t i = 0; i < run.size(); ++i) {
        const double z = (run.smooth_degc[i] - shape[0]) / (wider * shape[1]);
        even[i] = std::exp(-0.5 * z * z), odd[i] = z * even[i];
      }
      out.push_back(std::move(even)), out.push_back(std::move(odd));
    }
    return out;
  }
  std::vector<double> relative_sd() const override { return {1, 0.5, 0.5, 0.5}; }
  Parameters values(const Estimate&) const override { return {}; }

private:
  static constexpr std::array<double, 2> kWider = {1, 2.5};
};

class ThermalAnomaly : public Effect, public Bump {
public:
  std::string name() const override { return "thermal_anomaly"; }
  std::string label() const override { return "a local bump of the bias at one temperature"; }
  std::string description() const override {
    return "A local bump of the bias over temperature (mode crossing, package stress): Gaussian in "
           "temperature.";
  }
  Family family() const override { return Family::kFunctionOfTemperature; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"drive or sense mode crosses a resonance of package, board or another mode",
             "Weinberg and Kourepenis, J. MEMS 15 (2006)"},
            {"glass transition of an adhesive or moulding compound", "Lakes, Viscoelastic Materials (2009)"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph", -1e6, 1e6, "height of the bump"},
            {"center_degc", -300, 2000, "temperature of the bump"},
            {"width_degc", 0.05, 200, "standard deviation of the Gaussian"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* /*rng*/) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = parameters.number("amplitude_dph");
    const double center = parameters.number("center_degc");
    const double width = parameters.number("width_degc");
    for (size_t i = 0; i < run->rate_dph.size(); ++i) {
      const double z = (run->gyro_temp_degc[i] - center) / width;
      run->rate_dph[i] += amplitude * std::exp(-0.5 * z * z);
    }
  }

  std::optional<TypicalSize> typical_size(int /*order*/) const override {
    return TypicalSize{"bump", 7, false, {{"amplitude_dph", 20.0}, {"center_degc", 30.0}, {"width_degc", 2.5}}};
  }
  const EffectEstimator* estimator() const override { return this; }
  std::vector<Theta> grid(double lo, double hi) const override {
    return places(lo, hi, 1.3, {0.8, 1.6, 3.0, 5.5, 9.5});
  }
  AnyShape of_any_shape() const override {
    static const AnyBump any;
    return {&any, "a bump of another shape than a Gaussian"};
  }
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    Column column(run.size());
    for (size_t i = 0; i < column.size(); ++i) {
      const double z = (run.smooth_degc[i] - shape[0]) / shape[1];
      column[i] = std::fabs(z) > 6 ? 0.0 : std::exp(-0.5 * z * z);
    }
    return {column};
  }
  Parameters values(const Estimate& e) const override {
    return {{"amplitude_dph", e.coefficient(0)}, {"center_degc", e.shape_at(0)}, {"width_degc", e.shape_at(1)}};
  }
};

} // namespace

IMUCAL_EFFECT(ThermalAnomaly)

} // namespace imucal
