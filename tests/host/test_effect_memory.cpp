// SPDX-License-Identifier: MIT
// Effects with a memory: each against a second derivation written here, with the start state drawn; and what
// the estimators offer against what the simulators make.
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <set>

#include <Eigen/Core>

#include "base/error.h"
#include "dense.h"
#include "io/json_file.h"
#include "physics/effects/estimation.h"
#include "physics/sim/simulate.h"
// After the others: it defines a macro `fail`.
extern "C" {
#include <cmocka.h>
}

using namespace imucal;

// 0 -> 60 -> 0 -> 20 degC at 1 degC/min, with a rest of five minutes at the start.
static std::vector<double> triangle_degc() {
  std::vector<double> temp(300, 0.0);
  for (int k = 1; k <= 3600; ++k) temp.push_back(k / 60.0);
  for (int k = 1; k <= 3600; ++k) temp.push_back(60 - k / 60.0);
  for (int k = 1; k <= 1200; ++k) temp.push_back(k / 60.0);
  return temp;
}

static SimRun empty_run(const std::vector<double>& temp_degc, size_t log = 0, size_t axis = 0) {
  SimRun run;
  run.seed = 5, run.log = log, run.axis = axis;
  for (size_t k = 0; k < temp_degc.size(); ++k) run.t_s.push_back(static_cast<double>(k + 1));
  run.case_temp_degc = run.gyro_temp_degc = run.thermometer_degc = temp_degc;
  run.bias = ThermalPolynomial{30, 30, {80, 300, 150, -100}};
  run.rate_dph.assign(temp_degc.size(), 0.0);
  return run;
}

// The effect in one run, with random numbers (and so a drawn start) or without.
static SimRun simulated(const std::string& name, const char* parameters, SimRun run, bool is_random = true) {
  const Effect& effect = find_effect(name);
  const Parameters values = read_parameters(effect, parse_json(parameters, "test").json());
  Rng rng(run.seed, run.log, static_cast<uint32_t>(run.axis), Stream::kEffect);
  for (const SimStage stage : {SimStage::kTemperature, SimStage::kBias})
    effect.simulate(stage, values, &run, is_random ? &rng : nullptr);
  return run;
}

static void assert_near(double found, double expected, double tolerance, const char* what) {
  if (!(std::fabs(found - expected) <= tolerance)) fail_msg("%s: %.9g, expected %.9g", what, found, expected);
}

// Play is what many relays make together (Visintin 1994): a relay of threshold s switches on above s + r, off
// below s - r, and the play's output is the mass of those that are on.
static void test_hysteresis_is_a_sum_of_relays(void**) {
  const std::vector<double> temp = triangle_degc();
  constexpr double kWidth = 6, kAmplitude = 40, kStep = 0.01, kLowest = -30;
  for (size_t log = 0; log < 2; ++log) {
    const SimRun run =
        simulated("thermal_hysteresis", R"({"amplitude_dph": 40, "width_degc": 6})", empty_run(temp, log));
    const double play_0 = temp[0] + run.start_state.at("thermal_hysteresis.play_frac") * kWidth;
    std::vector<char> is_on;
    for (double s = kLowest; s < 100; s += kStep) is_on.push_back(s < play_0);
    for (size_t k = 0; k < temp.size(); ++k) {
      size_t n_on = 0;
      double s = kLowest;
      for (char& on : is_on) {
        if (temp[k] > s + kWidth) on = 1;
        if (temp[k] < s - kWidth) on = 0;
        n_on += on, s += kStep;
      }
      if (k % 50) continue;
      const double play = kLowest + kStep * static_cast<double>(n_on);
      assert_near(run.rate_dph[k], kAmplitude * (play - temp[k]) / kWidth, 2 * kStep * kAmplitude / kWidth,
                  "hysteresis");
    }
  }
}

