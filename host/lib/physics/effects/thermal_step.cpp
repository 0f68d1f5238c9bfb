// SPDX-License-Identifier: MIT
// The bias jumps where the temperature crosses a threshold, and jumps back when it returns: rate += A s, s =
// 1 from the moment the temperature rises above temp, 0 from the moment it falls below temp - width; in
// between s stays what it was.  Source: the relay (hysteron) from which the Preisach model is built
// (Visintin, Differential Models of Hysteresis, 1994); in gyros a part that snaps between two seats, or a
// loop that changes over at a temperature.  It repeats in every run. Start: where a run begins inside the
// band, s is what the history left.  Drawn: 0 or 1 with equal odds; cold and settled: 0.
#include <algorithm>
#include <cmath>

#include "physics/effects/estimation.h"
#include "physics/effects/lagged.h"
#include "physics/effects/start_state.h"

namespace imucal {
namespace {

// s of the relay, row by row; `start`: its state before the first row.
Column relay_column(const std::vector<double>& temp, double up_degc, double width_degc, bool start) {
  Column column(temp.size());
  bool is_on = start;
  for (size_t i = 0; i < temp.size(); ++i) {
    if (temp[i] > up_degc) is_on = true;
    if (temp[i] < up_degc - width_degc) is_on = false;
    if (width_degc <= 0) is_on = temp[i] > up_degc;
    column[i] = is_on ? 1.0 : 0.0;
  }
  return column;
}

// Share of each row's time that the relay is on.  A row lasts from halfway to the row before to halfway to the next, its
// temperature linear in between: the jump lies where the temperature crosses, not where a row ends, which matters where
// the rows are means over many seconds.
Column relay_share(const std::vector<double>& temp, double up_degc, double width_degc, bool start) {
  const size_t n = temp.size();
  const double down_degc = up_degc - width_degc;
  Column share(n);
  bool is_on = n > 0 && (start ? temp[0] >= down_degc : temp[0] > up_degc);
  for (size_t i = 0; i < n; ++i) {
    const double from = i ? 0.5 * (temp[i - 1] + temp[i]) : temp[i],
                 to = i + 1 < n ? 0.5 * (temp[i] + temp[i + 1]) : temp[i];
    const double limit = is_on ? down_degc : up_degc;
    const bool will_be = is_on ? to >= limit : to > limit;
    const double before = will_be == is_on ? 1.0 : std::clamp((limit - from) / (to - from), 0.0, 1.0);
    share[i] = is_on ? before : 1 - before;
    if (will_be == is_on) share[i] = is_on ? 1.0 : 0.0;
    is_on = will_be;
  }
  return share;
}

// How often the relay jumps, up and down, in one run.  A first jump out of a state that the run did not show is not
// counted: the state may have been the other one.  The band is at least kLeastBand_degc wide here, so that a thermometer's
// noise at the threshold is one passage.
constexpr double kLeastBand_degc = 0.5;
struct Jumps {
  int up = 0, down = 0;
};
Jumps jumps_of(const std::vector<double>& temp, double up_degc, double width_degc) {
  const double down_degc = up_degc - std::max(width_degc, kLeastBand_degc);
  Jumps jumps;
  int state = 0; // +1 above, -1 below, 0 not known yet
  for (double t : temp) {
    const int now = t > up_degc ? 1 : t < down_degc ? -1 : state;
    if (state < 0 && now > 0) ++jumps.up;
    if (state > 0 && now < 0) ++jumps.down;
    state = now;
  }
  return jumps;
}

class ThermalStep : public Effect, public EffectEstimator {
public:
  std::string name() const override { return "thermal_step"; }
  std::string label() const override { return "a jump of the bias at one temperature, repeated in every run"; }
  std::string description() const override {
    return "The bias jumps where the temperature crosses a threshold and jumps back where it returns: relay "
           "(hysteron) of the Preisach model.";
  }
  Family family() const override { return Family::kFunctionOfTemperature; }
  std::vector<HardwareCause> hardware_causes() const override {
    return {{"a part of package or mounting that snaps between two seats under thermal strain",
             "Visintin, Differential Models of Hysteresis (1994), relay"},
            {"a loop, range or table that changes over at a temperature",
             "look for thresholds in the device's own compensation"}};
  }
  std::vector<EffectParameter> parameters() const override {
    return {{"amplitude_dph", -1e6, 1e6, "height of the jump"},
            {"temp_degc", -300, 2000, "temperature at which it jumps when it gets warmer"},
            {"width_degc", 0, 200, "how much colder it has to get to jump back (0: no hysteresis)"},
            start_parameter()};
  }

  void simulate(SimStage stage, const Parameters& parameters, SimRun* run, Rng* rng) const override {
    if (stage != SimStage::kBias) return;
    const double amplitude = parameters.number("amplitude_dph");
    const bool is_on =
        start_of(parameters, *run, rng) == StartState::kRandom && history_of(*this, *run).uniform() < 0.5;
    const Column column =
        relay_column(run->case_temp(), parameters.number("temp_degc"), parameters.number("width_degc"), is_on);
    run->start_state[name() + ".on"] = column.empty() ? 0 : column[0];
    for (size_t i = 0; i < column.size(); ++i) run->rate_dph[i] += amplitude * column[i];
  }

