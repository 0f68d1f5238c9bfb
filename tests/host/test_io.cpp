// SPDX-License-Identifier: MIT
// Files: logs, models, profiles, JSON.  What is written reads back; what is malformed is refused by line or field.
#include <unistd.h>

#include <cfloat>
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <vector>
extern "C" {
#include <cmocka.h>
}

#include "base/error.h"
#include "base/suggest.h"
#include "base/units.h"
#include "io/input.h"
#include "io/json_file.h"
#include "io/kept_numbers.h"
#include "io/log.h"
#include "io/model.h"
#include "io/notice.h"
#include "io/number.h"
#include "io/output.h"
#include "io/profile.h"

using namespace imucal;

static std::string scratch(const std::string& name) {
  return "/tmp/imucal_test_io_" + std::to_string(getpid()) + "_" + name;
}

static std::string file_with(const std::string& name, const std::string& text) {
  const std::string path = scratch(name);
  std::ofstream(path) << text;
  return path;
}

// The message of the data error that `action` throws; fails the test when it throws none.
template <typename Action> static std::string refusal(Action action) {
  try {
    action();
  } catch (const Error& error) {
    assert_int_equal(static_cast<int>(error.exit()), static_cast<int>(Exit::kData));
    return error.what();
  }
  fail_msg("accepted what it should refuse");
  return "";
}

static void assert_says(const std::string& message, const std::string& part) {
  if (message.find(part) == std::string::npos) fail_msg("\"%s\" does not say \"%s\"", message.c_str(), part.c_str());
}

static std::string log_refusal(const std::string& text) {
  const std::string path = file_with("bad.csv", text);
  const std::string message = refusal([&] { read_log(path); });
  std::remove(path.c_str());
  assert_says(message, path);
  return message;
}

static void test_log_written_reads_back(void**) {
  Log log;
  log.metadata["device"] = "unit 7";
  log.t_s = {0, 1, 3};
  log.temp_degc = {24.81, std::nan(""), -3.125};
  LogAxis gyro;
  gyro.name = "gx_dps";
  gyro.to_internal = kDphPerDps;
  gyro.rate_dph = {401.25, std::nan(""), -0.000125};
  gyro.flags = {0, 2, 1};
  log.axes.push_back(gyro);
  log.auxiliary["supply_v"] = {3.3, 3.25, 3.0};
  const std::string path = scratch("roundtrip.csv");
  write_log(path, log);

  const Log back = read_log(path);
  std::remove(path.c_str());
  assert_string_equal(back.metadata.at("device").c_str(), "unit 7");
  assert_int_equal(back.size(), 3);
  assert_true(back.t_s == log.t_s);
  assert_true(std::isnan(back.temp_degc[1]));
  assert_true(back.temp_degc[2] == -3.125);
  for (size_t k : {size_t{0}, size_t{2}}) assert_true(std::abs(back.axes[0].rate_dph[k] - gyro.rate_dph[k]) < 2e-6);
  assert_true(std::isnan(back.axes[0].rate_dph[1]));
  assert_true(back.axes[0].flags == gyro.flags);
  assert_true(back.auxiliary.at("supply_v")[1] == 3.25);
}

static void test_log_units_become_dph_and_mg(void**) {
  const std::string path = file_with("units.csv", "t_s,temp_degc,gx_dps,gy_radps,ax_ms2\n0,20,1,1,9.80665\n");
  const Log log = read_log(path);
  std::remove(path.c_str());
  assert_true(std::abs(log.axis("gx_dps").rate_dph[0] - 3600.0) < 1e-9);
  assert_true(std::abs(log.axis("gy_radps").rate_dph[0] - 206264.806247096) < 1e-6);
  assert_true(std::abs(log.axis("ax_ms2").rate_dph[0] - 1000.0) < 1e-9);
  assert_false(log.axis("ax_ms2").is_gyro);
}

static void test_log_axes_are_named_in_the_units_inside(void**) {
  const std::string text = "t_s,temp_degc,gx_dps,gy_radps,ax_ms2,gx_flags\n0,20,1,1,9.80665,2\n";
  const std::string path = file_with("inside.csv", text), copy = scratch("inside_copy.csv");
  const Log log = read_log(path);
  write_log(copy, log);
  const Log back = read_log(copy);
  std::remove(path.c_str()), std::remove(copy.c_str());
  for (const Log& l : {log, back}) {
    assert_string_equal(l.axes[0].name.c_str(), "gx_dph");
    assert_string_equal(l.axes[1].name.c_str(), "gy_dph");
    assert_string_equal(l.axes[2].name.c_str(), "ax_mg");
    assert_true(&l.axis("gx_dps") == &l.axes[0] && &l.axis("gx_radps") == &l.axes[0] &&
                &l.axis("ax_ms2") == &l.axes[2]);
    assert_true(std::abs(l.axes[0].rate_dph[0] - 3600.0) < 1e-6);
    assert_true(std::abs(l.axes[2].rate_dph[0] - 1000.0) < 1e-6);
    assert_int_equal(l.axes[0].flags[0], 2);
    assert_says(refusal([&] { l.axis("ax_dph"); }), "there are: gx_dph, gy_dph, ax_mg");
  }
}