// Newton's law of cooling in small steps, from the offset that was drawn.
static void test_lag_is_newtons_cooling(void**) {
  const std::vector<double> temp = triangle_degc();
  std::set<double> offsets;
  for (size_t log = 0; log < 5; ++log) {
    const SimRun run = simulated("thermal_lag", R"({"tau_s": 240})", empty_run(temp, log));
    const double offset = run.start_state.at("thermal_lag.offset_degc");
    assert_true(std::fabs(offset) <= 4.0 + 1e-9); // 240 s behind 1 degC/min
    offsets.insert(offset);
    double gyro = temp[0] + offset;
    for (size_t k = 1; k < temp.size(); ++k) {
      constexpr int kSteps = 100;
      for (int i = 0; i < kSteps; ++i) {
        const double outside = temp[k - 1] + (temp[k] - temp[k - 1]) * (i + 0.5) / kSteps;
        gyro += (outside - gyro) / 240 / kSteps;
      }
      assert_near(run.gyro_temp_degc[k], gyro, 1e-3, "gyro temperature");
    }
  }
  assert_int_equal(offsets.size(), 5);
}

static double e1(double x) {
  return -std::expint(-x);
}

// The mean of exp(-t/tau) over log time from first to last: Fung's box spectrum in closed form.
static double box_relaxation(double t_s, double first_s, double last_s) {
  return (e1(t_s / last_s) - e1(t_s / first_s)) / std::log(last_s / first_s);
}

static void test_creep_after_a_step_is_the_box_spectrum(void**) {
  std::vector<double> temp(20000, 10.0);
  for (size_t k = 0; k < 1000; ++k) temp[k] = 0;
  const char* parameters = R"({"amplitude_dph_per_degc": 3, "tau_first_s": 60, "tau_last_s": 20000})";
  const SimRun run = simulated("thermal_creep", parameters, empty_run(temp), false);
  assert_near(run.rate_dph[999], 0, 1e-12, "before the step");
  for (size_t t : {10, 60, 300, 1000, 5000, 15000}) // the step takes from second 999 to 1000
    assert_near(run.rate_dph[999 + t], 30 * box_relaxation(static_cast<double>(t) - 0.5, 60, 20000), 0.08, "creep");
}

static void test_creep_begins_with_what_an_earlier_change_left(void**) {
  const std::vector<double> temp = triangle_degc();
  const char* parameters = R"({"amplitude_dph_per_degc": 3, "tau_first_s": 60, "tau_last_s": 20000})";
  const SimRun cold = simulated("thermal_creep", parameters, empty_run(temp), false);
  for (size_t log = 0; log < 5; ++log) {
    const SimRun run = simulated("thermal_creep", parameters, empty_run(temp, log));
    const double offset = run.start_state.at("thermal_creep.offset_degc");
    const double since = run.start_state.at("thermal_creep.since_s");
    assert_true(std::fabs(offset) <= 30 && since >= 60 && since <= 20000);
    for (size_t k = 0; k < temp.size(); k += 500)
      assert_near(run.rate_dph[k] - cold.rate_dph[k],
                  3 * offset * box_relaxation(since + static_cast<double>(k), 60, 20000), 0.3, "creep from before");
  }
}

static void test_step_switches_up_and_down_at_its_temperatures(void**) {
  const char* parameters = R"({"amplitude_dph": -25, "temp_degc": 40.01, "width_degc": 10})";
  const SimRun run = simulated("thermal_step", parameters, empty_run(triangle_degc()));
  const size_t up = 300 + 40 * 60, down = 300 + 3600 + 30 * 60;
  assert_near(run.rate_dph[up - 2], 0, 0, "below the threshold");
  assert_near(run.rate_dph[up + 2], -25, 0, "above it");
  assert_near(run.rate_dph[down - 2], -25, 0, "inside the band, from above");
  assert_near(run.rate_dph[down + 2], 0, 0, "below the band");
}

static void test_step_that_begins_inside_its_band_is_on_in_half_of_the_runs(void**) {
  size_t n_on = 0;
  for (size_t log = 0; log < 400; ++log) {
    const SimRun run = simulated("thermal_step", R"({"amplitude_dph": 1, "temp_degc": 2, "width_degc": 9})",
                                 empty_run(std::vector<double>(2, 0.0), log));
    n_on += run.rate_dph[0] == 1;
  }
  assert_in_range(n_on, 160, 240); // four standard errors
}

// exp(-off/tau) of the warmth is left; log10(off/tau) is uniform from -1 to 1: the median restart has 1 -
// 1/e.
// Runs as the engine sees them, of their temperatures alone.
static bool is_repeated(const std::vector<std::vector<double>>& temps, const Theta& shape) {
  std::vector<RunInput> runs(temps.size());
  std::vector<const RunInput*> pointers;
  for (size_t r = 0; r < temps.size(); ++r) runs[r].smooth_degc = temps[r], pointers.push_back(&runs[r]);
  return find_effect("thermal_step").estimator()->is_repeated(pointers, shape);
}

