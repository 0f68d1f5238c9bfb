// SPDX-License-Identifier: MIT
// Where a gap lies: over which noise, at which averaging times, temperatures, times and in which logs; and how seldom a place
// is named where there is none.
#include <algorithm>
#include <cstdio>
#include <cstring>

#include "analysis/diagnose/evidence/place.h"
#include "diagnose_logs.h"

// Places that are named beside averaging times.
static size_t places_in(const WhereResult& where, size_t n_logs) {
  const bool has_temperatures = where.sentence.find("between") != std::string::npos;
  return has_temperatures + (where.sentence.find("from ") != std::string::npos) + (where.direction != "any") +
         (where.logs.size() < n_logs);
}

static void test_a_place_holds_most_and_the_rest_clearly_less(void**) {
  assert_true(is_place({10, 8}, {100, 10}));
  assert_false(is_place({10, 7.9}, {100, 10})); // less than most
  assert_false(is_place({60, 8}, {100, 10}));   // the rest is not clearly lower
  assert_true(is_place({60, 9}, {100, 10}));
  assert_false(is_place({100, 10}, {100, 10})); // there is no rest
  assert_false(is_place({10, 0}, {100, 0}));
  // The shortest span, and the fewest pieces.
  const std::vector<Piece> pieces = {{10, 0}, {10, 1}, {10, 5}, {10, 4}, {10, 0}, {10, 0}};
  const PieceSpan span = span_of_cause(pieces);
  assert_true(span.is_any());
  assert_int_equal(span.first, 2), assert_int_equal(span.last, 3);
  assert_false(span_of_cause({{10, 5}, {10, 5}, {10, 4}}).is_any());
  assert_true(pieces_of_cause({{10, 5}, {10, 0.1}, {10, 5}, {10, 5}}) == std::vector<size_t>({0, 2, 3}));
  assert_true(pieces_of_cause({{10, 4}, {10, 3.5}, {10, 1.5}, {10, 1}}).empty());
  assert_true(pieces_of_cause({}).empty() && !span_of_cause({}).is_any());
}

// Of healthy devices, whose noise is as it is believed, at most one in a hundred has an averaging time named, and few a place.
// So seldom, too, are places told of a cause that has none: where one is named, `locate` is asked in the same way.
static void test_a_right_model_is_seldom_said_to_be_off_somewhere(void**) {
  const size_t n_devices = std::getenv("LONG") ? 2000 : 300;
  size_t with_times = 0, with_place = 0;
  for (size_t d = 0; d < n_devices; ++d) {
    std::vector<Log> logs;
    for (uint64_t r = 0; r < 3; ++r) logs.push_back(simulated_log(5000 + 3 * d + r, 2500, false, 0));
    const Campaign campaign = make_campaign(logs, "gx_dph", nominal_model());
    const WhereResult where = locate(campaign, fit_hypothesis(campaign, nominal_hypothesis()), WhoseNoise::kModel);
    with_times += where.sentence.find("averaging times of") != std::string::npos;
    with_place += places_in(where, 3) > 0;
  }
  std::printf("of %zu healthy devices %zu have an averaging time named, %zu a place\n", n_devices, with_times,
              with_place);
  // One in a hundred and two: more by chance in one of 1000.
  assert_true(static_cast<double>(with_times) <
              0.01 * static_cast<double>(n_devices) + 3.1 * std::sqrt(0.01 * static_cast<double>(n_devices)));
  assert_true(static_cast<double>(with_place) <
              0.02 * static_cast<double>(n_devices) + 3.1 * std::sqrt(0.02 * static_cast<double>(n_devices)));
}

// Logs of a device with f(log, t [s], temperature) in its rates, and the answer.
static AxisResult answer_of(const std::function<double(size_t, double, double)>& f, uint64_t seed, bool is_believed) {
  std::vector<Log> logs;
  for (size_t r = 0; r < 4; ++r) {
    Log log = simulated_log(seed + r, 6000, false, 0);
    for (size_t i = 0; i < log.size(); ++i) log.axes[0].rate_dph[i] += f(r, log.t_s[i], log.temp_degc[i]);
    logs.push_back(log);
  }
  DiagnoseOptions options;
  options.nulls = 40;
  if (is_believed) options.model_path = "given";
  DiagnoseResult found = diagnose_logs(options, is_believed ? nominal_model() : ErrorModel(), logs, {});
  return std::move(found.axes.at(0));
}

