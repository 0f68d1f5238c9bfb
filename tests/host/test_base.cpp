// SPDX-License-Identifier: MIT
// The base: the parallel loop, quantiles, random numbers side by side and by the piece.
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "base/box_muller.h"
#include "base/digits.h"
#include "base/fast_normal.h"
#include "base/parallel.h"
#include "base/quantile.h"
#include "base/rng.h"
#include "base/wrap.h"
// After the others: it defines a macro `fail`.
extern "C" {
#include <cmocka.h>
}

using namespace imucal;

static void test_parallel_for_every_item_once(void**) {
  for (const int threads : {-1, 0, 1, 2, 7}) {
    std::vector<std::atomic<int>> seen(100);
    parallel_for(100, threads, [&](long i) { ++seen[static_cast<size_t>(i)]; });
    for (const auto& n : seen) assert_int_equal(n, 1);
    parallel_for(
        100, threads, [&](long i) { ++seen[static_cast<size_t>(i)]; }, [] {});
    for (const auto& n : seen) assert_int_equal(n, 2);
  }
  parallel_for(0, 4, [](long) { fail_msg("no items"); });
  parallel_for(
      0, 4, [](long) { fail_msg("no items"); }, [] {});
}

// The text of what a loop over 1000 items throws, and how many items were begun.
template <class Loop> static std::string thrown_by(const Loop& loop, int* begun) {
  std::atomic<int> n{0};
  std::string text = "nothing";
  try {
    loop([&](long i) {
      ++n;
      if (i == 3) throw std::runtime_error("item 3");
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    });
  } catch (const std::runtime_error& e) {
    text = e.what();
  }
  *begun = n;
  return text;
}

static void test_parallel_for_exception_reaches_the_caller_and_ends_the_loop(void**) {
  for (const int threads : {1, 4}) {
    int begun = 0;
    assert_string_equal(thrown_by([&](const auto& f) { parallel_for(1000, threads, f); }, &begun).c_str(), "item 3");
    assert_in_range(begun, 4, 200);
    assert_string_equal(thrown_by([&](const auto& f) { parallel_for(1000, threads, f, [] {}); }, &begun).c_str(),
                        "item 3");
    assert_in_range(begun, 4, 200);
  }
}

