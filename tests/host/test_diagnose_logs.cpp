// SPDX-License-Identifier: MIT
// Logs as they come: given twice, with a pause of hours, with rows missing; and the model that is written of them.
#include "analysis/diagnose/logs/smoothing.h"
#include "analysis/diagnose/logs/thermometer_noise.h"
#include "analysis/diagnose/logs/unlike.h"
#include "base/error.h"
#include "diagnose_logs.h"

namespace {

constexpr double kPauseAt_s = 2000, kPause_s = 36000;

// A log whose recorder pauses for ten hours; the bias jumps at row `jump`.
Log paused_log(uint64_t seed, size_t jump, double height_dph) {
  Log log = simulated_log(seed, 6000, false, 0);
  for (size_t i = 0; i < log.size(); ++i) {
    if (i >= jump) log.axes[0].rate_dph[i] += height_dph;
    if (log.t_s[i] > kPauseAt_s) log.t_s[i] += kPause_s;
  }
  return log;
}

DiagnoseResult answer(const std::vector<Log>& logs, const std::vector<Log>& held_out,
                      const ErrorModel* model = nullptr) {
  DiagnoseOptions options;
  options.nulls = 40;
  if (model) options.model_path = "given";
  return diagnose_logs(options, model ? *model : ErrorModel(), logs, held_out);
}

// Why a call is refused; empty: it is answered.
std::string refusal(const std::vector<Log>& logs, const std::vector<Log>& held_out,
                    const std::vector<std::string>& axes) {
  DiagnoseOptions options;
  options.nulls = 40, options.axes = axes;
  try {
    diagnose_logs(options, ErrorModel(), logs, held_out);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}
bool holds(const std::string& text, const std::vector<std::string>& parts) {
  return std::all_of(parts.begin(), parts.end(),
                     [&](const auto& part) { return text.find(part) != std::string::npos; });
}

} // namespace

// Two exports of one record: trimmed, rounded to other digits, about another mean.
static void test_logs_that_share_a_stretch_are_refused(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 1; seed < 4; ++seed) {
    logs.push_back(simulated_log(seed, 1200, false, 0));
    logs.back().path = std::to_string(seed) + ".csv";
  }
  assert_true(refusal({logs[0], logs[1], logs[2]}, {}, {}).empty());
  Log part = logs[0];
  part.path = "part.csv";
  part.t_s.erase(part.t_s.begin(), part.t_s.begin() + 900);
  part.temp_degc.erase(part.temp_degc.begin(), part.temp_degc.begin() + 900);
  std::vector<double>& rates = part.axes[0].rate_dph;
  rates.erase(rates.begin(), rates.begin() + 900);
  for (double& rate : rates) rate = std::round(2 * rate) / 2 + 500;
  for (const bool is_held_out : {false, true}) {
    const std::vector<Log> fitted = is_held_out ? logs : std::vector<Log>{logs[1], part, logs[0]};
    const std::string text = refusal(fitted, is_held_out ? std::vector<Log>{part} : std::vector<Log>{}, {});
    assert_true(holds(text, {"part.csv", "1.csv", "a part of one record", "cut it off"}));
  }
}

// Where the bias rises by more than the noise from row to row, logs rise and fall alike on the same ramps; they are no copies.
static void test_steep_logs_are_no_copies(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 11; seed < 14; ++seed) {
    logs.push_back(simulated_log(seed, 1200, false, 0));
    logs.back().path = std::to_string(seed) + ".csv";
    for (size_t i = 0; i < logs.back().size(); ++i) logs.back().axes[0].rate_dph[i] += 3000 * logs.back().temp_degc[i];
  }
  assert_string_equal(refusal(logs, {}, {}).c_str(), "");
  Log part = logs[0];
  part.path = "part.csv";
  for (std::vector<double>* column : {&part.t_s, &part.temp_degc, &part.axes[0].rate_dph})
    column->erase(column->begin(), column->begin() + 700);
  for (double& rate : part.axes[0].rate_dph) rate = std::round(10 * rate) / 10 - 80;
  assert_true(holds(refusal({logs[1], part, logs[0]}, {}, {}), {"part.csv", "a part of one record"}));
}