static void test_log_two_columns_of_one_axis_keep_their_names(void**) {
  const std::string path = file_with("both.csv", "t_s,temp_degc,gx_dps,gx_dph\n0,20,1,7\n"),
                    copy = scratch("both_copy.csv");
  const Log log = read_log(path);
  write_log(copy, log);
  const Log back = read_log(copy);
  std::remove(path.c_str()), std::remove(copy.c_str());
  for (const Log& l : {log, back}) {
    assert_true(std::abs(l.axis("gx_dps").rate_dph[0] - 3600.0) < 1e-6);
    assert_true(std::abs(l.axis("gx_dph").rate_dph[0] - 7.0) < 1e-9);
  }
}

// Flags are of the axis of their whole name, wherever they stand.
static void test_log_flags_are_of_the_axis_of_their_name(void**) {
  const std::string path =
      file_with("flags.csv", "t_s,temp_degc,gx_flags,gx_dps,gx_raw_dph,g_dph,gx_raw_flags\n1,20,1,1,2,3,4\n");
  const Log log = read_log(path);
  std::remove(path.c_str());
  assert_true(log.axis("gx_dph").flags == std::vector<int>{1} && log.axis("gx_raw_dph").flags == std::vector<int>{4});
  assert_true(log.axis("g_dph").flags.empty());
  assert_says(log_refusal("t_s,temp_degc,gx_dph,g_flags\n1,20,1,1\n"), "belongs to no axis");
  assert_says(log_refusal("t_s,temp_degc,x_dph,x_mg,x_flags\n1,20,1,1,1\n"),
              "\"x_flags\" belongs to x_dph and to x_mg");
}

// However large: 1e-6 dph, and a microsecond of a clock that counts from 1970.
static void test_log_written_keeps_the_digits_it_promises(void**) {
  Log log;
  log.t_s = {1767225600.25, 1767225601.25};
  log.temp_degc = {20, 21};
  log.axes.push_back({"gx_dph", 1.0, true, {1234567.654321, -98765.432109}, {}});
  const std::string path = scratch("digits.csv");
  write_log(path, log);
  const Log back = read_log(path);
  std::remove(path.c_str());
  for (size_t k = 0; k < 2; ++k) {
    assert_true(std::abs(back.axes[0].rate_dph[k] - log.axes[0].rate_dph[k]) < 1e-6);
    assert_true(std::abs(back.t_s[k] - log.t_s[k]) < 1e-6);
  }
}

static void test_log_metadata_several_on_a_line(void**) {
  const std::string path = file_with(
      "meta.csv", "# imucal-log = 1\n# device = ADIS16405  serial = 17  run = up-2\nt_s,temp_degc,gx_dph\n0,,1\n");
  const Log log = read_log(path);
  std::remove(path.c_str());
  assert_string_equal(log.metadata.at("device").c_str(), "ADIS16405");
  assert_string_equal(log.metadata.at("serial").c_str(), "17");
  assert_string_equal(log.metadata.at("run").c_str(), "up-2");
  assert_false(log.has_temperature());
}

static void test_log_malformed_names_the_line(void**) {
  const std::string header = "t_s,temp_degc,gx_dph\n";
  assert_says(log_refusal(""), "no header");
  assert_says(log_refusal(header), "no whole row");
  assert_says(log_refusal(header + "0,20,1\n1,20,abc\n"), ":3: column gx_dph: expected a number");
  assert_says(log_refusal(header + "0,20,nan\n"), ":2: column gx_dph: is not a finite number");
  assert_says(log_refusal(header + "0,inf,1\n"), ":2: column temp_degc");
  assert_says(log_refusal(header + "0,20\n"), ":2: expected 3 fields, found 2");
  assert_says(log_refusal(header + "0,20,1,5\n"), ":2: expected 3 fields, found 4");
  assert_says(log_refusal(header + "1,20,1\n1,20,1\n"), ":3: t_s does not increase");
  assert_says(log_refusal(header + ",20,1\n"), ":2: t_s is empty");
  assert_says(log_refusal("time,temp,gx\n0,1,2\n"), ":1: the header must be");
  assert_says(log_refusal("t_s,temp_degc,volts\n0,1,2\n"), "no axis column");
  assert_says(log_refusal("t_s,temp_degc,gx_dph,gx_dph\n0,1,2,3\n"), "given twice");
  assert_says(log_refusal("# imucal-log = 9\n" + header + "0,1,2\n"), "version 9");
  assert_says(refusal([] { read_log("/nonexistent/log.csv"); }), "cannot open");
}