static void test_a_jump_at_a_temperature_is_one_only_where_it_comes_back(void**) {
  const std::vector<double> triangle = triangle_degc(), cooling = {40, 35, 30, 25, 20}, warming = {0, 10, 20, 30, 39};
  assert_true(is_repeated({triangle}, {40, 0}));           // up and down through the same place
  assert_true(is_repeated({triangle, triangle}, {40, 5})); // twice up
  assert_true(is_repeated({warming, warming}, {25, 10}));
  assert_false(is_repeated({triangle}, {40, 5}));           // once up at 40, once down at 35
  assert_false(is_repeated({cooling, warming}, {28, 20}));  // once up; the band is never left downward
  assert_false(is_repeated({cooling, warming}, {39.5, 0})); // only one run gets there
  // A thermometer's noise at the threshold is one passage.
  assert_false(is_repeated({{20, 29.9, 30.1, 29.8, 30.2, 29.9, 30.1, 40}}, {30, 0}));
}

static void test_typical_sizes_are_valid_and_ordered(void**) {
  std::set<int> places;
  std::set<std::string> short_names;
  for (const Effect* effect : effect_library())
    for (int order : {3, 4})
      if (const std::optional<TypicalSize> size = effect->typical_size(order)) {
        read_parameters(*effect, spec_of(*effect, size->parameters).parameters); // inside their bounds
        if (order == 4) continue;
        assert_true(places.insert(size->place).second);
        assert_true(short_names.insert(size->short_name).second);
      }
  assert_int_equal(places.size(), 7);
}

static void test_warm_restarts_have_less_of_the_warm_up(void**) {
  size_t n_below = 0;
  for (size_t log = 0; log < 400; ++log) {
    const SimRun run =
        simulated("warm_up", R"({"amplitude_dph": 10, "tau_s": 50})", empty_run(std::vector<double>(51, 0.0), log));
    const double left = run.rate_dph[0] / 10;
    assert_true(left > 0.095 && left <= 1);
    assert_near(run.rate_dph[50], run.rate_dph[0] * std::exp(-1.0), 1e-12, "decay");
    n_below += left < 1 - std::exp(-1.0);
  }
  assert_in_range(n_below, 160, 240);
}

// dTg/dt = (T - Tg)/tau by small steps, and its slope: a place some seconds behind the thermometer feels that one.
static void test_rate_near_the_thermometer_is_that_of_a_place_behind_it(void**) {
  RunInput run;
  std::vector<double> place_degc;
  double place = 20;
  const auto thermometer = [](double t) { return 20 + 5 * std::sin(t / 90) * std::min(1.0, t / 300); };
  for (int k = 0; k < 2000; ++k) {
    run.t_s.push_back(k), run.tick.push_back(k), run.rate_dph.push_back(0);
    run.temp_degc.push_back(thermometer(k)), place_degc.push_back(place);
    for (int i = 0; i < 100; ++i) place += 0.01 / 8 * (thermometer(k + 0.01 * i) - place);
  }
  run.smooth_degc = run.temp_degc;
  run.rate_degc_min.assign(run.t_s.size(), 0.0);
  for (size_t k = 1; k + 1 < run.t_s.size(); ++k)
    run.rate_degc_min[k] = 30 * (run.temp_degc[k + 1] - run.temp_degc[k - 1]);
  const Column column = find_effect("temperature_rate").estimator()->columns(run, {8})[0];
  const Column temp = find_effect("temperature_sensor_quantization").estimator()->temperature(run, {0.5, 8});
  for (size_t k = 400; k + 1 < run.t_s.size(); ++k) {
    assert_near(column[k], 30 * (place_degc[k + 1] - place_degc[k - 1]), 0.01, "slope");
    assert_near(temp[k], place_degc[k], 0.01, "temperature");
  }
}

// A tone of 0.01 Hz + 1e-4 Hz/degC on a ramp of a/60 degC/s: its phase is a quadratic in time.
static void test_tone_drifts_by_the_integral_of_temperature(void**) {
  std::vector<double> temp;
  for (int k = 0; k < 3600; ++k) temp.push_back(5 + k / 60.0);
  const SimRun run = simulated("sinusoid", R"({"amplitude_dph": 8, "frequency_hz": 0.01, "drift_hz_per_degc": 1e-4})",
                               empty_run(temp), false);
  for (int k = 0; k < 3600; k += 37) {
    const double cycles = 0.01 * (k + 1) + 1e-4 * (5.0 * k + 0.5 * k * k / 60.0);
    assert_near(run.rate_dph[static_cast<size_t>(k)], 8 * std::sin(2 * 3.14159265358979323846 * cycles), 1e-6, "tone");
  }
}