// Three logs without an effect; `spoil` changes the temperatures of the first one.
static DiagnoseResult answer_with_spoilt(const std::function<void(Log*)>& spoil, double hysteresis_dph = 0) {
  std::vector<Log> logs;
  for (uint64_t k = 0; k < 3; ++k) {
    logs.push_back(simulated_log(810 + k, 6000, false, hysteresis_dph));
    logs.back().path = std::to_string(k + 1) + ".csv";
    spoil(&logs.back());
  }
  const ErrorModel model = nominal_model();
  return answer(logs, {}, &model);
}
static bool warns(const DiagnoseResult& result, const std::vector<std::string>& parts) {
  return std::any_of(result.warnings.begin(), result.warnings.end(),
                     [&](const std::string& text) { return holds(text, parts); });
}

// What a sensor gives at power-up, disconnected or unread.
static void test_wrong_readings_of_the_thermometer_are_missing(void**) {
  for (const double wrong_degc : {85.0, -127.0, 0.0}) {
    const auto spoil = [&](Log* log) {
      log->temp_degc[0] = log->temp_degc[1] = log->temp_degc[1500] = log->temp_degc[2500] = wrong_degc;
      log->temp_degc[2501] = -0.5 * wrong_degc, log->temp_degc[5999] = wrong_degc;
    };
    const DiagnoseResult result = answer_with_spoilt(spoil);
    assert_true(result.axes.at(0).study.selection.verdict == Verdict::kNoGap);
    assert_true(warns(result, {"2.csv", "wrong readings of the thermometer", "taken as missing"}));
    assert_true(names_of(answer_with_spoilt(spoil, 40).axes.at(0).study.selection) ==
                std::set<std::string>{"thermal_hysteresis"});
  }
  assert_true(answer_with_spoilt([](Log*) {}).warnings.empty());
}

// A thermometer that is read once a minute, in steps of 0.001 or 0.1 degC.
static void test_a_thermometer_that_is_read_seldom_is_no_coarse_one(void**) {
  for (const double step_degc : {0.001, 0.1}) {
    Rng rng(51, 0, 0, Stream::kTool);
    const auto repeat = [&](Log* log) {
      for (double& temp : log->temp_degc) temp += 0.02 * rng.normal();
      for (size_t i = 0; i < log->size(); ++i)
        log->temp_degc[i] =
            i % 60 != 17 && i > 0 ? log->temp_degc[i - 1] : step_degc * std::round(log->temp_degc[i] / step_degc);
    };
    const DiagnoseResult result = answer_with_spoilt(repeat);
    assert_true(result.axes.at(0).study.selection.verdict == Verdict::kNoGap);
    assert_true(warns(result, {"2.csv", "read every 60 s", "straight line"}));
    const RunInput& in = result.axes[0].campaign.runs[0].input;
    for (size_t i = 100; i < 2900; i += 7) assert_near(in.smooth_degc[i], 60 * in.t_s[i] / 3000, 0.1);
    // Between two readings the temperature turns where nobody sees it, so that the member may be open.
    const std::set<std::string> names = names_of(answer_with_spoilt(repeat, 40).axes.at(0).study.selection);
    assert_true(names == std::set<std::string>{"thermal_hysteresis"} ||
                names == std::set<std::string>{"thermal_memory"});
  }
}

// The clock of the thermometer is its own, a reading comes a row late now and then, and its phase may change in the log.
static void test_readings_by_another_clock_are_found(void**) {
  for (const double every : {60.006, 30.01, 120.02, 10.002, 60.5})
    for (const long shift : {0L, 25L}) {
      std::vector<long> ticks;
      std::vector<double> temp_degc;
      Rng rng(53, 0, 0, Stream::kTool);
      double next = 7, reading = 20;
      for (long k = 0; k < 9000; ++k) {
        const double temp = 20 + k / 240.0 + 0.02 * rng.normal();
        if (k == 4000) next += static_cast<double>(shift);
        if (k >= next) reading = 0.01 * std::round(100 * temp), next += every;
        ticks.push_back(k), temp_degc.push_back(reading);
      }
      const RepeatedReadings found = repeated_readings(ticks, temp_degc);
      assert_near(found.every, every, 0.02);
      assert_near(static_cast<double>(found.rows.size()), 9000 / every, 3);
    }
}