static void test_log_unknown_axis_lists_those_there_are(void**) {
  const std::string path = file_with("axes.csv", "t_s,temp_degc,gx_dph,gy_dph\n0,20,1,2\n");
  const Log log = read_log(path);
  std::remove(path.c_str());
  assert_says(refusal([&] { log.axis("gz_dph"); }), "there are: gx_dph, gy_dph");
}

static void test_log_scan_gives_what_read_gives(void**) {
  const std::string path = file_with("scan.csv", "t_s,temp_degc,gx_dps,gy_dph\n0,20,1,2\n1,,,-3\n5,21,0.5,4\n");
  const Log log = read_log(path);
  size_t k = 0;
  scan_log(
      path, [&](const Log& header) { assert_int_equal(header.axes.size(), 2); },
      [&](const LogRow& row) {
        assert_true(row.t_s == log.t_s[k]);
        for (size_t a = 0; a < 2; ++a)
          assert_true(row.rate_dph[a] == log.axes[a].rate_dph[k] ||
                      (std::isnan(row.rate_dph[a]) && std::isnan(log.axes[a].rate_dph[k])));
        ++k;
      });
  std::remove(path.c_str());
  assert_int_equal(k, 3);
}

// Text and numbers made of a counter; strtod is the reference, bit for bit.
static std::string number_text(uint64_t k) {
  const uint64_t mixed = k * 0x9E3779B97F4A7C15ULL;
  const int n_whole = static_cast<int>(mixed % 9), n_part = static_cast<int>(mixed / 16 % 9);
  std::string digits = std::to_string(mixed >> 8) + "0000000000000000";
  return (mixed & 1ULL << 60 ? "-" : "") + digits.substr(0, static_cast<size_t>(n_whole)) + (n_part > 0 ? "." : "") +
         digits.substr(3, static_cast<size_t>(n_part));
}

static void test_plain_number_has_the_bits_of_strtod(void**) {
  int n_plain = 0;
  for (uint64_t k = 0; k < 200000; ++k) {
    const std::string text = number_text(k);
    const std::string line = text + ",7\n" + std::string(kNumberPadding, '9');
    Field field{};
    assert_true(FieldEnds(',').find(line.c_str(), &field));
    assert_int_equal(field.end - line.c_str(), text.size());
    assert_int_equal(field.point - line.c_str(), std::min(text.find('.'), text.size()));
    double value = 0;
    if (!plain_number(field, &value)) continue;
    ++n_plain;
    const double expected = std::strtod(text.c_str(), nullptr);
    if (text.empty() ? !std::isnan(value) : std::memcmp(&value, &expected, sizeof value) != 0)
      fail_msg("\"%s\" is read as %.17g", text.c_str(), value);
  }
  assert_in_range(n_plain, FLT_EVAL_METHOD == 0 ? 120000 : 0, 199999);
}

static void test_plain_number_leaves_the_rest(void**) {
  for (const char* text : {"-",    "+1",  " 1",  ".",   "-.", "nan", "12345678", "1.12345678", "x",    "1.2.3", "1-2",
                           "1.-2", "--1", ".-1", "1e5", "1 ", "1:",  "1/",       "1\r",        "\xb1", "1.\xb1"}) {
    const std::string line = text + std::string("\n") + std::string(kNumberPadding, '9');
    Field field{};
    assert_true(FieldEnds(',').find(line.c_str(), &field));
    double value = 0;
    if (plain_number(field, &value)) fail_msg("\"%s\" taken for a plain number", text);
  }
}

static void test_field_ends_are_found_in_lines_of_any_length(void**) {
  std::string text;
  std::vector<size_t> ends, points;
  for (size_t k = 0; k < 3000; ++k) {
    const size_t n_whole = k * 7 % 31, n_part = k % 5 == 0 ? 0 : k * 11 % 32;
    text.append(n_whole, '1');
    points.push_back(text.size());
    if (n_part > 0) text.append(".").append(n_part - 1, '2');
    ends.push_back(text.size());
    text.push_back(k % 6 == 5 ? '\n' : ';');
  }
  text.append(kNumberPadding, '.');
  FieldEnds fields(';');
  const char* at = text.c_str();
  for (size_t k = 0; k < ends.size(); ++k) {
    Field field{};
    assert_true(fields.find(at, &field));
    assert_ptr_equal(field.begin, at);
    assert_int_equal(field.end - text.c_str(), ends[k]);
    assert_int_equal(field.point - text.c_str(), points[k]);
    at = field.end + 1;
  }
  Field field{};
  assert_false(fields.find(at, &field)); // 64 characters and no end
}

// With and without instructions for 16 bytes at once.
static void test_bytes_are_found_where_they_stand(void**) {
  uint64_t state = 1;
  char text[16];
  for (int k = 0; k < 200000; ++k) {
    for (char& c : text) state = state * 6364136223846793005ULL + 1, c = static_cast<char>(state >> (k % 2 ? 56 : 62));
    const char a = text[k % 16], b = static_cast<char>(k);
    uint32_t expected = 0;
    for (unsigned i = 0; i < 16; ++i) expected |= static_cast<uint32_t>(text[i] == a || text[i] == b) << i;
    assert_int_equal(where_16(text, a, b), expected);
    assert_int_equal(where_8(text, a, b) | where_8(text + 8, a, b) << 8, expected);
  }
}

