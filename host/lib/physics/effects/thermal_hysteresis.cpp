// SPDX-License-Identifier: MIT
// Bias that depends on the direction from which a temperature was reached: rate += A (P[T] - T)/r, where P is
// the play (backlash) operator of half-width r, P_k = clip(P_{k-1}, T_k - r, T_k + r).  After 2r of travel
// the term is -A going up and +A going down: A is half the opening of the loop.  Source: Prandtl-Ishlinskii
// model of hysteresis (Visintin, Differential Models of Hysteresis, 1994).
// Start: the play is where the history before the run left it, P = T + u r, u from -1 (came up) to +1 (came
// down), uniform.  The cold start has come from the far side: u = +1 in the lower half of the temperatures of
// the run, else -1.
#include <algorithm>
#include <array>
#include <cmath>

#include "base/units.h"
#include "physics/effects/estimation.h"
#include "physics/effects/start_state.h"

namespace imucal {
namespace {

// (P[T] - T)/r of the play operator, started at P = T + start r: means over so many temperatures each.
Column play_column(const std::vector<double>& temp, double width, double start, size_t per_row = 1) {
  Column column(temp.size() / per_row);
  double play = temp.empty() ? 0 : temp[0] + start * width;
  for (size_t i = 0, row = 0; row < column.size(); ++row) {
    double sum = 0;
    for (const size_t end = i + per_row; i < end; ++i) {
      play = std::clamp(play, temp[i] - width, temp[i] + width);
      sum += play - temp[i];
    }
    column[row] = sum / (width * static_cast<double>(per_row));
  }
  return column;
}
Column play_column(const RunInput& run, double width, double start) {
  return run.path_degc.empty() ? play_column(run.smooth_degc, width, start)
                               : play_column(run.path_degc, width, start, run.path_per_row);
}

double cold_start(const std::vector<double>& temp) {
  if (temp.empty()) return 0;
  const auto [lo, hi] = std::minmax_element(temp.begin(), temp.end());
  return temp[0] < 0.5 * (*lo + *hi) ? 1 : -1;
}

constexpr double kNothing = 1e-9; // of the size of the loop

// What a start adds to the middle one: a curve over the start, of which straight lines between these states are taken.  Half of
// what separates a start at the upper end of the play from one at the lower end; half of what the two together have beyond twice
// the middle; then of every state halfway between two what it has beyond their mean.  Without halvings up to 0.8 % of the energy
// of a loop stay out with the first column alone, less than 0.1 % with both (width up to 8 degC on a run of 60 degC); every
// halving leaves an eighth.  States that no row tells apart have no column.
std::vector<Column> play_start_columns(const RunInput& run, double width, int halvings) {
  const auto from = [&](double start) { return play_column(run, width, start); };
  // a_part a + b_part b + c_part c
  const auto sum = [](double a_part, const Column& a, double b_part, const Column& b, double c_part, const Column& c) {
    Column out(a.size());
    for (size_t i = 0; i < out.size(); ++i) out[i] = a_part * a[i] + b_part * b[i] + c_part * c[i];
    return out;
  };
  std::vector<Column> states = {from(-1), from(0), from(1)}, out;
  out.push_back(sum(0.5, states[2], -0.5, states[0], 0, states[1]));
  out.push_back(sum(0.5, states[2], 0.5, states[0], -1, states[1]));
  for (int halving = 0; halving < halvings; ++halving) {
    std::vector<Column> finer = {states[0]};
    for (size_t k = 1; k < states.size(); ++k) {
      const double places = static_cast<double>(states.size() - 1),
                   middle = (2 * static_cast<double>(k) - 1) / places - 1;
      finer.push_back(from(middle));
      Column beyond = sum(1, finer.back(), -0.5, states[k - 1], -0.5, states[k]);
      if (std::any_of(beyond.begin(), beyond.end(), [](double x) { return std::fabs(x) > kNothing; }))
        out.push_back(std::move(beyond));
      finer.push_back(states[k]);
    }
    states = std::move(finer);
  }
  return out;
}

// Any loop that does not depend on time: every Preisach operator is a sum of functions of plays of all widths (Brokate and
// Sprekels, Hysteresis and Phase Transitions, 1996).  Three widths; of each the play itself and cosines of where it stands,
// less the same cosines of the temperature: what is a function of temperature is another cause.
class AnyLoop : public EffectEstimator {
public:
  Form form() const override { return Form::kColumns; }
  size_t n_columns() const override { return kWidths.size() * (1 + kCosines); }
  std::vector<Column> columns(const RunInput& run, const Theta&) const override {
    const std::vector<Column> still = cosines(run, run.smooth_degc);
    std::vector<Column> out;
    for (double width : kWidths) {
      Column play = play_column(run, width, 0), stands = run.smooth_degc;
      for (size_t i = 0; i < stands.size(); ++i) stands[i] += width * play[i];
      out.push_back(std::move(play));
      std::vector<Column> moved = cosines(run, stands);
      for (size_t k = 0; k < moved.size(); ++k) {
        for (size_t i = 0; i < stands.size(); ++i) moved[k][i] -= still[k][i];
        out.push_back(std::move(moved[k]));
      }
    }
    return out;
  }
  std::vector<double> relative_sd() const override {
    std::vector<double> out;
    for (size_t w = 0; w < kWidths.size(); ++w) {
      out.push_back(1);
      for (int k = 1; k <= kCosines; ++k) out.push_back(1.0 / k);
    }
    return out;
  }
  std::vector<Column> start_columns(const RunInput& run, const Theta&) const override {
    std::vector<Column> out;
    for (double width : kWidths)
      for (Column& c : play_start_columns(run, width, std::min(kMostHalvings, run.start_halvings)))
        out.push_back(std::move(c));
    return out;
  }
  PriorScale prior() const override { return {1.5, false, 1}; }
  Parameters values(const Estimate&) const override { return {}; }

private:
  static constexpr std::array<double, 3> kWidths = {1.5, 4, 10};
  static constexpr int kCosines = 10;
  static constexpr int kMostHalvings = 1; // three plays have many columns, and leave little to each other
  // cos(k pi u), k = 1 .. kCosines, u over the temperatures from 0 to 1 and a tenth of that beyond.  Each from the two before it:
  // cos((k + 1) a) = 2 cos(a) cos(k a) - cos((k - 1) a).
  static std::vector<Column> cosines(const RunInput& run, const Column& temp_degc) {
    std::vector<Column> out(kCosines, Column(temp_degc.size()));
    for (size_t i = 0; i < temp_degc.size(); ++i) {
      const double one = std::cos(kPi * std::clamp(run.place_in_span(temp_degc[i]), 0.0, 1.0));
      double last = 1, now = one;
      for (Column& column : out) {
        column[i] = now;
        const double next = 2 * one * now - last;
        last = now, now = next;
      }
    }
    return out;
  }
};

class ThermalHysteresis : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "thermal_hysteresis"; }
  std::string label() const override {
    return "thermal hysteresis: the bias depends on where the temperature came from";
  }
  std::string description() const override {
    return "Bias that depends on the direction from which a temperature was reached: play (backlash) "
           "operator of the Prandtl-Ishlinskii hysteresis model.";
  }
  Family family() const override { return Family::kThermalMemory; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"stress of die attach, solder or package that does not return on the same path",
             "Acar and Shkel, MEMS Vibratory Gyroscopes (2009), packaging"},
            {"friction or settling of the mounting, screws and board under thermal strain",
             "Visintin, Differential Models of Hysteresis (1994), play"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {
        {"amplitude_dph", -1e6, 1e6, "half the opening of the loop (negative: the loop is run the other way round)"},
        {"width_degc", 0.05, 200, "travel of temperature until half of the loop is crossed (play half-width)"},
        start_parameter()};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = parameters.number("amplitude_dph");
    const double width = parameters.number("width_degc");
    const double start = drawn_start(parameters, *run, rng);
    run->start_state[name() + ".play_frac"] = start;
    const Column column = play_column(run->case_temp(), width, start);
    for (size_t i = 0; i < column.size(); ++i) run->rate_dph[i] += amplitude * column[i];
  }