// Steps of a converter come at any rows, or, over a ramp of one slope, in as many rows each and all of one size.
static void test_steps_of_a_converter_are_no_repeated_readings(void**) {
  for (const double lsb_degc : {0.0625, 0.5})
    for (const double noise_degc : {0.0, 0.02, 0.2}) {
      std::vector<long> ticks;
      std::vector<double> temp_degc;
      Rng rng(52, 0, 0, Stream::kTool);
      for (long k = 0; k < 6000; ++k) {
        const double temp = k < 3000 ? k / 60.0 : 50 - (k - 3000) / 90.0;
        ticks.push_back(k), temp_degc.push_back(lsb_degc * std::round((temp + noise_degc * rng.normal()) / lsb_degc));
      }
      assert_true(repeated_readings(ticks, temp_degc).every == 0);
      for (long k = 1; k < 6000; ++k) // and beside missing readings
        if (k % 5 != 2) temp_degc[static_cast<size_t>(k)] = std::nan("");
      assert_true(repeated_readings(ticks, temp_degc).every == 0);
    }
}

// The recorder stopped for a while; its time stamps go on as if it had not.
static void test_a_pause_that_the_log_hides_is_one(void**) {
  const auto hide = [](Log* log) {
    for (size_t i = 1200; i + 2000 < log->size(); ++i) {
      log->temp_degc[i] = log->temp_degc[i + 2000];
      log->axes[0].rate_dph[i] = log->axes[0].rate_dph[i + 2000];
    }
    log->t_s.resize(4000), log->temp_degc.resize(4000), log->axes[0].rate_dph.resize(4000);
  };
  const DiagnoseResult result = answer_with_spoilt(hide);
  assert_true(result.axes.at(0).study.selection.verdict == Verdict::kNoGap);
  assert_true(warns(result, {"3.csv", "from 1201 s on", "the recorder had stopped"}));
  const CampaignRun& run = result.axes[0].campaign.runs[0];
  assert_near(run.input.t_s[1200] - run.input.t_s[1199], 3600, 1);
  assert_true(run.input.restarts == std::vector<size_t>{1200});
  for (const size_t i : {0, 1199, 1200, 3999}) assert_near(time_in_log_s(run, run.input.t_s[i]), i + 1, 1e-6);
}

// A slip in one log of three: its rates turned, or its temperatures in degF.
static void test_a_log_with_a_slip_is_left_out(void**) {
  const auto turn = [](Log* log) {
    for (double& rate : log->axes[0].rate_dph) rate = 500 - rate;
  };
  const auto fahrenheit = [](Log* log) {
    for (double& temp : log->temp_degc) temp = 1.8 * temp + 32;
  };
  const std::vector<std::pair<std::function<void(Log*)>, const char*>> slips = {{turn, "of the other sign"},
                                                                                {fahrenheit, "in degF"}};
  for (const auto& [slip, words] : slips)
    for (const double loop_dph : {0.0, 40.0}) {
      const DiagnoseResult result = answer_with_spoilt(
          [n = 0, slip = slip](Log* log) mutable {
            if (n++ == 1) slip(log);
          },
          loop_dph);
      const std::set<std::string> names = names_of(result.axes.at(0).study.selection);
      assert_true(names == (loop_dph > 0 ? std::set<std::string>{"thermal_hysteresis"} : std::set<std::string>{}));
      assert_int_equal(result.axes[0].left_out.size(), 1);
      assert_true(warns(result, {"2.csv", words, "left out"}));
    }
}

// Three soaks, one of them at 70 degC, as if that were 21 in degF: a soak agrees with anything.
static void test_a_warm_soak_is_no_log_in_fahrenheit(void**) {
  std::vector<Log> logs;
  for (const double soak_degc : {20.0, 23.0, 70.0}) {
    logs.push_back(simulated_log(850 + logs.size(), 6000, false, 0));
    for (size_t i = 0; i < logs.back().size(); ++i) {
      double& temp = logs.back().temp_degc[i];
      logs.back().axes[0].rate_dph[i] -= bias_dph(temp);
      temp = soak_degc + 0.5 * std::sin(logs.back().t_s[i] / 300);
      logs.back().axes[0].rate_dph[i] += bias_dph(temp);
    }
  }
  const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
  for (const std::string& why : unlike_others(campaign)) assert_string_equal(why.c_str(), "");
}

