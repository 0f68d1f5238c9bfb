// SPDX-License-Identifier: MIT
// The bias follows another quantity (supply, vibration, acceleration) that the log records in a column of its
// own: rate += gain * column.  Where the run has no such column a plausible one is made: a Gauss-Markov
// process of one unit and 300 s, the same for all axes of the run (a sine of 1000 s when no noise is asked
// for).
#include <cmath>
#include <iterator>

#include "base/units.h"
#include "physics/effects/estimation.h"

namespace imucal {
namespace {

std::vector<double> made_up_column(const SimRun& run, bool random) {
  constexpr double kTau = 300.0;
  Rng rng(run.seed, run.log, 0xffffffffu, 901u);
  std::vector<double> column(run.t_s.size());
  double level = random ? rng.normal() : 0.0;
  for (size_t i = 0; i < column.size(); ++i) {
    if (i && random) {
      const double phi = std::exp(-(run.t_s[i] - run.t_s[i - 1]) / kTau);
      level = phi * level + std::sqrt(1.0 - phi * phi) * rng.normal();
    }
    column[i] = random ? level : std::sin(2 * kPi * run.t_s[i] / 1000.0);
  }
  return column;
}

class AuxiliaryChannel : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "auxiliary_channel"; }
  std::string label() const override { return "sensitivity to another recorded channel"; }
  std::string description() const override {
    return "The bias follows an auxiliary column of the log (supply, vibration, acceleration).";
  }
  Family family() const override { return Family::kExternal; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"supply, vibration or acceleration acts on the bias", "IEEE Std 1431-2004, sensitivities"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"channel", 0, 0, "name of the column, e.g. supply_v", EffectParameter::kText},
            {"gain", -1e9, 1e9, "dph per unit of the column"}};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kBias) return;
    const std::string channel = parameters.text_or("channel", "");
    const double gain = parameters.number("gain");
    std::vector<double>& column = run->auxiliary[channel];
    if (column.empty()) column = made_up_column(*run, rng != nullptr);
    for (size_t i = 0; i < run->rate_dph.size(); ++i) run->rate_dph[i] += gain * column[i];
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  bool needs_temperature() const override { return false; }
  // The shape is the place of the column among the auxiliary columns of the log.
  std::vector<Theta> grid_on(const RunInput& run, double, double) const override {
    std::vector<Theta> places;
    for (size_t i = 0; i < run.auxiliary.size(); ++i) places.push_back({static_cast<double>(i)});
    return places;
  }
  std::vector<Theta> grid(double, double) const override { return {}; }
  PriorScale prior() const override { return {1, true, 1}; }
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    Column column(run.size(), 0.0);
    if (shape.empty() || shape[0] >= static_cast<double>(run.auxiliary.size())) return {column};
    auto it = run.auxiliary.begin();
    std::advance(it, static_cast<long>(shape[0]));
    // Where the column has no value it says nothing new: the last one holds.
    double last = 0;
    for (double value : it->second)
      if (std::isfinite(value)) {
        last = value;
        break;
      }
    for (size_t i = 0; i < column.size() && i < it->second.size(); ++i) {
      if (std::isfinite(it->second[i])) last = it->second[i];
      column[i] = last;
    }
    return {column};
  }
  Parameters values(const Estimate& e) const override { return {{"gain", e.coefficient(0)}}; }
  std::string column_of(const RunInput& run, const Theta& shape) const override {
    auto it = run.auxiliary.begin();
    if (!shape.empty()) std::advance(it, static_cast<long>(shape[0]));
    return it->first;
  }
  Parameters values_on(const RunInput& run, const Estimate& e) const override {
    return {{"channel", column_of(run, e.shape)}, {"gain", e.coefficient(0)}};
  }
};

} // namespace

IMUCAL_EFFECT(AuxiliaryChannel)

} // namespace imucal