static void test_start_is_shared_by_axes_and_new_in_every_run(void**) {
  const char* parameters = R"({"amplitude_dph": 40, "width_degc": 6})";
  const std::vector<double> temp = triangle_degc();
  std::set<double> starts;
  for (size_t log = 0; log < 20; ++log) {
    const SimRun x = simulated("thermal_hysteresis", parameters, empty_run(temp, log, 0));
    const SimRun y = simulated("thermal_hysteresis", parameters, empty_run(temp, log, 1));
    assert_true(x.rate_dph == y.rate_dph);
    starts.insert(x.start_state.at("thermal_hysteresis.play_frac"));
  }
  assert_int_equal(starts.size(), 20);
  assert_true(*starts.begin() < -0.5 && *starts.rbegin() > 0.5);
}

static void test_start_can_be_asked_for(void**) {
  const std::vector<double> temp = triangle_degc();
  const auto first = [&](const char* own, StartState of_run) {
    SimRun run = empty_run(temp, 3);
    run.start = of_run;
    const std::string parameters = std::string(R"({"amplitude_dph": 40, "width_degc": 6)") + own + "}";
    return simulated("thermal_hysteresis", parameters.c_str(), run).rate_dph[0];
  };
  assert_near(first("", StartState::kCold), 40, 1e-12, "cold");
  assert_near(first("", StartState::kSettled), 0, 1e-12, "settled");
  assert_near(first(R"(, "start": "settled")", StartState::kCold), 0, 1e-12, "its own word goes first");
  try {
    first(R"(, "start": "warm")", StartState::kCold);
    fail_msg("an unknown start was taken");
  } catch (const Error& error) {
    assert_non_null(std::strstr(error.what(), "random, cold, settled"));
  }
}

// ---- what the estimators offer ----

static RunInput input_of(const SimRun& run) {
  RunInput in;
  const std::vector<double>& temp = run.case_temp_degc;
  const size_t n = temp.size();
  in.t0_degc = 30, in.range_degc = 30;
  in.temp_degc = in.smooth_degc = temp;
  in.auxiliary = run.auxiliary;
  for (size_t k = 0; k < n; ++k) {
    in.t_s.push_back(run.t_s[k] - run.t_s[0]);
    in.tn.push_back((temp[k] - 30) / 30);
    const size_t a = k ? k - 1 : 0, b = k + 1 < n ? k + 1 : k;
    in.rate_degc_min.push_back((temp[b] - temp[a]) / static_cast<double>(b - a) * 60);
  }
  return in;
}

static Eigen::MatrixXd matrix_of(const std::vector<Column>& columns, size_t rows) {
  Eigen::MatrixXd m(static_cast<long>(rows), static_cast<long>(columns.size()));
  for (size_t c = 0; c < columns.size(); ++c)
    m.col(static_cast<long>(c)) = Eigen::Map<const Eigen::VectorXd>(columns[c].data(), static_cast<long>(rows));
  return m;
}

static double left_norm(const Eigen::MatrixXd& columns, const Eigen::VectorXd& y) {
  if (columns.cols() == 0) return y.norm();
  return (y - columns * dense_least_squares(columns, y)).norm();
}

static std::vector<Column> powers(const Column& temp) {
  std::vector<Column> out(4, Column(temp.size(), 1.0));
  for (size_t k = 0; k < temp.size(); ++k)
    for (size_t i = 1; i < 4; ++i) out[i][k] = out[i - 1][k] * (temp[k] - 30) / 30;
  return out;
}

// The recorder stops for an hour, in which the temperature goes to 60 degC and back: nobody has seen that.
static void cut_an_hour(SimRun* run) {
  for (std::vector<double>* column : {&run->t_s, &run->case_temp_degc, &run->gyro_temp_degc, &run->rate_dph})
    column->erase(column->begin() + 2400, column->begin() + 6000);
}