// A healthy log beyond the temperatures of the others, over which the bias turns; and one in degF beside a larger loop.
static void test_a_slip_is_told_by_temperatures_in_common(void**) {
  const auto log_of = [](uint64_t seed, double lo_degc, double hi_degc) {
    Log log = simulated_log(seed, 6000, false, 0);
    for (size_t i = 0; i < log.size(); ++i) {
      double& temp = log.temp_degc[i];
      log.axes[0].rate_dph[i] -= bias_dph(temp);
      temp = lo_degc + (hi_degc - lo_degc) * temp / 60;
      log.axes[0].rate_dph[i] += 150 * std::fabs(temp - 30) / 30;
    }
    return log;
  };
  ErrorModel straight;
  straight.bias = ThermalPolynomial{30, 30, {80, 300}};
  const Campaign apart =
      make_campaign({log_of(861, 0, 30), log_of(862, 30, 60), log_of(863, 0, 30)}, "gx_dph", straight);
  for (const std::string& why : unlike_others(apart)) assert_string_equal(why.c_str(), "");
  std::vector<Log> logs = {simulated_log(864, 6000, false, 80), simulated_log(865, 6000, false, 80),
                           simulated_log(866, 6000, false, 80)};
  for (double& temp : logs[1].temp_degc) temp = 1.8 * temp + 32;
  const std::vector<std::string> why = unlike_others(make_campaign(logs, "gx_dph", {}));
  assert_true(why[0].empty() && holds(why[1], {"degF"}) && why[2].empty());
}

// Held out, and beside a single fitted log.
static void test_a_held_out_log_with_a_slip_is_left_out(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 830; seed < 833; ++seed) {
    logs.push_back(simulated_log(seed, 6000, false, 0));
    logs.back().path = std::to_string(seed) + ".csv";
  }
  for (double& rate : logs[1].axes[0].rate_dph) rate = -rate;
  for (double& temp : logs[2].temp_degc) temp = 1.8 * temp + 32;
  const DiagnoseResult result = answer({logs[0]}, {logs[1], logs[2]}, nullptr);
  assert_int_equal(result.axes.at(0).left_out.size(), 2);
  assert_true(warns(result, {"831.csv", "of the other sign"}) && warns(result, {"832.csv", "in degF"}));
  assert_true(result.axes[0].study.selection.verdict == Verdict::kNoGap);
}

// A bias of 280 dph/degC.  The gyro feels what the temperature does, `felt`, and not the noise of the thermometer, `read`.
static std::vector<Log> steep_logs(uint64_t seed, double felt_degc, double read_degc) {
  std::vector<Log> logs;
  for (uint64_t k = 0; k < 3; ++k) {
    logs.push_back(simulated_log(seed + k, 6000, false, 0));
    Rng rng(seed, k, 0, Stream::kTool);
    for (size_t i = 0; i < logs[k].size(); ++i) {
      const double felt = felt_degc * rng.normal();
      logs[k].axes[0].rate_dph[i] += 270 * (logs[k].temp_degc[i] - 30 + felt) + 10 * felt;
      logs[k].temp_degc[i] += felt + read_degc * rng.normal();
    }
  }
  return logs;
}
static void test_noise_of_the_thermometer_is_no_lag(void**) {
  const DiagnoseResult noisy = answer(steep_logs(870, 0, 0.15), {});
  assert_true(noisy.axes.at(0).study.selection.verdict == Verdict::kNoGap);
  assert_true(warns(noisy, {"gx_dph", "noise of the thermometer", "smooth it in the device too"}));
  const std::optional<ThermometerNoise> seen = thermometer_noise(make_campaign(steep_logs(870, 0, 0.15), "gx_dph", {}));
  assert_true(seen.has_value());
  assert_near(seen->rms_degc, 0.15, 0.006);
  assert_near(seen->rms_dph, 280 * 0.15, 3);
  assert_near(seen->felt, 0, 0.05);
  const std::optional<ThermometerNoise> half =
      thermometer_noise(make_campaign(steep_logs(882, 0.05, 0.05), "gx_dph", {}));
  assert_true(half.has_value());
  assert_near(half->felt, 0.5, 0.05);
  assert_true(answer(steep_logs(882, 0.05, 0.05), {}).axes.at(0).study.selection.verdict == Verdict::kNoGap);
  const DiagnoseResult felt = answer(steep_logs(873, 0.05, 0), {});
  assert_true(felt.axes.at(0).study.selection.verdict == Verdict::kNoGap);
  assert_true(!warns(felt, {"noise of the thermometer"}));
  // What cannot be seen in the rates changes nothing.
  assert_true(!thermometer_noise(make_campaign(steep_logs(876, 0, 0.0002), "gx_dph", {})));
}