  std::optional<TypicalSize> typical_size(int /*order*/) const override {
    return TypicalSize{"hyst", 3, true, {{"amplitude_dph", 10.0}, {"width_degc", 5.0}}};
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
    return columns_from(run, shape, 0);
  }
  std::vector<Column> columns_from(const RunInput& run, const Theta& shape, double start) const override {
    return {play_column(run, shape[0], start)};
  }
  std::vector<Column> start_columns(const RunInput& run, const Theta& shape) const override {
    return play_start_columns(run, shape[0], run.start_halvings);
  }
  AnyShape of_any_shape() const override {
    static const AnyLoop any;
    return {&any, "a loop of another shape than that of one play"};
  }
  bool is_start_bounded() const override { return true; } // the play lies within its two branches
  // Every turn of the temperature is a corner, at the width that it just crosses.
  bool has_many_tops() const override { return true; }
  double notable() const override { return 0.8; }
  PriorScale prior() const override { return {1.5, false, 1}; }
  Parameters values(const Estimate& e) const override {
    return {{"amplitude_dph", e.coefficient(0)}, {"width_degc", e.shape_at(0)}};
  }

private:
  double drawn_start(const Parameters& parameters, const SimRun& run, const Rng* rng) const {
    switch (start_of(parameters, run, rng)) {
    case StartState::kSettled:
      return 0;
    case StartState::kCold:
      return cold_start(run.case_temp());
    case StartState::kRandom:
      break;
    }
    return 2 * history_of(*this, run).uniform() - 1;
  }
};

} // namespace

IMUCAL_EFFECT(ThermalHysteresis)

} // namespace imucal
