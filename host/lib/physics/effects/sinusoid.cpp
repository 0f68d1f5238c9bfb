// SPDX-License-Identifier: MIT
// A tone (supply ripple, vibration or its alias): rate += A sin(2 pi f t + phase), the phase drawn for every
// run. A is the amplitude as it stands in the 1-s means, after their averaging; a frequency above 0.5 Hz
// appears at its alias, and the log cannot tell which of them it was.  A tone that comes from an oscillator
// or a mechanical mode drifts with temperature: f = f0 + k T, the phase is the integral of f.
#include <algorithm>
#include <cmath>

#include "base/units.h"
#include "physics/effects/estimation.h"

namespace imucal {
namespace {

// Integral of the temperature from the first second on, by trapezoids [degC s].
Column integral(const std::vector<double>& t_s, const std::vector<double>& temp_degc) {
  Column sum(t_s.size(), 0.0);
  for (size_t i = 1; i < sum.size(); ++i)
    sum[i] = sum[i - 1] + 0.5 * (temp_degc[i] + temp_degc[i - 1]) * (t_s[i] - t_s[i - 1]);
  return sum;
}

class Sinusoid : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "sinusoid"; }
  std::string label() const override { return "a periodic disturbance"; }
  std::string description() const override {
    return "A tone with a random phase in every run (interference, vibration), seen in 1-s means: known "
           "only modulo the sampling.";
  }
  Family family() const override { return Family::kTone; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"ripple of supply or clock, or its alias after sampling", "IEEE Std 952-1997, annex C, sinusoidal noise"},
            {"vibration of fan, pump or chamber compressor near a resonance", "IEEE Std 1431-2004, vibration"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {
        {"amplitude_dph", 0, 1e6, "amplitude in the 1-s means; estimated: the root mean square of those of the logs"},
        {"frequency_hz", 1e-6, 1e5, "frequency (with a drift: that at 0 degC)"},
        {"drift_hz_per_degc", -1e3, 1e3, "change of the frequency with temperature (0 where left out)",
         EffectParameter::kNumber, true}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = parameters.number("amplitude_dph");
    const double frequency = parameters.number("frequency_hz");
    const double drift = parameters.number_or("drift_hz_per_degc", 0.0);
    const double phase = rng ? 2 * kPi * rng->uniform() : 0.0;
    const Column degc_s = drift != 0 ? integral(run->t_s, run->gyro_temp_degc) : Column();
    for (size_t i = 0; i < run->rate_dph.size(); ++i) {
      const double cycles = frequency * run->t_s[i] + (drift != 0 ? drift * degc_s[i] : 0.0);
      run->rate_dph[i] += amplitude * std::sin(2 * kPi * cycles + phase);
    }
  }

  std::optional<NoiseComponent> closed_form(const Parameters& p, double dt_s) const override {
    if (p.number_or("drift_hz_per_degc", 0.0) != 0) return std::nullopt; // no one frequency
    return sinusoid_component(p.number("amplitude_dph"), 2 * kPi * p.number("frequency_hz") * dt_s);
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kTone; }
  bool needs_temperature() const override { return false; }
  size_t n_columns() const override { return 2; }
  PriorScale prior() const override { return {3, false, 1}; }
  // shape: frequency and, where it drifts, its change with temperature: as logged, since the integral smooths it already.
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    const double drift = shape.size() > 1 ? shape[1] : 0.0;
    const Column degc_s = drift != 0 ? integral(run.t_s, run.temp_degc) : Column();
    Column cosine(run.size()), sine(run.size());
    for (size_t i = 0; i < run.size(); ++i) {
      const double angle = 2 * kPi * (shape[0] * run.t_s[i] + (drift != 0 ? drift * degc_s[i] : 0.0));
      cosine[i] = std::cos(angle);
      sine[i] = std::sin(angle);
    }
    return {cosine, sine};
  }
  // Amplitude: root mean square over the runs.
  Parameters values(const Estimate& e) const override {
    const double n = std::max<double>(1, static_cast<double>(e.coefficients.size()) / 2);
    double square = 0, variance = 0;
    for (double c : e.coefficients) square += c * c;
    for (double s : e.coefficient_errors) variance += s * s;
    const Measured amplitude = {std::sqrt(square / n),
                                e.coefficient_errors.empty() ? kUnknown : std::sqrt(variance / (2 * n) / n)};
    Parameters values = {{"amplitude_dph", amplitude}, {"frequency_hz", e.shape_at(0)}};
    if (e.shape.size() > 1) values.add({"drift_hz_per_degc", e.shape_at(1)});
    return values;
  }
};

} // namespace

IMUCAL_EFFECT(Sinusoid)

} // namespace imucal