// Rows of every kind of number, over several fillings of the reader's buffer.
static void test_log_any_spelling_is_read_alike(void**) {
  const char* const spellings[] = {"-1.5",  "-1.50000000000", " -1.5 ", "-15e-1",
                                   "-1.5 ", "-0.15E1",        "-1.5",   "-00000001.5"};
  std::string text = "t_s,temp_degc,gx_dph\n";
  const int n = 60000;
  for (int k = 0; k < n; ++k)
    text += (k % 3 == 1 ? "+" : "") + std::to_string(k) + ",20.25," + spellings[k % 8] + (k % 5 == 0 ? "\r\n" : "\n") +
            (k % 1000 == 7 ? "# a comment\n\n" : "");
  const std::string path = file_with("spellings.csv", text);
  const Log log = read_log(path);
  std::remove(path.c_str());
  assert_int_equal(log.size(), n);
  for (int k = 0; k < n; ++k) {
    const auto i = static_cast<size_t>(k);
    assert_true(log.t_s[i] == k && log.temp_degc[i] == 20.25 && log.axes[0].rate_dph[i] == -1.5);
    assert_int_equal(log.line[i], k + 2 + 2 * ((k + 992) / 1000));
  }
}

static void test_log_error_beyond_a_buffer_names_its_line(void**) {
  std::string text = "t_s,temp_degc,gx_dph\n";
  const int n = 200000; // of some megabytes
  for (int k = 0; k < n; ++k) text += std::to_string(k) + ",20,1.25\n";
  assert_says(log_refusal(text + "200000,20,1.2x\n"), ":200002: column gx_dph: expected a number, found \"1.2x\"");
  assert_says(log_refusal(text + "200000,20,1e999\n"), ":200002: column gx_dph: expected a number");
  assert_says(log_refusal(text + "200000,20\n"), ":200002: expected 3 fields, found 2");
  const std::string wide(700000, '7'); // longer than the buffer
  assert_says(log_refusal(text + "200000,20," + wide + "\n"), ":200002: column gx_dph: expected a number, found \"777");
}

static void test_log_value_too_large_is_refused_however_it_is_written(void**) {
  const std::string text = "t_s,temp_degc,gx_dph,gx_flags\n1,20,1.25,0\n";
  for (const char* value : {"2e12", "-2000000000000", " 2e12 ", "2000000000000.5"})
    assert_says(log_refusal(text + "2,20," + value + ",0\n"), ":3: column gx_dph: is beyond +-1e12");
  for (const char* flags : {"256", "-1", "1.5", "1e3"})
    assert_says(log_refusal(text + "2,20,1," + flags + "\n"), ":3: column gx_flags: expected whole bits 0..255");
  assert_says(log_refusal("t_s,temp_degc,gx_dph\n1,20,2e12\n"), ":2: column gx_dph: is beyond +-1e12");
}

// Notices of what the function does.
template <typename Work> static std::vector<std::string> notices_of(Work work) {
  std::vector<std::string> heard;
  set_notice_sink([&](const std::string& message) { heard.push_back(message); });
  work();
  set_notice_sink([](const std::string&) {});
  return heard;
}

// Power cut, full disk: 33541 may have become 3354, whatever its length beside the row before.
static void test_log_last_row_without_line_end_is_left_out_and_said(void**) {
  const std::string header = "# device = d\nt_s,temp_degc,gx_dph,gx_flags\n", two_rows = "1,20,33540,0\n2,20,33541,1\n";
  int n = 0;
  for (const char* last : {"3,20,3354", "3,20,33542,0", "3,20,33542,12", "3,20", "3", "3,20,335x", "3,20,1,0\r"}) {
    const std::string path = file_with("cut" + std::to_string(n++) + ".csv", header + two_rows + last);
    Log log;
    size_t n_scanned = 0;
    const auto heard = notices_of([&] {
      log = read_log(path);
      scan_log(
          path, [](const Log&) {}, [&](const LogRow&) { ++n_scanned; });
    });
    std::remove(path.c_str());
    assert_int_equal(log.size(), 2);
    assert_int_equal(n_scanned, 2);
    assert_true(log.axes[0].rate_dph[1] == 33541 && log.axes[0].flags[1] == 1);
    assert_int_equal(heard.size(), 1); // though it was read twice
    assert_says(heard[0], path + ":5: the last row has no line end");
  }
}

static void test_log_whole_to_its_end_gives_no_notice(void**) {
  const std::string path = file_with("whole.csv", "t_s,temp_degc,gx_dph\n1,20,3354\n2,20,33541\n\n  ");
  assert_int_equal(notices_of([&] { assert_int_equal(read_log(path).size(), 2); }).size(), 0);
  std::remove(path.c_str());
}