// Turned by hand: the angle comes and goes.  A bias over temperature does not do that.
static void test_a_device_that_is_turned_is_told(void**) {
  Log log = simulated_log(879, 1200, false, 0);
  log.axes[0].rate_dph[7] = 1e7;
  assert_true(!warns(answer({log}, {}), {"turned"}));
  for (size_t i = 300; i < 360; ++i) log.axes[0].rate_dph[i] += (i < 330 ? 1 : -1) * 10 * 3600;
  assert_true(warns(answer({log}, {}), {"gx_dph", "deg/s within a log", "at rest"}));
}

// Two columns of one channel share all of their noise; nothing is said of the second.
static void test_one_channel_in_two_columns_is_one(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 840; seed < 842; ++seed) {
    logs.push_back(simulated_log(seed, 3000, true, 0));
    logs.back().axes.push_back(logs.back().axes[0]);
    logs.back().axes[1].name = "gy_dph";
  }
  const DiagnoseResult twice = answer(logs, {});
  assert_true(twice.axes.at(0).refused.empty() && twice.axes[0].study.selection.verdict == Verdict::kNoGap);
  assert_true(holds(twice.axes.at(1).refused, {"gy_dph", "of axis gx_dph", "recorded twice"}));
  logs[1].axes[1].rate_dph[5] += 1;
  assert_true(answer(logs, {}).axes.at(1).refused.empty());
}

static void test_a_log_in_kelvin_is_left_out(void**) {
  const DiagnoseResult result = answer_with_spoilt(
      [n = 0](Log* log) mutable {
        for (double& temp : log->temp_degc) temp += n == 1 ? 273.15 : 0;
        ++n;
      },
      40);
  assert_true(names_of(result.axes.at(0).study.selection) == std::set<std::string>{"thermal_hysteresis"});
  assert_int_equal(result.axes[0].left_out.size(), 1);
  assert_true(warns(result, {"2.csv", "not in degC", "left out"}));
}

static void test_a_log_without_temperatures_beside_others_is_refused(void**) {
  std::vector<Log> logs = {simulated_log(1, 1200, false, 0), simulated_log(2, 1200, false, 0)};
  logs[0].path = "without.csv", logs[1].path = "with.csv";
  std::fill(logs[0].temp_degc.begin(), logs[0].temp_degc.end(), std::nan(""));
  assert_true(holds(refusal(logs, {}, {}), {"without.csv: without temperatures, which with.csv has", "--log"}));
}

static void test_what_is_given_twice_is_refused(void**) {
  std::vector<Log> logs;
  for (uint64_t seed = 1; seed < 4; ++seed) {
    logs.push_back(simulated_log(seed, 1200, false, 0));
    logs.back().path = std::to_string(seed) + ".csv";
  }
  Log again = logs[2];
  again.path = "again.csv";
  assert_true(
      holds(refusal({logs[2], logs[0], again}, {}, {}), {"again.csv: the same data as 3.csv", "give every log once"}));
  assert_true(holds(refusal({logs[0], logs[2]}, {logs[1], again}, {}),
                    {"again.csv: held out, but the same data as 3.csv", "take it out of --log or --holdout"}));
  assert_true(holds(refusal({logs[0]}, {logs[2], logs[1], again}, {}),
                    {"again.csv: the same data as 3.csv", "give every log once"}));
  assert_true(
      holds(refusal({logs[0]}, {}, {"gx_dph", "gx_dph"}), {"1.csv", "axis gx_dph", "every axis once with --axis"}));
  assert_true(holds(refusal({}, {logs[0]}, {}), {"--log"}));
  assert_true(refusal({logs[0]}, {logs[1]}, {"gx_dph"}).empty());
}