static void test_parallel_for_watch_runs_in_the_caller(void**) {
  std::set<std::thread::id> watchers;
  std::atomic<bool> was_watched{false};
  const auto wait = [&](long) {
    for (int k = 0; k < 5000 && !was_watched; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  parallel_for(2, 2, wait, [&] { watchers.insert(std::this_thread::get_id()), was_watched = true; });
  assert_int_equal(watchers.size(), 1);
  assert_true(*watchers.begin() == std::this_thread::get_id());
  was_watched = false;
  std::string text;
  try {
    parallel_for(2, 2, wait, [&] { was_watched = true, throw std::runtime_error("watch"); });
  } catch (const std::runtime_error& e) {
    text = e.what();
  }
  assert_string_equal(text.c_str(), "watch");
}

static void assert_relative(double found, double expected, double tolerance) {
  if (!(std::fabs(found / expected - 1) <= tolerance)) fail_msg("%.17g, expected %.17g", found, expected);
}

// Abramowitz and Stegun, tables 26.1 and 26.8; digits beyond theirs by scipy.stats.
static void test_quantiles_are_those_of_the_tables(void**) {
  assert_relative(normal_quantile(0.975), 1.959963984540054, 1e-14);
  assert_relative(normal_quantile(1e-10), -6.361340902404056, 1e-14);
  assert_relative(normal_cdf(-1.0), 0.15865525393145705, 1e-14);
  assert_relative(chi2_quantile(0.95, 10), 18.307038053275146, 1e-13);
  assert_relative(chi2_quantile(0.025, 1), 9.820691171752581e-04, 1e-12);
  assert_relative(chi2_cdf(3.841458820694124, 1), 0.95, 1e-13);
  // Hardly any degree of freedom, and very many: quantile and distribution are inverse.
  for (const double dof : {0.3, 2.5, 40.0, 3000.0, 2e6})
    for (const double p : {1e-4, 0.025, 0.5, 0.975, 0.9999})
      assert_relative(chi2_cdf(chi2_quantile(p, dof), dof), p, 1e-9);
  // 3 of 10: Clopper and Pearson 1934, 95 %.
  assert_relative(student_quantile(0.975, 7), 2.364624251592785, 1e-12);
  assert_relative(student_quantile(0.975, 120), 1.979930405052777, 1e-10);
  assert_relative(beta_quantile(0.025, 3, 8), 0.0667395111777345, 1e-12);
  assert_relative(beta_quantile(0.975, 4, 7), 0.6524528500599972, 1e-12);
  assert_relative(f_quantile(0.95, 5, 10), 3.3258345304130111, 1e-10);
  assert_relative(f_quantile(0.975, 1, 12), std::pow(student_quantile(0.9875, 12), 2), 1e-10);
  assert_relative(f_quantile(0.999, 7, 1e300), chi2_quantile(0.999, 7) / 7, 1e-12);
  assert_relative(f_quantile(0.9, 9, 1e6), f_quantile(0.9, 9, 0.999e6), 1e-4);
  const Interval interval = rms_interval(2, 10);
  assert_relative(interval.lo, 2 * std::sqrt(10 / 20.483177350807388), 1e-12);
  assert_relative(interval.hi, 2 * std::sqrt(10 / 3.246972780236842), 1e-12);
}

static void assert_same_bits(double found, double expected, size_t i) {
  if (std::memcmp(&found, &expected, sizeof found) != 0)
    fail_msg("number %zu: %.17g, expected %.17g", i, found, expected);
}

// Pieces of any length: 60,000 numbers a stream hold some 700 that needed a closer look, 16 of them in the tail.
static void test_normals_side_by_side_are_those_of_each_stream(void**) {
  std::vector<FastNormal> alone;
  for (uint64_t run = 0; run < 8; ++run) alone.emplace_back(Rng(3, run, 0, Stream::kTool));
  std::array<FastNormal, 8> streams = {alone[0], alone[1], alone[2], alone[3], alone[4], alone[5], alone[6], alone[7]};
  FastNormalLanes lanes(streams);
  size_t i = 0;
  for (const size_t n : {1, 0, 7, 100, 892, 59000}) {
    std::vector<double> out(8 * n);
    lanes.normals(n, out.data());
    for (size_t k = 0; k < out.size(); ++k) assert_same_bits(out[k], alone[k % 8].normal(), i + k / 8);
    i += n;
  }
}

static void test_normals_by_the_piece_are_those_one_by_one(void**) {
  Rng rng(5, 9, 2, Stream::kMarkov);
  std::vector<double> expected(1000);
  for (double& x : expected) x = rng.normal();
  for (const uint32_t first : {0u, 1u, 2u, 63u, 64u, 700u})
    for (const size_t n : {0u, 1u, 2u, 63u, 64u, 65u, 299u}) {
      std::vector<double> out(3 * n + 1, -7.0);
      rng.normals(first, n, out.data(), 3);
      for (size_t i = 0; i < n; ++i) assert_same_bits(out[3 * i], expected[first + i], first + i);
      assert_same_bits(out[3 * n], -7.0, n);
    }
}

// In last places of `scale`.
static double places_off(double found, long double exact, double scale) {
  return static_cast<double>(std::fabs(found - exact)) / (scale * 0x1p-52);
}

// Against long double: at both ends, beside 1 and sqrt(1/2), where the exponent changes, and everywhere.
static void test_logarithm_of_a_uniform_is_right_to_two_last_places(void**) {
  std::vector<double> all = {1.0,
                             1 - 0x1p-53,
                             1 - 0x1p-52,
                             0x1p-54,
                             0x1.8p-53,
                             0.5,
                             0x1.6A09E667F3BCCp-1,
                             0x1.6A09E667F3BCDp-1,
                             0x1.6A09E667F3BCEp-1};
  Rng rng(2, 0, 0, Stream::kTool);
  for (int i = 0; i < 100000; ++i) {
    all.push_back(rng.uniform());
    all.push_back(std::ldexp(rng.uniform(), -static_cast<int>(rng.bits() % 53)));
    all.push_back(1 - std::ldexp(rng.uniform(), -static_cast<int>(rng.bits() % 53)));
  }
  for (const double u : all) {
    double found;
    logarithm<double, uint64_t>(u, found);
    const long double exact = std::log(static_cast<long double>(u));
    if (places_off(found, exact, static_cast<double>(std::fabs(exact))) > 2) fail_msg("ln %a: %a", u, found);
  }
}

static void test_cosine_and_sine_of_a_turn_are_right_to_a_last_place_of_one(void**) {
  std::vector<double> all = {0.0, 0x1p-54, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0, 1 - 0x1p-53};
  for (int i = 1; i < 8; ++i) all.push_back(std::nextafter(i / 8.0, 0)), all.push_back(std::nextafter(i / 8.0, 1));
  Rng rng(3, 0, 0, Stream::kTool);
  for (int i = 0; i < 100000; ++i) all.push_back(rng.uniform());
  for (const double v : all) {
    double cosine, sine;
    cos_sin<double, uint64_t>(v, cosine, sine);
    const long double angle = 2 * 3.14159265358979323846264338327950288L * v;
    if (places_off(cosine, std::cos(angle), 1) > 1 || places_off(sine, std::sin(angle), 1) > 1)
      fail_msg("a turn of %a: cos %a, sin %a", v, cosine, sine);
  }
}

// The first words of Philox 4x32-10 for counter and key 0 (known answers of Random123), as uniforms and as a pair.
static void test_normals_of_a_block_are_box_and_mullers(void**) {
  const uint64_t words[] = {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8};
  double u, v;
  uniform_of(words[0], words[1], u);
  uniform_of(words[2], words[3], v);
  assert_relative(u, (0x6627e8d5 * 0x1p21 + (0xe169c58d >> 11) + 0.5) / 0x1p53, 0);
  assert_relative(v, (0xbc57ac4c * 0x1p21 + (0x9b00dbd8 >> 11) + 0.5) / 0x1p53, 0);
  Rng rng(0, 0, 0, 0u);
  const double radius = std::sqrt(-2 * std::log(u)), angle = 2 * 3.14159265358979323846 * v;
  assert_relative(rng.normal(), radius * std::cos(angle), 1e-14);
  assert_relative(rng.normal(), radius * std::sin(angle), 1e-14);
}

static void test_numbers_have_the_digits_that_are_known(void**) {
  const struct {
    double value, error;
    const char* text;
  } cases[] = {{731.6, 210, "730 +- 210"},
               {20388, 3204, "20400 +- 3200"},
               {0.00144312, 0.00085, "0.00144 +- 0.00085"},
               {-75.594, 2.31, "-75.6 +- 2.3"},
               {4.289, 3.8, "4.3 +- 3.8"},
               {108.1, 99.7, "110 +- 100"},
               {0, 0.5, "0.00 +- 0.50"},
               {480, NAN, "480.0"},
               {480, 0, "480.0"}};
  for (const auto& c : cases) assert_string_equal(with_error(c.value, c.error).c_str(), c.text);
  assert_string_equal(in_digits(76608.4, 2).c_str(), "77000");
  assert_string_equal(in_digits(9.96, 2).c_str(), "10");
  assert_string_equal(in_digits(0.0996, 2).c_str(), "0.10");
  assert_string_equal(in_digits(0, 2).c_str(), "0");
  assert_string_equal(nats_text(76608.4).c_str(), "76608");
  assert_string_equal(nats_text(3.14).c_str(), "3.1");
}

static void test_lines_are_wrapped_at_blanks_and_hang_under_their_text(void**) {
  const std::string text = "  where   at averaging times of 512 to 16384 s, most at 4096 s\n";
  assert_string_equal(wrapped(text, 0).c_str(), text.c_str());
  assert_string_equal(wrapped(text, 80).c_str(), text.c_str());
  assert_string_equal(wrapped(text, 40).c_str(), "  where   at averaging times of 512 to\n"
                                                 "          16384 s, most at 4096 s\n");
  // No label: two blanks further.  The last line has no end, as it was.
  assert_string_equal(wrapped("gx_dph: a gap, explained: thermal_hysteresis", 40).c_str(),
                      "gx_dph: a gap, explained:\n  thermal_hysteresis");
  // Text that begins further right than 20 characters is none behind a label.
  assert_string_equal(wrapped("warning of the first log:  it has no temperatures", 40).c_str(),
                      "warning of the first log:  it has no\n  temperatures");
  // A word that is too long, and a row of a table, stay whole.
  const std::string word(50, 'x'), row = "    1.67    4.618    4.966    4.758    4.323    4.123";
  assert_string_equal(wrapped("the file " + word + " is", 40).c_str(), ("the file\n  " + word + "\n  is").c_str());
  assert_string_equal(wrapped(row, 40).c_str(), row.c_str());
  // Characters count, not bytes.
  assert_string_equal(wrapped("\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4"
                              "\u00e4\u00e4\u00e4\u00e4 12345678901234567890 x",
                              41)
                          .c_str(),
                      "\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4\u00e4"
                      "\u00e4\u00e4 12345678901234567890 x");
}

int main() {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_parallel_for_every_item_once),
      cmocka_unit_test(test_parallel_for_exception_reaches_the_caller_and_ends_the_loop),
      cmocka_unit_test(test_parallel_for_watch_runs_in_the_caller),
      cmocka_unit_test(test_quantiles_are_those_of_the_tables),
      cmocka_unit_test(test_normals_side_by_side_are_those_of_each_stream),
      cmocka_unit_test(test_normals_by_the_piece_are_those_one_by_one),
      cmocka_unit_test(test_logarithm_of_a_uniform_is_right_to_two_last_places),
      cmocka_unit_test(test_cosine_and_sine_of_a_turn_are_right_to_a_last_place_of_one),
      cmocka_unit_test(test_normals_of_a_block_are_box_and_mullers),
      cmocka_unit_test(test_numbers_have_the_digits_that_are_known),
      cmocka_unit_test(test_lines_are_wrapped_at_blanks_and_hang_under_their_text),
  };
  return cmocka_run_group_tests_name("base", tests, nullptr, nullptr);
}