// What a comment's cut-off value was nobody knows; and a log of one cut row is empty.
static void test_log_cut_in_a_comment_or_its_only_row(void**) {
  const std::string path = file_with("comment.csv", "t_s,temp_degc,gx_dph\n1,20,3354\n# serial = 12");
  assert_int_equal(read_log(path).metadata.count("serial"), 0);
  std::remove(path.c_str());
  notices_of(
      [] { assert_says(log_refusal("t_s,temp_degc,gx_dph\n1,20,3354"), ":2: empty log: a header and no whole row"); });
}

static std::string model_refusal(const std::string& text) {
  const std::string path = file_with("model.json", text);
  const std::string message = refusal([&] { read_model(path); });
  std::remove(path.c_str());
  return message;
}

// What was read is not written over, by whatever name; a file made anew in its place is another one.
static void test_a_log_that_was_read_is_kept_and_one_made_anew_is_not(void**) {
  const std::string path = file_with("kept.csv", "# imucal-log = 1\nt_s,temp_degc,gx_dph\n1,20,2\n2,20,3\n3,20,4\n");
  read_log(path);
  bool is_refused = false;
  try {
    write_text(path, "gone");
  } catch (const Error&) {
    is_refused = true;
  }
  assert_true(is_refused);
  assert_int_equal(read_log(path).size(), 3);
  std::remove(path.c_str());
  file_with("kept.csv", "other");
  write_text(path, "new");
  std::remove(path.c_str());
}

// Against 30 digits (Python's decimal): the long time constant would lose half of its digits as 1 - exp(-dt/tau).
static void test_markov_step_has_every_digit(void**) {
  const auto is_near = [](double value, double truth) { return std::abs(value / truth - 1) < 4 * DBL_EPSILON; };
  const MarkovStep step = Markov{20, 100}.step();
  assert_true(is_near(step.phi(), 0.990049833749168053573));
  assert_true(is_near(step.m(), 0.00995016625083194642609));
  assert_true(is_near(step.q(), 0.0198013266932446977792));
  assert_true(is_near(step.drive(), 0.140717186914906374486));
  assert_true(is_near(Markov{20, 1e9}.step().m(), 9.99999999500000000167e-10));
  assert_true(is_near(Markov{20, 1e9}.step().q(), 1.99999999800000000133e-9));
  assert_true(is_near(Markov{20, 100}.q_dph2(), 400 * 0.0198013266932446977792));
  assert_true(is_near(Markov{20, 100}.phi(50), 0.606530659712633423604)); // exp(-1/2)
}

static void test_model_round_trip(void**) {
  const std::string path =
      file_with("good.json",
                R"({"imucal_model":1,"arw_deg_rt_h":0.6,"markov":[{"sigma_dph":20,"tau_s":100}],"turn_on_sigma_dph":5,
          "bias":{"t0_degc":30,"range_degc":30,"coeff_dph":[80,300,150,-100]},
          "effects":[{"name":"rate_ramp","parameters":{"ramp_dph_per_h":3}}]})");
  const std::string again = scratch("again.json");
  const ErrorModel model = read_model(path);
  write_json(again, to_json(model));
  const ErrorModel back = read_model(again);
  for (const std::string& name : {path, again}) std::remove(name.c_str());
  assert_true(back.arw_deg_rt_h == 0.6 && back.turn_on_sigma_dph == 5);
  assert_true(back.markov.size() == 1 && back.markov[0].sigma_dph == 20 && back.markov[0].tau_s == 100);
  assert_true(back.bias->coeff_dph == model.bias->coeff_dph);
  assert_true(back.bias->at(60) == 80 + 300 + 150 - 100);
  assert_true(back.effects[0].parameters["ramp_dph_per_h"] == 3);
  // S0 = 2 sigma^2 tau + (60 arw)^2 = 80000 + 1296 (reference figures A, tests/README.md).
  assert_true(std::abs(back.slow_density_dph2_s() - 81296.0) < 1e-9);
}

static void test_polynomial_renormalised_is_the_same_curve(void**) {
  const ThermalPolynomial old{10, 40, {80, 300, 150, -100}};
  const ThermalPolynomial other = old.renormalised(25, 60);
  assert_int_equal(other.coeff_dph.size(), 4);
  for (double temp_degc = -40; temp_degc <= 90; temp_degc += 13)
    assert_true(std::abs(other.at(temp_degc) - old.at(temp_degc)) < 1e-9);
  assert_int_equal((ThermalPolynomial{10, 40, {5, 0, 0}}.renormalised(0, 1).coeff_dph.size()), 1);
}