  const EffectEstimator* estimator() const override { return this; }
  Form form() const override { return Form::kColumns; }
  // Thresholds a fortieth of the range apart: refinement finds a jump between two of them.
  std::vector<Theta> grid(double lo, double hi) const override {
    std::vector<Theta> points;
    const double span = hi - lo;
    for (double width : {0.0, 2.0, 6.0})
      for (int k = 1; k < kThresholds && width < 0.5 * span; ++k) {
        const double up = lo + span * k / kThresholds;
        if (up - width > lo) points.push_back({up, width});
      }
    return points;
  }
  Theta shape_lo() const override { return {-250, 0}; }
  Theta shape_hi() const override { return {2000, 60}; }
  // A jump is placed to the second, and the place that jumps is some seconds away from the thermometer: rising and falling
  // temperatures then show it at two temperatures, in the wrong order where the thermometer is late.  Where there is a band, its
  // thresholds are those that the thermometer shows, and hold these seconds.
  bool is_near_thermometer() const override { return true; }
  std::vector<double> nearby_lags_s() const override { return {0}; } // neighbours and pairs of jumps tell the others
  std::vector<Column> columns(const RunInput& run, const Theta& shape) const override {
    return {relay_share(temperature_there(run, shape), shape[0], shape[1], false)};
  }
  // Where the run begins inside the band: until it first leaves it, s may be 1 as well.
  std::vector<Column> start_columns(const RunInput& run, const Theta& shape) const override {
    const Column temp = temperature_there(run, shape);
    Column difference = relay_share(temp, shape[0], shape[1], true);
    const Column off = relay_share(temp, shape[0], shape[1], false);
    if (difference == off) return {};
    for (size_t i = 0; i < difference.size(); ++i) difference[i] -= off[i];
    return {difference};
  }
  // The jump has to come back at the same temperature: twice up or twice down, and without a band once each.
  bool is_repeated(const std::vector<const RunInput*>& runs, const Theta& shape) const override {
    Jumps all;
    for (const RunInput* run : runs) {
      const Jumps jumps = jumps_of(run->smooth_degc, shape[0], shape[1]);
      all.up += jumps.up, all.down += jumps.down;
    }
    return all.up >= 2 || all.down >= 2 || (shape[1] <= kLeastBand_degc && all.up + all.down >= 2);
  }
  // Either threshold alone: moved together they only trade one misplaced jump for the other.  Or the lag.
  std::vector<Theta> neighbours(const Theta& shape, double spacing) const override {
    std::vector<Theta> out;
    const double lag_s = nearby_lag_s(shape, 2);
    for (int k = -4; k <= 4; ++k) {
      const double shift = 0.25 * spacing * k;
      if (k != 0 && shape[1] + shift >= 0) out.push_back({shape[0] + shift, shape[1] + shift, lag_s});
      if (k != 0 && shape[1] - shift >= 0) out.push_back({shape[0], shape[1] - shift, lag_s});
    }
    for (double way_s : {-8., -4., -2., -1., 1., 2., 4., 8.})
      if (!has_band(shape) && std::fabs(lag_s + way_s) <= kNearby_s) out.push_back({shape[0], shape[1], lag_s + way_s});
    return out;
  }
  bool can_jump() const override { return true; }
  // Every place alone, with no band and with one that a ripple of the chamber does not cross; every rising one with every
  // falling one below it; and without a band where that place is as far from the thermometer as the two tell.
  std::vector<Theta> shapes_of_jumps(const std::vector<JumpPlace>& places) const override {
    std::vector<Theta> out;
    for (const JumpPlace& up : places) {
      out.push_back({up.temp_degc, 0, 0});
      out.push_back({up.is_rising() ? up.temp_degc : up.temp_degc + kLeastBand_degc, kLeastBand_degc, 0});
      for (const JumpPlace& down : places) {
        if (!up.is_rising() || down.is_rising()) continue;
        const double band_degc = up.temp_degc - down.temp_degc;
        if (band_degc > 0) out.push_back({up.temp_degc, band_degc, 0});
        const double lag_s = band_degc / (up.slope_degc_s - down.slope_degc_s);
        if (std::fabs(lag_s) <= kNearby_s) out.push_back({up.temp_degc - lag_s * up.slope_degc_s, 0, lag_s});
      }
    }
    return out;
  }
  PriorScale prior() const override { return {3, false, 3}; }
  Parameters values(const Estimate& e) const override {
    return {{"amplitude_dph", e.coefficient(0)}, {"temp_degc", e.shape_at(0)}, {"width_degc", e.shape_at(1)}};
  }

private:
  static constexpr int kThresholds = 40;
  static bool has_band(const Theta& shape) { return shape[1] > 0; }
  static Column temperature_there(const RunInput& run, const Theta& shape) {
    return has_band(shape) ? run.smooth_degc : lagged(run.t_s, run.smooth_degc, nearby_lag_s(shape, 2), 0);
  }
};

} // namespace

IMUCAL_EFFECT(ThermalStep)

} // namespace imucal
