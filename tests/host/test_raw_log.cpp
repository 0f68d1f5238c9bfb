// SPDX-License-Identifier: MIT
// Raw logs: decimated by the core's own summation; errors name file and what is wrong.
#include <unistd.h>

#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <string>

#include "base/error.h"
#include "io/log.h"

extern "C" {
#include <cmocka.h>
}

using namespace imucal;

namespace {

const char* const kHead = "# rate_hz = 10\n# gx_counts_scale_dph = 18\n# ax_counts_scale_mg = 0.5\n";

std::string write(const std::string& text) {
  const std::string path = "/tmp/imucal_raw_" + std::to_string(getpid()) + ".csv";
  std::ofstream(path) << text;
  return path;
}

Log read(const std::string& text) {
  const std::string path = write(text);
  const Log log = read_log(path);
  unlink(path.c_str());
  return log;
}

std::string message_of(const std::string& text) {
  const std::string path = write(text);
  std::string message;
  try {
    read_log(path);
  } catch (const Error& error) {
    message = error.what();
  }
  unlink(path.c_str());
  return message;
}

bool says(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// Two seconds of 10 Hz: counts k and -2k, temperature 20 + k/100; a flag, a lost sample.
std::string samples(int lost = -1, int saturated = -1) {
  std::string text = std::string(kHead) + "t_s,temp_degc,gx_counts,gx_flags,ax_counts\n";
  for (int k = 0; k < 20; ++k) {
    if (k == lost) continue;
    text += std::to_string(0.1 * k + 0.05) + "," + std::to_string(20 + k / 100.0) + "," + std::to_string(k) + "," +
            (k == saturated ? "1" : "0") + "," + std::to_string(-2 * k) + "\n";
  }
  return text;
}

void test_raw_samples_become_means_in_units(void**) {
  const Log log = read(samples());
  assert_int_equal(log.size(), 2);
  assert_true(log.t_s[0] == 1 && log.t_s[1] == 2);
  assert_string_equal(log.axes[0].name.c_str(), "gx_dph");
  assert_string_equal(log.axes[1].name.c_str(), "ax_mg");
  assert_true(log.axes[0].is_gyro && !log.axes[1].is_gyro);
  assert_true(log.axes[0].rate_dph[0] == 4.5 * 18 && log.axes[0].rate_dph[1] == 14.5 * 18);
  assert_true(log.axes[1].rate_dph[0] == -9 * 0.5 && log.axes[1].rate_dph[1] == -29 * 0.5);
  assert_true(std::abs(log.temp_degc[0] - 20.045) < 1e-5);
  assert_int_equal(log.axes[0].flags[0] | log.axes[0].flags[1] | log.axes[1].flags[0], 0);
}

void test_raw_flags_and_lost_samples_reach_their_second(void**) {
  const Log log = read(samples(13, 3));
  assert_int_equal(log.axes[0].flags[0], kSaturated);
  assert_int_equal(log.axes[1].flags[0], 0);
  assert_int_equal(log.axes[0].flags[1], kSamplesMissing);
  assert_true(std::abs(log.axes[0].rate_dph[1] - 18 * (145 - 13) / 9.0) < 1e-3);
}

void test_raw_half_empty_second_has_no_rate(void**) {
  std::string text = std::string(kHead) + "t_s,temp_degc,gx_counts,ax_counts\n";
  for (int k = 0; k < 4; ++k) text += std::to_string(0.1 * k) + ",20,1,1\n";
  text += "1.0,20,,1\n1.1,20,1,1\n";
  const Log log = read(text);
  assert_true(std::isnan(log.axes[0].rate_dph[0]) && std::isnan(log.axes[0].rate_dph[1]));
}

// A thermometer is read less often than a gyro: its last reading holds, for a second (as sample.h has it).
void test_raw_temperature_holds_for_a_second(void**) {
  std::string text = std::string(kHead) + "t_s,temp_degc,gx_counts,ax_counts\n";
  for (int k = 0; k < 40; ++k)
    text +=
        std::to_string(0.1 * k) + "," + (k == 0 || k == 5 || k == 12 ? std::to_string(20 + k / 100.0) : "") + ",1,1\n";
  const Log log = read(text);
  assert_true(std::abs(log.temp_degc[0] - (5 * 20 + 5 * 20.05) / 10) < 1e-5);
  assert_true(std::abs(log.temp_degc[1] - (2 * 20.05 + 8 * 20.12) / 10) < 1e-5);
  assert_true(std::isnan(log.temp_degc[2]) && std::isnan(log.temp_degc[3])); // from 2.2 s on it is older
}

void test_raw_scan_gives_the_same_rows(void**) {
  const std::string path = write(samples(13, 3));
  const Log log = read_log(path);
  size_t row = 0;
  scan_log(
      path, [&](const Log& header) { assert_int_equal(header.axes.size(), 2); },
      [&](const LogRow& r) {
        assert_true(r.t_s == log.t_s[row] && r.temp_degc == log.temp_degc[row]);
        for (size_t a = 0; a < 2; ++a) {
          assert_true(r.rate_dph[a] == log.axes[a].rate_dph[row]);
          assert_int_equal(r.flags[a], log.axes[a].flags[row]);
        }
        ++row;
      });
  assert_int_equal(row, 2);
  unlink(path.c_str());
}

void test_raw_bad_input_names_what_is_wrong(void**) {
  const std::string row = "0.0,20,1\n";
  assert_true(says(message_of("# gx_counts_scale_dph = 18\nt_s,temp_degc,gx_counts\n" + row), "rate_hz"));
  assert_true(says(message_of("# rate_hz = ten\n# gx_counts_scale_dph = 18\nt_s,temp_degc,gx_counts\n" + row), "ten"));
  assert_true(says(message_of("# rate_hz = 10\nt_s,temp_degc,gx_counts\n" + row), "gx_counts_scale_dph"));
  assert_true(says(message_of("# rate_hz = 10\n# gx_counts_scale_dph = -1\nt_s,temp_degc,gx_counts\n" + row), "-1"));
  assert_true(
      says(message_of(std::string(kHead) + "t_s,temp_degc,gx_counts,gy_dph\n0,20,1,1\n"), "raw counts and rates"));
  assert_true(says(message_of(std::string(kHead) + "t_s,temp_degc,gx_counts\n0.0,20,1.5\n"), "whole numbers"));
  assert_true(says(message_of(std::string(kHead) + "t_s,temp_degc,gx_counts\n0.0,20,3000000000\n"), "whole numbers"));
  assert_true(says(message_of(std::string(kHead) + "t_s,temp_degc,gx_counts\n-1,20,3\n"), "time"));
  assert_true(says(message_of(std::string(kHead) + "t_s,temp_degc,gx_counts\n0,20,\n"), "no whole sample"));
  assert_true(says(message_of(std::string(kHead) + "t_s,temp_degc,gx_counts\n0,20,abc\n"), ":5:"));
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_raw_samples_become_means_in_units),
      cmocka_unit_test(test_raw_flags_and_lost_samples_reach_their_second),
      cmocka_unit_test(test_raw_half_empty_second_has_no_rate),
      cmocka_unit_test(test_raw_temperature_holds_for_a_second),
      cmocka_unit_test(test_raw_scan_gives_the_same_rows),
      cmocka_unit_test(test_raw_bad_input_names_what_is_wrong),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