static void test_model_malformed_names_the_field(void**) {
  assert_says(model_refusal("{"), ":1: not valid JSON");
  assert_says(model_refusal("{}"), "\"imucal_model\" is missing");
  assert_says(model_refusal(R"({"imucal_model":2})"), "version not known");
  assert_says(model_refusal(R"({"imucal_model":1,"arw_deg_rt_h":-1})"), "arw_deg_rt_h");
  assert_says(model_refusal(R"({"imucal_model":1,"arw_deg_rt_h":"x"})"), "expected a number");
  assert_says(model_refusal(R"({"imucal_model":1,"arw_deg_rt_h":1,"markov":[{"sigma_dph":20}]})"),
              "markov[0]: field \"tau_s\"");
  assert_says(model_refusal(R"({"imucal_model":1,"arw_deg_rt_h":1,"markov":[{"sigma_dph":20,"tau_s":0}]})"),
              "markov[0].tau_s");
  assert_says(
      model_refusal(R"({"imucal_model":1,"arw_deg_rt_h":1,"bias":{"t0_degc":1,"range_degc":0,"coeff_dph":[1]}})"),
      "range_degc");
  assert_says(model_refusal(R"({"imucal_model":1,"arw_deg_rt_h":1,"markow":[]})"), "did you mean \"markov\"?");
  assert_says(model_refusal("{\"imucal_model\":1,\n\"arw_deg_rt_h\":1,\n\"arw_deg_rt_h\":2}"),
              ":3: field \"arw_deg_rt_h\" is given twice");
  assert_says(model_refusal(R"({"imucal_model":1})"), "\"arw_deg_rt_h\" is missing");
  assert_says(model_refusal("{\"imucal_model\":1,\n\"arw_deg_rt_h\":1e999}"), ":2: the number 1e999 is too large");
}

static void test_text_of_unknown_origin_is_made_printable(void**) {
  assert_string_equal(printable("a\x1b[31m\x07 \xc3\xa9\n\xc2\x9b\xff\x7f").c_str(),
                      "a\\x1b[31m\\x07 \xc3\xa9\n\\xc2\\x9b\\xff\\x7f");
  assert_string_equal(shortened("abcdef", 3).c_str(), "abc...");
  assert_string_equal(nearest_name("gx_dhp", {"gy_dph", "gx_dph"}).c_str(), "gx_dph");
  assert_string_equal(nearest_name("zebra", {"gy_dph", "gx_dph"}).c_str(), "");
}

static void test_profile_basic_lasts_140_min(void**) {
  const std::string path = file_with("basic.json",
                                     R"({"imucal_profile":1,"start_degc":0,"segments":[
      {"rate_degc_per_min":0,"duration_s":1200},{"rate_degc_per_min":0.6,"to_degc":60},
      {"rate_degc_per_min":0,"duration_s":1200}]})");
  const Profile profile = read_profile(path);
  std::remove(path.c_str());
  assert_true(std::abs(profile.duration_s() - 8400.0) < 1e-9);
  assert_true(profile.min_degc() == 0 && profile.max_degc() == 60);
  assert_true(std::abs(profile.at(4200) - 30.0) < 1e-9);
  const auto temp_degc = profile.temperatures();
  assert_int_equal(temp_degc.size(), 8400);
  assert_true(temp_degc.front() == 0 && temp_degc.back() == 60);
  assert_true(std::abs(temp_degc[1200] - 0.005) < 1e-9); // middle of the first second of the ramp
}

static void test_profile_repeat_continues_where_it_ended(void**) {
  const std::string path = file_with("cycle.json", R"({"imucal_profile":1,"start_degc":0,"repeat":2,"segments":[
      {"rate_degc_per_min":1,"to_degc":10},{"rate_degc_per_min":2,"to_degc":0}]})");
  const Profile profile = read_profile(path);
  std::remove(path.c_str());
  assert_true(std::abs(profile.duration_s() - 1800.0) < 1e-9);
  assert_true(std::abs(profile.at(1200) - 5.0) < 1e-9);
  assert_true(std::abs(profile.at(1650) - 5.0) < 1e-9);
}

