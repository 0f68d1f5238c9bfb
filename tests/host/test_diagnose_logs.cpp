// SPDX-License-Identifier: MIT
// Logs as they come: given twice.
#include "base/error.h"
#include "diagnose_logs.h"

namespace {

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

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_what_is_given_twice_is_refused),
  };
  return cmocka_run_group_tests_name("diagnose: logs", tests, nullptr, nullptr);
}
