// SPDX-License-Identifier: MIT
// Table as JSON: there and back changes nothing, and differences are named by field.
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <ios>
extern "C" {
#include <cmocka.h>
}
#include <cmath>
#include <cstring>
#include <string>

#include "base/error.h"
#include "base/rng.h"
#include "device/run.h"
#include "io/json_file.h"
#include "io/table_json.h"

using namespace imucal;

namespace {

// A table with every field used and numbers of full float32 length.
imucal_table_t full_table(uint64_t seed) {
  Rng rng(seed, 0, 0, Stream::kTool);
  const auto draw = [&](double lo, double hi) { return static_cast<float>(lo + (hi - lo) * rng.uniform()); };
  imucal_table_t table{};
  assert_int_equal(imucal_text_set(table.serial, sizeof table.serial, "A-17"), IMUCAL_OK);
  table.sequence = 1 + rng.bits() % 1000;
  table.created_s = rng.bits();
  table.n_channels = 6;
  table.degc_per_count = draw(0.001, 0.1);
  table.degc_at_zero = draw(-50, 50);
  const char* names[] = {"gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"};
  for (size_t i = 0; i < 6; ++i) {
    imucal_table_channel_t& c = table.channel[i];
    assert_int_equal(imucal_text_set(c.name, sizeof c.name, names[i]), IMUCAL_OK);
    c.order = static_cast<uint8_t>(i == 5 ? 0 : 1 + i);
    c.scale_order = static_cast<uint8_t>(c.order ? i % 3 : 0);
    c.n_markov = static_cast<uint8_t>(i % 3);
    c.t0_degc = draw(25, 30);
    c.range_degc = draw(35, 45);
    for (unsigned k = 0; k <= c.order && c.order; ++k) c.coeff[k] = draw(-500, 500);
    for (unsigned k = 0; k <= c.scale_order && c.order; ++k) c.scale_coeff[k] = draw(-0.02, 0.02);
    c.span_lo_degc = draw(-1, 5);
    c.span_hi_degc = draw(40, 50);
    for (float& s : c.sigma) s = draw(0, 20);
    c.arw = draw(0.01, 1);
    for (unsigned k = 0; k < c.n_markov; ++k) {
      c.markov_sigma[k] = draw(1, 30);
      c.markov_tau_s[k] = draw(10, 1000);
    }
    c.unit_per_count = draw(0.001, 40);
    c.full_scale_counts = 32767;
    c.n_seconds = rng.bits();
  }
  return table;
}

void test_json_and_back_is_the_same_bytes(void**) {
  for (uint64_t seed = 1; seed <= 50; ++seed) {
    const imucal_table_t table = full_table(seed);
    const imucal_table_t back = table_from_json(parse_json(to_json(table).dump(), "table.json")); // through text
    assert_true(table_bytes(table, "a") == table_bytes(back, "b"));
    assert_int_equal(table_differences(table, back).size(), 0);
  }
}

void test_binary_and_back_is_the_same(void**) {
  const imucal_table_t table = full_table(3);
  assert_int_equal(table_differences(table, table_from_bytes(table_bytes(table, "a"), "a")).size(), 0);
}

void test_differences_name_the_field(void**) {
  const imucal_table_t table = full_table(4);
  imucal_table_t other = table;
  other.channel[2].coeff[1] += 1;
  other.sequence += 5; // says when, not what
  const auto lines = table_differences(table, other);
  assert_int_equal(lines.size(), 1);
  assert_non_null(std::strstr(lines[0].c_str(), "gz_dph coeff_dph[1]"));
}

void test_shortest_gives_the_float_back(void**) {
  Rng rng(1, 0, 0, Stream::kTool);
  for (int i = 0; i < 10000; ++i) {
    const uint32_t bits = rng.bits();
    float value;
    std::memcpy(&value, &bits, sizeof value);
    if (!std::isfinite(value)) continue;
    assert_true(static_cast<float>(shortest(value)) == value);
  }
  assert_true(shortest(0.1f) == 0.1);
}

void test_wrong_version_is_refused_with_the_remedy(void**) {
  Json json = to_json(full_table(5));
  json["imucal_table"] = 2;
  try {
    table_from_json(JsonField(json, "t.json"));
    fail_msg("accepted");
  } catch (const Error& e) {
    assert_int_equal(e.exit(), Exit::kData);
    assert_non_null(std::strstr(e.what(), "it knows 1"));
  }
}

// Filter parameters: m, q, r in double on the host (run.h), against the defining equations.
void test_filter_parameters_of_a_model(void**) {
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  const imucal_link_cal_start_t start = cal_start_of(model, 3, 30, 30, {0, 60}, kPriorSigma);
  assert_true(std::abs(static_cast<double>(start.m) - 0.009950166250831947) < 1e-9);       // 1 - exp(-0.01)
  assert_true(std::abs(static_cast<double>(start.q) - 400 * 0.019801326693244747) < 1e-5); // 1 - exp(-0.02)
  assert_true(start.r == 1296.0f && start.markov_variance == 400.0f);
}

void test_two_markov_terms_become_one_of_the_same_slow_density(void**) {
  ErrorModel model;
  model.arw_deg_rt_h = 1;
  model.markov = {{10, 50}, {5, 1000}};
  const imucal_link_cal_start_t start = cal_start_of(model, 3, 30, 30, {0, 60}, kPriorSigma);
  assert_true(start.markov_variance == 125.0f);
  const double tau_s = -1 / std::log1p(-static_cast<double>(start.m));
  assert_true(std::abs(2 * 125 * tau_s - (2 * 100 * 50 + 2 * 25 * 1000)) < 1);
  assert_int_equal(start.n_markov, 2); // the table keeps both
}

void test_model_without_white_noise_is_refused(void**) {
  try {
    cal_start_of(ErrorModel{}, 3, 30, 30, {0, 60}, kPriorSigma);
    fail_msg("accepted");
  } catch (const Error& e) {
    assert_int_equal(e.exit(), Exit::kData);
  }
}

} // namespace

int main() {
  const CMUnitTest tests[] = {
      cmocka_unit_test(test_json_and_back_is_the_same_bytes),
      cmocka_unit_test(test_binary_and_back_is_the_same),
      cmocka_unit_test(test_differences_name_the_field),
      cmocka_unit_test(test_shortest_gives_the_float_back),
      cmocka_unit_test(test_wrong_version_is_refused_with_the_remedy),
      cmocka_unit_test(test_filter_parameters_of_a_model),
      cmocka_unit_test(test_two_markov_terms_become_one_of_the_same_slow_density),
      cmocka_unit_test(test_model_without_white_noise_is_refused),
  };
  return cmocka_run_group_tests(tests, nullptr, nullptr);
}