// The part of what the effect adds that lies in the span of the estimator's columns.  `is_cut`: of a log with a pause;
// `knows`: that it has one.
static double captured(const std::string& name, const char* parameters, const Theta& shape, size_t log,
                       bool is_cut = false, bool knows = false) {
  SimRun run = empty_run(triangle_degc(), log);
  for (double t : run.t_s) run.auxiliary["supply_v"].push_back(std::cos(t / 77));
  run = simulated(name, parameters, run);
  if (is_cut) cut_an_hour(&run);
  const EffectEstimator& estimator = *find_effect(name).estimator();
  RunInput in = input_of(run);
  if (knows) in.restarts = {2400};
  const size_t n = in.size();
  std::vector<Column> offered = estimator.columns(in, shape), nominal;
  if (estimator.form() == Form::kTemperature) {
    // What counts is the change of B(T) beyond what the polynomial of the logged temperature follows.
    offered = powers(estimator.temperature(in, shape));
    nominal = powers(in.temp_degc);
    for (size_t k = 0; k < n; ++k) run.rate_dph[k] += run.bias.at(run.gyro_temp_degc[k]);
  }
  for (const Column& column : free_states(estimator, in, shape)) offered.push_back(column);
  const Eigen::VectorXd y = matrix_of({run.rate_dph}, n);
  const double effect = left_norm(matrix_of(nominal, n), y), left = left_norm(matrix_of(offered, n), y);
  return std::sqrt(1 - left * left / effect / effect);
}

struct Spanned {
  const char *name, *parameters;
  Theta shape;
};

static void test_columns_span_what_is_simulated_from_any_start(void**) {
  const Spanned cases[] = {
      {"temperature_rate", R"({"k_dph_per_degc_min": 7})", {}},
      {"thermal_hysteresis", R"({"amplitude_dph": 40, "width_degc": 2})", {2}},
      {"thermal_hysteresis", R"({"amplitude_dph": -40, "width_degc": 8})", {8}},
      {"thermal_lag", R"({"tau_s": 120})", {120}},
      {"thermal_lag", R"({"tau_s": 600})", {600}},
      {"thermal_lag", R"({"tau_s": -120})", {-120}},
      {"thermal_creep", R"({"amplitude_dph_per_degc": 3, "tau_first_s": 30, "tau_last_s": 3000})", {30, 3000}},
      {"thermal_creep", R"({"amplitude_dph_per_degc": 3, "tau_first_s": 100, "tau_last_s": 50000})", {100, 50000}},
      {"thermal_step", R"({"amplitude_dph": 30, "temp_degc": 3, "width_degc": 6})", {3, 6}},
      {"thermal_anomaly", R"({"amplitude_dph": 9, "center_degc": 20, "width_degc": 2})", {20, 2}},
      {"higher_order_polynomial", R"({"p4_dph": 3, "p5_dph": 5})", {}},
      {"rate_ramp", R"({"ramp_dph_per_h": 10})", {}},
      {"warm_up", R"({"amplitude_dph": 10, "tau_s": 500})", {500}},
      {"run_to_run", R"({"sigma_dph": 30})", {}},
      {"auxiliary_channel", R"({"channel": "supply_v", "gain": 4})", {0}},
      {"sinusoid", R"({"amplitude_dph": 4, "frequency_hz": 0.013})", {0.013}},
      {"sinusoid", R"({"amplitude_dph": 4, "frequency_hz": 0.013, "drift_hz_per_degc": 2e-5})", {0.013, 2e-5}},
  };
  for (const Spanned& c : cases)
    for (size_t log = 0; log < 8; ++log) {
      const double share = captured(c.name, c.parameters, c.shape, log);
      if (!(share > 0.999)) fail_msg("%s %s, run %zu: %.5f", c.name, c.parameters, log, share);
    }
}

// After a pause a memory is in a state of its own; only where that is known do the columns span it.
static void test_states_after_a_pause_are_free(void**) {
  const Spanned cases[] = {
      {"thermal_hysteresis", R"({"amplitude_dph": 40, "width_degc": 8})", {8}},
      {"thermal_lag", R"({"tau_s": 600})", {600}},
      {"thermal_creep", R"({"amplitude_dph_per_degc": 3, "tau_first_s": 30, "tau_last_s": 3000})", {30, 3000}},
  };
  for (const Spanned& c : cases)
    for (size_t log = 0; log < 4; ++log) {
      const double known = captured(c.name, c.parameters, c.shape, log, true, true),
                   unknown = captured(c.name, c.parameters, c.shape, log, true, false);
      if (!(known > 0.998) || !(1 - known < 0.25 * (1 - unknown)))
        fail_msg("%s %s, run %zu: %.5f, without %.5f", c.name, c.parameters, log, known, unknown);
    }
}