// The bias jumps after the pause: the model that is written and the answer tell when by the clock of the log.
static void test_times_after_a_pause_are_those_of_the_log(void**) {
  const Log log = paused_log(11, 5000, 200), unseen = paused_log(12, 4000, -300);
  const DiagnoseResult found = answer({log}, {unseen});
  const auto jumps = std::find_if(found.model.effects.begin(), found.model.effects.end(),
                                  [](const EffectSpec& spec) { return spec.name == "bias_step"; });
  assert_true(jumps != found.model.effects.end());
  const std::vector<StepValue> steps = read_parameters(find_effect("bias_step"), jumps->parameters).steps("steps");
  assert_int_equal(steps.size(), 1);
  assert_near(steps[0].t_s, log.t_s[5000], 3);
  const AxisResult& axis = found.axes.at(0);
  assert_int_equal(axis.study.selection.own_jumps.size(), 1);
  assert_near(axis.study.selection.own_jumps[0].t_s, unseen.t_s[4000], 3);
  assert_true(axis.where.time_lo_s > kPauseAt_s + kPause_s || axis.where.time_lo_s == log.t_s.front());
  assert_true(axis.where.time_hi_s > kPauseAt_s + kPause_s && axis.where.time_hi_s <= log.t_s.back());
  // Believed, it is taken out where it happened: nothing is left to be told.
  ErrorModel model = nominal_model();
  model.effects = {
      spec_of(find_effect("bias_step"), {{"steps", std::vector<StepValue>{{0, log.t_s[5000], {200, 0}}}}})};
  assert_true(answer({log}, {}, &model).axes.at(0).study.selection.effects.empty());
}

// A recorder that loses one row in ten: no ten seconds in a row are whole.
static void test_a_row_missing_in_ten_does_not_change_the_smoothed_temperature(void**) {
  Log log = simulated_log(9, 4000, false, 0);
  Rng rng(9, 0, 0, Stream::kWhite);
  for (size_t i = 0; i < log.size(); ++i)
    log.temp_degc[i] += 0.5 * std::sin(2 * kPi * log.t_s[i] / 120) + 0.01 * rng.normal();
  Log less = log;
  less.t_s.clear(), less.temp_degc.clear(), less.axes[0].rate_dph.clear();
  std::vector<size_t> rows;
  for (size_t i = 0; i < log.size(); ++i) {
    if (i % 10 == 4) continue;
    rows.push_back(i);
    less.t_s.push_back(log.t_s[i]), less.temp_degc.push_back(log.temp_degc[i]);
    less.axes[0].rate_dph.push_back(log.axes[0].rate_dph[i]);
  }
  const Campaign whole = make_campaign({log}, "gx_dph", nominal_model()),
                 part = make_campaign({less}, "gx_dph", nominal_model());
  const RunInput &a = whole.runs[0].input, &b = part.runs[0].input;
  for (size_t k = 0; k < rows.size(); ++k) {
    assert_near(b.smooth_degc[k], a.smooth_degc[rows[k]], 0.02);
    assert_near(b.rate_degc_min[k], a.rate_degc_min[rows[k]], 0.1); // the cycle: 1.6 degC/min
  }
}

// Where no means tell how much to smooth, the least is done.
static void test_the_least_is_smoothed_where_nothing_tells_how_much(void**) {
  std::vector<double> y(40, std::nan(""));
  for (size_t t = 0; t < y.size(); t += 3) y[t] = static_cast<double>(t * t);
  const std::vector<double> candidates = {20, 40, 80};
  assert_near(best_tau(y, candidates, 10), 20, 0); // a third of each mean is seen
  assert_near(best_tau({1, 2, 4, 8}, candidates, 10), 20, 0);
}