// What a profile says but nobody follows is remarked: a ramp that the second time starts where it ends, a duration of a ramp that is
// not the one that its rate takes, an end of a soak.
static void test_profile_notes_what_it_does_not_follow(void**) {
  std::vector<std::string> heard;
  set_notice_sink([&](const std::string& message) { heard.push_back(message); });
  const auto notes_of = [&](const std::string& name, const std::string& text) {
    heard.clear();
    const std::string path = file_with(name, text);
    read_profile(path);
    std::remove(path.c_str());
    return heard;
  };
  const std::string head = R"({"imucal_profile":1,"start_degc":0,"repeat":)";
  auto notes = notes_of("one_way.json", head + R"(2,"segments":[{"rate_degc_per_min":0,"duration_s":60},
      {"rate_degc_per_min":1,"to_degc":60}]})");
  assert_int_equal(notes.size(), 1);
  for (const char* part : {"one_way.json", "repeat", "segments[1]", "60 degC", "0 degC"}) assert_says(notes[0], part);
  notes = notes_of("duration.json", head + R"(1,"segments":[{"rate_degc_per_min":1,"to_degc":60,"duration_s":600}]})");
  assert_int_equal(notes.size(), 1);
  for (const char* part : {"segments[0].duration_s", "3600 s", "600"}) assert_says(notes[0], part);
  notes = notes_of("soak.json", head + R"(1,"segments":[{"rate_degc_per_min":0,"to_degc":60,"duration_s":600}]})");
  assert_int_equal(notes.size(), 1);
  for (const char* part : {"segments[0].to_degc", "stays at 0 degC"}) assert_says(notes[0], part);
  notes = notes_of("way_back.json", head + R"(2,"segments":[{"rate_degc_per_min":1,"to_degc":60,"duration_s":3600},
      {"rate_degc_per_min":2,"to_degc":0}]})");
  assert_int_equal(notes.size(), 0);
  notes = notes_of("partly.json", head + R"(2,"segments":[{"rate_degc_per_min":1,"to_degc":60},
      {"rate_degc_per_min":2,"to_degc":20}]})");
  assert_int_equal(notes.size(), 0);
  set_notice_sink([](const std::string&) {});
}

static void test_profile_malformed_is_refused(void**) {
  const auto says = [](const std::string& text, const std::string& part) {
    const std::string path = file_with("profile.json", text);
    assert_says(refusal([&] { read_profile(path); }), part);
    std::remove(path.c_str());
  };
  says(R"({"imucal_profile":1,"segments":[]})", "start_degc");
  says(R"({"imucal_profile":1,"start_degc":0,"segments":[]})", "less than one second");
  says(R"({"imucal_profile":1,"start_degc":0,"segments":[{"rate_degc_per_min":0}]})", "duration_s");
  says(R"({"imucal_profile":1,"start_degc":0,"segments":[{"rate_degc_per_min":1}]})", "to_degc");
  says(R"({"imucal_profile":1,"start_degc":5,"segments":[{"rate_degc_per_min":1,"to_degc":5}]})",
       "a ramp to the temperature");
}

static void test_write_failing_writer_leaves_the_old_file(void**) {
  const std::string path = file_with("kept.json", "old");
  try {
    write_stream(path, [](std::ostream& out) {
      out << "half";
      throw data_error("broken off");
    });
    fail_msg("the writer's error was lost");
  } catch (const Error&) {
  }
  std::ifstream in(path);
  std::string content;
  in >> content;
  std::remove(path.c_str());
  assert_string_equal(content.c_str(), "old");
}

static std::string content_of(const std::string& path) {
  std::ifstream in(path);
  return std::string(std::istreambuf_iterator<char>(in), {});
}

static void test_kept_numbers_written_are_read_with_the_same_bits(void**) {
  const std::string path = scratch("kept.json");
  const std::vector<double> numbers = {0.1, -1.0 / 3, 1e-300, -1e300, 4, 0.30000000000000004};
  write_kept_numbers(path, "record 7, \"order\" 3", numbers);
  const auto back = read_kept_numbers(path, "record 7, \"order\" 3");
  assert_true(back.has_value());
  assert_int_equal(back->size(), numbers.size());
  assert_memory_equal(back->data(), numbers.data(), numbers.size() * sizeof(double));
  write_kept_numbers(path, "another", {2.5}); // takes the place of the first
  assert_true(read_kept_numbers(path, "another") == std::vector<double>{2.5});
  std::remove(path.c_str());
}

// Nothing, not a message: they are computed again.
static void test_kept_numbers_of_another_key_version_or_damaged_are_none(void**) {
  const std::string path = scratch("kept.json");
  assert_false(read_kept_numbers(path, "key").has_value()); // there is no such file
  write_kept_numbers(path, "key", {1, 2, 3});
  const std::string whole = content_of(path);
  assert_true(read_kept_numbers(path, "key").has_value());
  for (const char* other : {"", "ke", "key ", "Key"}) assert_false(read_kept_numbers(path, other).has_value());
  const auto none = [&](const std::string& text) {
    std::ofstream(path) << text;
    if (read_kept_numbers(path, "key")) fail_msg("taken: %s", text.c_str());
  };
  for (size_t n = 0; n <= whole.rfind('}'); ++n) none(whole.substr(0, n)); // cut off anywhere
  const auto with = [](const std::string& version, const std::string& gains) {
    return "{\"imucal_nulls\": " + version + ", \"key\": \"key\", \"gains\": " + gains + "}";
  };
  std::ofstream(path) << with("2", "[1, 2, 3]");
  assert_true(read_kept_numbers(path, "key") == (std::vector<double>{1, 2, 3}));
  for (const char* version : {"1", "3", "2.5", "\"2\"", "null"}) none(with(version, "[1, 2, 3]"));
  for (const char* gains : {"7", "\"1\"", "[1, null]", "[1, \"2\"]", "[1e999]", "{}"}) none(with("2", gains));
  none("{\"imucal_nulls\": 2, \"gains\": [1]}");
  none("[1, 2, 3]");
  std::remove(path.c_str());
}

