// SPDX-License-Identifier: MIT
// base/repeats: readings that stand several rows are told from coarse ones.
#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>

#include <csetjmp>
#include <limits>
#include <vector>

#include "base/repeats.h"
#include "base/rng.h"

extern "C" {
#include <cmocka.h>
}

using namespace imucal;

namespace {

// Healthy kinds, of white noise of one: 0 nothing else, 1 Markov, 2 telegraph, 3 bursts, 4 a ramp, 5 knocks, 6 a level that
// changes, 7 Student's t of 3 degrees.
constexpr int kKinds = 8;

std::vector<double> record_of(int kind, uint64_t run, size_t n) {
  Rng rng(31, run, static_cast<uint32_t>(kind), Stream::kTool);
  const double phi = std::exp(-1 / (run % 3 == 0 ? 3.0 : 100.0));
  double state = 0, level = 0;
  std::vector<double> out;
  for (size_t k = 0; k < n; ++k) {
    const auto t = static_cast<double>(k);
    double value = rng.normal();
    if (kind == 7) {
      const double a = rng.normal(), b = rng.normal(), c = rng.normal();
      value *= 0.6 * std::sqrt(3 / (a * a + b * b + c * c));
    }
    if (kind == 1) value += state = phi * state + 2 * std::sqrt(1 - phi * phi) * rng.normal();
    if (kind == 2) value += level = rng.uniform() < 0.05 ? 10 - level : level;
    if (kind == 3 && k / 50 % 4 == 0) value *= 4;
    if (kind == 4) value += 0.01 * t;
    if (kind == 5 && rng.uniform() < 0.03) value += 20 * rng.normal();
    if (kind == 6) value *= std::exp(2 * std::sin(0.003 * t));
    out.push_back(value);
  }
  return out;
}

std::vector<double> rounded(std::vector<double> values, double quantum, double phase) {
  if (quantum > 0)
    for (double& value : values) value = quantum * std::round(value / quantum + phase);
  return values;
}

std::vector<double> held(std::vector<double> values, size_t rows) {
  for (size_t k = 0; k < values.size(); ++k) values[k] = values[k / rows * rows];
  return values;
}

const size_t kLengths[] = {400, 2000, 8400};

// 8 kinds, 10 quanta up to two standard deviations, 45 records each of 400 to 8400 rows: 3600.  None is over the limit: less than
// 0.08 % with 95 % confidence.
void test_healthy_records_are_not_held(void**) {
  double most = 0;
  for (int kind = 0; kind < kKinds; ++kind)
    for (const double quantum : {0.0, 0.001, 0.1, 0.3, 0.5, 0.7, 1.0, 1.2, 1.4, 2.0})
      for (uint64_t run = 0; run < 45; ++run) {
        const std::vector<double> values =
            rounded(record_of(kind, run, kLengths[run % 3]), quantum, static_cast<double>(run) / 45);
        most = std::max(most, repeated_share(values));
      }
  std::fprintf(stderr, "healthy: largest share %.3f\n", most);
  assert_true(most <= kMostRepeatedShare && most < 0.235); // 0.23, as base/repeats.h says
}

// Two to twenty rows at fine and at moderate quanta; what a reading stands for is told.
void test_held_records_are_told(void**) {
  for (int kind = 0; kind < kKinds; ++kind)
    for (const size_t rows : {2, 3, 5, 10, 20})
      for (uint64_t run = 0; run < 6; ++run) {
        const std::vector<double> values = held(record_of(kind, run, kLengths[1 + run % 2]), rows);
        const double expected = 1 - 1 / static_cast<double>(rows);
        assert_true(std::abs(repeated_share(values) - expected) < 0.1);
        assert_true(std::abs(repeated_share(rounded(values, 0.3, 0.2)) - expected) < 0.2);
        assert_true(repeated_share(rounded(values, 0.3, 0.2)) > kMostRepeatedShare);
        if (rows < 10) assert_true(repeated_share(rounded(values, 0.7, 0.2)) > kMostRepeatedShare);
      }
}

// A ramp without noise, in counts of 18 and means of ten samples: a staircase, not a sensor that is seldom read.
void test_staircase_of_a_ramp_is_not_held(void**) {
  std::vector<double> values;
  for (int k = 0; k < 600; ++k) {
    double sum = 0;
    for (int i = 0; i < 10; ++i) sum += 1.8 * std::round((100 + k + 0.1 * i) / 18);
    values.push_back(sum);
  }
  assert_true(repeated_share(values) == 0);
  // The same where its steps are of one to five counts: it never turns.
  double level = 0;
  for (size_t k = 0; k < values.size(); ++k) {
    if (k % 4 == 0) level += 18 * static_cast<double>(1 + k / 4 % 5);
    values[k] = level;
  }
  assert_true(repeated_share(values) == 0);
}

// Missing rows compare with nothing; a record without 16 changes tells nothing.
void test_gaps_and_short_records(void**) {
  std::vector<double> values = held(record_of(0, 1, 2000), 2);
  for (size_t k = 0; k < values.size(); k += 7) values[k] = std::numeric_limits<double>::quiet_NaN();
  assert_true(repeated_share(values) > kMostRepeatedShare);
  assert_true(repeated_share(std::vector<double>(5000, 1.0)) == 0);
  assert_true(repeated_share({}) == 0 && repeated_share(held(record_of(0, 1, 30), 3)) == 0);
  assert_true(repeated_text(0.5, 1).find("50 %") != std::string::npos);
  assert_true(repeated_text(0.5, 1).find("rows of 2 s") != std::string::npos);
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_healthy_records_are_not_held),
      cmocka_unit_test(test_held_records_are_told),
      cmocka_unit_test(test_staircase_of_a_ramp_is_not_held),
      cmocka_unit_test(test_gaps_and_short_records),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