// What the biases of two axes have in common a model can hold, and no more.
static void test_a_model_of_axes_with_other_biases_is_told(void**) {
  Log log = simulated_log(21, 6000, false, 0), again = simulated_log(22, 6000, false, 0);
  const auto add_axis = [](Log* to, const Log& noise, double x, double square) {
    LogAxis axis = noise.axes[0];
    axis.name = "gy_dph";
    for (size_t i = 0; i < axis.rate_dph.size(); ++i) {
      const double tn = (noise.temp_degc[i] - 30) / 30;
      axis.rate_dph[i] += x + square * tn * tn;
    }
    to->axes.push_back(axis);
  };
  const auto warned = [&](double constant, double square) {
    Log two = log, other = simulated_log(24, 6000, false, 0);
    add_axis(&two, again, constant, square), add_axis(&other, simulated_log(25, 6000, false, 0), constant, square);
    const DiagnoseResult found = answer({two, other}, {});
    const auto is_of_bias = [](const std::string& w) {
      return w.find("polynomial of axis gx_dph") != std::string::npos;
    };
    assert_true(found.model.bias.has_value());
    for (const std::string& w : found.model_warnings) assert_true(is_of_bias(w) && holds(w, {"--axis gy_dph"}));
    return !found.model_warnings.empty();
  };
  assert_true(!warned(0, 0));
  assert_true(warned(0, 150));
  assert_true(warned(300, 0));
}

// Rates in coarse steps: most are as the one before, which is no silence that the noise of a thermometer could spoil.
static void test_noise_of_the_thermometer_counts_beside_the_rounding_of_the_rates(void**) {
  const auto seen = [](double step_dph) {
    std::vector<Log> logs = steep_logs(870, 0, 0.15);
    for (Log& log : logs)
      for (double& rate : log.axes[0].rate_dph) rate = step_dph > 0 ? step_dph * std::round(rate / step_dph) : rate;
    return thermometer_noise(make_campaign(logs, "gx_dph", {}));
  };
  const std::optional<ThermometerNoise> fine = seen(0), coarse = seen(2000);
  assert_true(fine && fine->is_notable());
  assert_true(coarse && coarse->white_dph > 500 && !coarse->is_notable());
}

// Why a row counts or not: every reason once, in rows of the log, held-out logs behind the fitted ones.
static void test_the_record_says_why_rows_are_left_out(void**) {
  Log log = simulated_log(31, 6000, false, 0), unseen = simulated_log(32, 3000, false, 0);
  LogAxis& axis = log.axes[0];
  axis.flags.assign(log.size(), 0);
  axis.rate_dph[10] = std::nan(""), axis.flags[20] = kSaturated;
  axis.rate_dph[3000] = axis.rate_dph[3001] = axis.rate_dph[3002] = 0; // between rates of 500 dph
  axis.rate_dph[2000] = 1e5;
  for (size_t k = 1000; k < 1300; ++k) log.temp_degc[k] = log.temp_degc[1000];
  unseen.axes[0].rate_dph[40] = std::nan("");
  const std::vector<Log> fitted = {log}, held_out = {unseen};
  Campaign campaign = make_campaign(fitted, "gx_dph", nominal_model()),
           other = make_campaign_like(campaign, held_out, nominal_model());
  Record record(fitted, held_out, "gx_dph");
  std::vector<bool> active(effect_library().size(), true);
  record.leave_out(find_structure(&campaign, &other, effect_library(), active), campaign, other);
  std::vector<std::vector<char>> jump(1, std::vector<char>(campaign.runs[0].input.size(), 0));
  jump[0][5000 - 299] = 1; // the row 5000 of the log: 299 of the stuck thermometer are no rows of the run
  mask(&campaign, jump);
  record.leave_out_rest(campaign, other);
  const std::vector<RecordedLog> logs = record.logs();
  assert_int_equal(logs.size(), 2);
  const auto rows_of = [&](size_t i, const char* why) {
    for (const LeftOutRows& rows : logs[i].left_out)
      if (rows.why == why) return rows;
    fail_msg("no row is left out as %s", why);
    return LeftOutRows();
  };
  const auto assert_at = [&](size_t i, const char* why, size_t n, double first_s) {
    const LeftOutRows rows = rows_of(i, why);
    assert_int_equal(rows.n, n), assert_int_equal(rows.rows.t_s.size(), n);
    assert_true(rows.rows.t_s[0] == first_s);
  };
  assert_at(0, kLeftOutNoRate, 1, 11), assert_at(0, kLeftOutFlagged, 1, 21), assert_at(0, kLeftOutHit, 1, 2001);
  assert_at(0, kLeftOutStuck, 299, 1002), assert_at(0, kLeftOutJump, 1, 5001);
  assert_at(1, kLeftOutNoRate, 1, 41);
  assert_true(logs[1].is_held_out && logs[1].log == 0 && logs[1].left_out.size() == 1);
  size_t n_zeros = 0;
  for (const LeftOutRows& rows : logs[0].left_out)
    for (double rate : rows.rows.rate_dph) n_zeros += rate == 0;
  assert_int_equal(n_zeros, 3);
  size_t n_left_out = 0;
  for (const LeftOutRows& rows : logs[0].left_out) n_left_out += rows.n;
  assert_int_equal(logs[0].every, 3); // 9000 rows, 4000 are enough
  assert_int_equal(logs[0].used.t_s.size(), (6000 - n_left_out + 2) / 3);
}