static void test_kept_numbers_that_cannot_be_written_say_where(void**) {
  const std::string path = scratch("no_folder") + "/kept.json";
  assert_says(refusal([&] { write_kept_numbers(path, "key", {1}); }), path + ": cannot write");
}

static void test_a_log_that_nothing_would_read_is_not_written(void**) {
  const std::string path = file_with("infinite.csv", "old");
  Log log;
  log.t_s = {1, 2};
  log.temp_degc = {20, std::numeric_limits<double>::infinity()};
  log.axes.push_back({"gx_dph", 1.0, true, {5, 6}, {}});
  assert_says(refusal([&] { write_log(path, log); }), "infinite");
  log.temp_degc[1] = 21;
  log.axes[0].rate_dph[0] = -std::numeric_limits<double>::infinity();
  assert_says(refusal([&] { write_log(path, log); }), "infinite");
  assert_string_equal(read_text(path).c_str(), "old");
  std::remove(path.c_str());
}

// Whoever opens a file by the input room keeps it from the results, by whatever name.
static void test_what_was_opened_is_not_written(void**) {
  const std::string path = file_with("read.txt", "kept"), link = scratch("link.txt"), other = scratch("other.txt");
  assert_int_equal(::symlink(path.c_str(), link.c_str()), 0);
  write_text(path, "kept"); // not yet read
  assert_string_equal(read_text(path).c_str(), "kept");
  for (const std::string& name : {path, link}) {
    assert_says(refusal([&] { write_text(name, "lost"); }), "give another name");
    assert_says(refusal([&] { refuse_protected(name); }), "give another name");
  }
  write_text(other, "new");
  refuse_protected(other);
  assert_true(is_same_file(path, link) && !is_same_file(path, other));
  assert_true(is_same_file("none", "./none") && !is_same_file("none", "another"));
  assert_true(!is_same_file("-", "-") && !is_same_file("/dev/null", "/dev/null"));
  assert_string_equal(read_text(link).c_str(), "kept");
  for (const std::string& name : {link, path, other}) std::remove(name.c_str());
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_a_log_that_nothing_would_read_is_not_written),
      cmocka_unit_test(test_what_was_opened_is_not_written),
      cmocka_unit_test(test_log_written_reads_back),
      cmocka_unit_test(test_log_units_become_dph_and_mg),
      cmocka_unit_test(test_log_axes_are_named_in_the_units_inside),
      cmocka_unit_test(test_log_two_columns_of_one_axis_keep_their_names),
      cmocka_unit_test(test_log_flags_are_of_the_axis_of_their_name),
      cmocka_unit_test(test_log_written_keeps_the_digits_it_promises),
      cmocka_unit_test(test_log_metadata_several_on_a_line),
      cmocka_unit_test(test_log_malformed_names_the_line),
      cmocka_unit_test(test_log_unknown_axis_lists_those_there_are),
      cmocka_unit_test(test_log_scan_gives_what_read_gives),
      cmocka_unit_test(test_plain_number_has_the_bits_of_strtod),
      cmocka_unit_test(test_plain_number_leaves_the_rest),
      cmocka_unit_test(test_field_ends_are_found_in_lines_of_any_length),
      cmocka_unit_test(test_bytes_are_found_where_they_stand),
      cmocka_unit_test(test_log_any_spelling_is_read_alike),
      cmocka_unit_test(test_log_error_beyond_a_buffer_names_its_line),
      cmocka_unit_test(test_log_value_too_large_is_refused_however_it_is_written),
      cmocka_unit_test(test_log_last_row_without_line_end_is_left_out_and_said),
      cmocka_unit_test(test_log_whole_to_its_end_gives_no_notice),
      cmocka_unit_test(test_log_cut_in_a_comment_or_its_only_row),
      cmocka_unit_test(test_a_log_that_was_read_is_kept_and_one_made_anew_is_not),
      cmocka_unit_test(test_markov_step_has_every_digit),
      cmocka_unit_test(test_model_round_trip),
      cmocka_unit_test(test_polynomial_renormalised_is_the_same_curve),
      cmocka_unit_test(test_model_malformed_names_the_field),
      cmocka_unit_test(test_text_of_unknown_origin_is_made_printable),
      cmocka_unit_test(test_profile_basic_lasts_140_min),
      cmocka_unit_test(test_profile_repeat_continues_where_it_ended),
      cmocka_unit_test(test_profile_notes_what_it_does_not_follow),
      cmocka_unit_test(test_profile_malformed_is_refused),
      cmocka_unit_test(test_write_failing_writer_leaves_the_old_file),
      cmocka_unit_test(test_kept_numbers_written_are_read_with_the_same_bits),
      cmocka_unit_test(test_kept_numbers_of_another_key_version_or_damaged_are_none),
      cmocka_unit_test(test_kept_numbers_that_cannot_be_written_say_where),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