// Without its start columns a run that begins elsewhere is not in the span: they are needed.
static void test_start_columns_are_needed(void**) {
  const std::vector<double> temp = triangle_degc();
  const EffectEstimator& estimator = *find_effect("thermal_hysteresis").estimator();
  const SimRun run = simulated("thermal_hysteresis", R"({"amplitude_dph": 40, "width_degc": 8})", empty_run(temp, 2));
  const RunInput in = input_of(run);
  const Eigen::VectorXd y = matrix_of({run.rate_dph}, in.size());
  const double left = left_norm(matrix_of(estimator.columns(in, {8}), in.size()), y);
  assert_true(left / y.norm() > 0.045); // more than 0.2 % of the energy
}

// Relays on a grid of the Preisach plane with a weight of their own each, which is no play.  Over a triangle and a smaller one
// after it, a constant and a cubic free, the columns of any shape leave less than half of the energy that the best play leaves.
static void test_any_loop_is_a_sum_of_functions_of_plays(void**) {
  std::vector<double> temp = triangle_degc();
  const std::vector<double> once = temp;
  for (double t : once) temp.push_back(0.5 * t + 0.5 * once.front());
  const RunInput in = input_of(empty_run(temp, 0));
  const auto [lo, hi] = std::minmax_element(temp.begin(), temp.end());
  Rng rng(3, 0, 0, Stream::kTool);
  Column loop(temp.size(), 0.0);
  for (double up = *lo + 1; up < *hi; up += 1.5)
    for (double down = std::max(*lo, up - 20); down < up; down += 1.5) {
      const double weight = -std::log(1 - rng.uniform());
      bool is_on = false;
      for (size_t k = 0; k < temp.size(); ++k) {
        is_on = temp[k] > up || (is_on && temp[k] >= down);
        loop[k] += weight * ((is_on ? 1 : -1) - (temp[k] > 0.5 * (up + down) ? 1 : -1));
      }
    }
  const EffectEstimator& play = *find_effect("thermal_hysteresis").estimator();
  const EffectEstimator& any = *play.of_any_shape().estimator;
  const auto left = [&](const EffectEstimator& estimator, const Theta& shape, const Column& signal) {
    std::vector<Column> offered = powers(temp);
    for (const Column& c : estimator.columns(in, shape)) offered.push_back(c);
    for (const Column& c : estimator.start_columns(in, shape)) offered.push_back(c);
    return left_norm(matrix_of(offered, in.size()), matrix_of({signal}, in.size()));
  };
  assert_int_equal(any.columns(in, {}).size(), any.n_columns());
  assert_int_equal(any.relative_sd().size(), any.n_columns());
  double best_play = 1e300;
  for (double width = 1; width < 20; width += 0.5) best_play = std::min(best_play, left(play, {width}, loop));
  assert_true(std::pow(left(any, {}, loop) / best_play, 2) < 0.5);
}

static void test_prior_and_words_are_there_for_every_effect(void**) {
  for (const Effect* effect : effect_library()) {
    assert_true(effect->label().size() > 8 && effect->label() != effect->name());
    assert_true(!effect->hardware_causes().empty());
    for (const HardwareCause& cause : effect->hardware_causes())
      assert_true(cause.what.size() > 15 && cause.source.size() > 10);
    assert_true(effect->estimator()->prior().column > 0 && effect->estimator()->prior().start > 0);
  }
}