// A log that is left out as a whole is still a record, and says why.
static void test_the_record_keeps_a_log_that_is_left_out(void**) {
  Log dead = simulated_log(33, 3000, false, 0);
  for (double& rate : dead.axes[0].rate_dph) rate = 5;
  const std::vector<Log> logs = {dead, simulated_log(34, 3000, false, 0), simulated_log(35, 3000, false, 0)};
  const DiagnoseResult found = answer(logs, {});
  const std::vector<RecordedLog>& record = found.axes.at(0).record;
  assert_int_equal(record.size(), 3);
  assert_true(record[0].why_left_out.find("one and the same rate") != std::string::npos &&
              record[0].used.rate_dph[7] == 5);
  assert_true(record[1].why_left_out.empty());
}

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_what_is_given_twice_is_refused),
      cmocka_unit_test(test_logs_that_share_a_stretch_are_refused),
      cmocka_unit_test(test_steep_logs_are_no_copies),
      cmocka_unit_test(test_wrong_readings_of_the_thermometer_are_missing),
      cmocka_unit_test(test_a_thermometer_that_is_read_seldom_is_no_coarse_one),
      cmocka_unit_test(test_readings_by_another_clock_are_found),
      cmocka_unit_test(test_steps_of_a_converter_are_no_repeated_readings),
      cmocka_unit_test(test_a_pause_that_the_log_hides_is_one),
      cmocka_unit_test(test_a_log_with_a_slip_is_left_out),
      cmocka_unit_test(test_a_slip_is_told_by_temperatures_in_common),
      cmocka_unit_test(test_a_held_out_log_with_a_slip_is_left_out),
      cmocka_unit_test(test_a_warm_soak_is_no_log_in_fahrenheit),
      cmocka_unit_test(test_noise_of_the_thermometer_is_no_lag),
      cmocka_unit_test(test_a_device_that_is_turned_is_told),
      cmocka_unit_test(test_one_channel_in_two_columns_is_one),
      cmocka_unit_test(test_a_log_in_kelvin_is_left_out),
      cmocka_unit_test(test_a_log_without_temperatures_beside_others_is_refused),
      cmocka_unit_test(test_times_after_a_pause_are_those_of_the_log),
      cmocka_unit_test(test_a_row_missing_in_ten_does_not_change_the_smoothed_temperature),
      cmocka_unit_test(test_the_least_is_smoothed_where_nothing_tells_how_much),
      cmocka_unit_test(test_a_model_of_axes_with_other_biases_is_told),
      cmocka_unit_test(test_noise_of_the_thermometer_counts_beside_the_rounding_of_the_rates),
      cmocka_unit_test(test_the_record_says_why_rows_are_left_out),
      cmocka_unit_test(test_the_record_keeps_a_log_that_is_left_out),
  };
  return cmocka_run_group_tests_name("diagnose: logs", tests, nullptr, nullptr);
}