// A jump in one log is told as that log at its time, and at no temperature; two of them from the one to the other.
static void test_a_jump_is_in_its_log_at_its_time(void**) {
  for (const bool is_believed : {true, false}) {
    const auto jump = [](size_t r, double t_s, double) { return r == 1 && t_s > 4000 ? 150.0 : 0.0; };
    const WhereResult one = answer_of(jump, 41, is_believed).where;
    assert_true(one.logs == std::vector<int>({1}));
    assert_near(one.time_lo_s, 4000, 3);
    assert_near(one.time_hi_s, one.time_lo_s, 1e-9);
    assert_true(one.temp_lo_degc < 0.5 && one.temp_hi_degc > 59.5);
    assert_non_null(std::strstr(one.sentence.c_str(), ", at 400"));
    assert_non_null(std::strstr(one.sentence.c_str(), "in log 2"));
    assert_null(std::strstr(one.sentence.c_str(), "degC"));
  }
}

// A bump at a temperature is told about there, in all logs.
static void test_a_bump_is_at_its_temperature(void**) {
  for (const uint64_t seed : {51u, 61u, 71u}) {
    const auto bump = [](size_t, double, double degc) { return 120 * std::exp(-0.5 * std::pow((degc - 42) / 3, 2)); };
    const AxisResult axis = answer_of(bump, seed, seed != 61);
    const WhereResult& where = axis.where;
    assert_true(where.temp_lo_degc > 30 && where.temp_lo_degc < 42 && where.temp_hi_degc > 42 &&
                where.temp_hi_degc < 54);
    assert_int_equal(where.logs.size(), 4);
    double share = 0;
    for (const WhereCell& cell : where.by_temperature) share += cell.share;
    assert_near(share, 1, 1e-9);
  }
}

// Without a model a loop shows over the noise that was found beside it, at the times of a ramp; over a noise that was estimated
// with the loop in it, it showed nowhere, or at one second.
static void test_a_loop_shows_at_slow_times_without_a_model(void**) {
  for (const uint64_t seed : {81u, 91u, 101u}) {
    std::vector<Log> logs;
    for (uint64_t r = 0; r < 4; ++r) logs.push_back(simulated_log(seed + r, 6000, false, 40));
    DiagnoseOptions options;
    options.nulls = 40;
    const AxisResult axis = std::move(diagnose_logs(options, ErrorModel(), logs, {}).axes.at(0));
    assert_non_null(std::strstr(axis.where.sentence.c_str(), "averaging times of"));
    assert_non_null(std::strstr(axis.where.sentence.c_str(), "the noise that was found"));
    assert_true(axis.where.tau_lo_s >= 128 && axis.where.tau_hi_s >= 1024);
    assert_int_equal(places_in(axis.where, 4), 0);
  }
}

// Where no averaging time is named, tau_s is all there are; temperatures are never beyond the readings.
static void test_what_is_not_named_is_all_there_is(void**) {
  const Campaign campaign = make_campaign({simulated_log(7, 2500, false, 0)}, "gx_dph", nominal_model());
  const Fit fit = fit_hypothesis(campaign, nominal_hypothesis());
  NamedCause nothing;
  nothing.has_times = false;
  Fit loud = fit;
  loud.e[0] *= 2;
  for (const WhereResult& where :
       {locate(campaign, fit, WhoseNoise::kModel), locate(campaign, loud, WhoseNoise::kEstimated, nothing)}) {
    assert_true(where.sentence.find("no averaging time") == 0);
    assert_near(where.tau_lo_s, 1, 1e-9);
    assert_near(where.tau_hi_s, where.by_tau.back().hi, 1e-9);
    const std::vector<double>& read = campaign.runs[0].input.temp_degc;
    assert_true(where.temp_lo_degc >= *std::min_element(read.begin(), read.end()));
    assert_true(where.temp_hi_degc <= *std::max_element(read.begin(), read.end()));
    assert_near(where.temp_hi_degc, 0.1 * std::round(10 * where.temp_hi_degc), 1e-9);
  }
  // Averaging times that are named are not told twice.
  const WhereResult one = locate(campaign, loud, WhoseNoise::kModel);
  assert_true(one.sentence.find("averaging times of") != std::string::npos);
}

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_a_place_holds_most_and_the_rest_clearly_less),
      cmocka_unit_test(test_a_right_model_is_seldom_said_to_be_off_somewhere),
      cmocka_unit_test(test_a_jump_is_in_its_log_at_its_time),
      cmocka_unit_test(test_a_bump_is_at_its_temperature),
      cmocka_unit_test(test_a_loop_shows_at_slow_times_without_a_model),
      cmocka_unit_test(test_what_is_not_named_is_all_there_is),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