// The families of the contract, member by member (host/formats.md, Diagnosis).
static void test_families_are_those_of_the_contract(void**) {
  const std::map<std::string, std::set<std::string>> contract = {
      {"thermal_memory", {"temperature_rate", "thermal_hysteresis", "thermal_lag", "thermal_creep"}},
      {"function_of_temperature",
       {"thermal_anomaly", "thermal_step", "higher_order_polynomial", "temperature_sensor_quantization"}},
      {"function_of_time", {"rate_ramp", "warm_up", "bias_step"}},
      {"slow_noise",
       {"noise_parameters", "second_markov", "rate_random_walk", "flicker_noise", "markov_sigma_vs_temperature",
        "markov_tau_vs_temperature", "telegraph_noise"}},
      {"fast_noise", {"white_noise_vs_temperature", "outliers", "held_samples"}},
      {"tone", {"sinusoid"}},
      {"structural", {"quantization", "saturation", "dead_band"}},
      {"external", {"auxiliary_channel", "common_mode"}},
      {"run_to_run", {"run_to_run"}}};
  std::map<std::string, std::set<std::string>> found;
  for (const Effect* effect : effect_library()) found[family_name(effect->family())].insert(effect->name());
  assert_true(found == contract);
  for (const Effect* effect : effect_library())
    assert_int_equal(effect->estimator()->is_slow_noise(), effect->family() == Family::kSlowNoise);
}

// Whatever t0 and range a model has, the columns are P4 and P5 over the temperatures of the logs, and what is told of them is that
// curve: its parameters in those units, and the cubic that the polynomial takes.
static void test_higher_orders_are_estimated_over_the_logs_and_told_in_the_units_of_the_model(void**) {
  const EffectEstimator& poly = *find_effect("higher_order_polynomial").estimator();
  RunInput run;
  run.t0_degc = 30, run.range_degc = 30, run.lo_degc = -40, run.hi_degc = 0;
  run.smooth_degc = {-40, -33, -20, -9.5, 0}, run.t_s = {1, 2, 3, 4, 5};
  const Estimate estimate = {{}, {2, -3}, {}, {0.1, 0.2}};
  const auto told_at = [&](size_t i) {
    const double z = run.normalised(run.smooth_degc[i]);
    const Parameters told = poly.values_on(run, estimate);
    double sum = told.number("p4_dph") * legendre(4, z) + told.number("p5_dph") * legendre(5, z), power = 1;
    for (double coefficient : poly.polynomial_beside(run, estimate)) sum += coefficient * power, power *= z;
    return sum;
  };
  for (const int order : {3, 2}) {
    run.order = order;
    const std::vector<Column> columns = poly.columns(run, {});
    for (size_t i = 0; i < run.size(); ++i) {
      const double sum = 2 * columns[0][i] - 3 * columns[1][i];
      assert_near(told_at(i), sum, 1e-9 * (1 + std::fabs(sum)), "what is told");
    }
    if (order == 3) assert_near(columns[1][0], -1, 1e-12, "P5 at the cold end");
    if (order == 2) // the polynomial would not take the rest
      for (double coefficient : poly.polynomial_beside(run, estimate))
        assert_near(coefficient, 0, 1e-9, "the polynomial beside");
  }
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_higher_orders_are_estimated_over_the_logs_and_told_in_the_units_of_the_model),
      cmocka_unit_test(test_hysteresis_is_a_sum_of_relays),
      cmocka_unit_test(test_lag_is_newtons_cooling),
      cmocka_unit_test(test_creep_after_a_step_is_the_box_spectrum),
      cmocka_unit_test(test_creep_begins_with_what_an_earlier_change_left),
      cmocka_unit_test(test_step_switches_up_and_down_at_its_temperatures),
      cmocka_unit_test(test_step_that_begins_inside_its_band_is_on_in_half_of_the_runs),
      cmocka_unit_test(test_a_jump_at_a_temperature_is_one_only_where_it_comes_back),
      cmocka_unit_test(test_typical_sizes_are_valid_and_ordered),
      cmocka_unit_test(test_warm_restarts_have_less_of_the_warm_up),
      cmocka_unit_test(test_tone_drifts_by_the_integral_of_temperature),
      cmocka_unit_test(test_rate_near_the_thermometer_is_that_of_a_place_behind_it),
      cmocka_unit_test(test_start_is_shared_by_axes_and_new_in_every_run),
      cmocka_unit_test(test_start_can_be_asked_for),
      cmocka_unit_test(test_columns_span_what_is_simulated_from_any_start),
      cmocka_unit_test(test_states_after_a_pause_are_free),
      cmocka_unit_test(test_start_columns_are_needed),
      cmocka_unit_test(test_any_loop_is_a_sum_of_functions_of_plays),
      cmocka_unit_test(test_prior_and_words_are_there_for_every_effect),
      cmocka_unit_test(test_families_are_those_of_the_contract),
  };
  return cmocka_run_group_tests_name("effect memory", tests, nullptr, nullptr);
}
