// SPDX-License-Identifier: MIT
// Logs as they come: given twice, with a pause of hours, with rows missing; and the model that is written of them.
#include "analysis/diagnose/logs/smoothing.h"
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

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_what_is_given_twice_is_refused),
      cmocka_unit_test(test_times_after_a_pause_are_those_of_the_log),
      cmocka_unit_test(test_a_row_missing_in_ten_does_not_change_the_smoothed_temperature),
      cmocka_unit_test(test_the_least_is_smoothed_where_nothing_tells_how_much),
      cmocka_unit_test(test_a_model_of_axes_with_other_biases_is_told),
  };
  return cmocka_run_group_tests_name("diagnose: logs", tests, nullptr, nullptr);
}
