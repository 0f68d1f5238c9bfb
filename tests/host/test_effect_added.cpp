// SPDX-License-Identifier: MIT
// An effect is one file: this one, written as those of host/lib/physics/effects are, is taken into the
// library and is then simulated, read and offered to the engine like any other.
#include <cmath>
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>

#include "base/error.h"
#include "effects/temperature_rate_squared.cpp"
#include "io/json_file.h"
#include "physics/sim/simulate.h"
// After the others: it defines a macro `fail`.
extern "C" {
#include <cmocka.h>
}

using namespace imucal;

static std::vector<double> simulated_dph(double rate_degc_min, double k) {
  Profile profile;
  profile.start_degc = 10;
  profile.segments.push_back({rate_degc_min, 0, 40});
  EffectSpec spec{"temperature_rate_squared", Json{{"k_dph_per_degc2_min2", k}}};
  return simulate({ErrorModel()}, 1, profile, {spec}, SimOptions()).axes[0].run.rate_dph;
}

static void test_added_effect_is_simulated_by_its_name(void**) {
  for (const double rate : {0.5, 2.0, 3.0}) {
    const std::vector<double> dph = simulated_dph(rate, 7);
    assert_true(std::fabs(dph[dph.size() / 2] - 7 * rate * rate) < 1e-6);
  }
}

static void test_added_effect_has_its_place_in_its_family(void**) {
  size_t place = 0, slow_noise = 0;
  for (size_t i = 0; i < effect_library().size(); ++i) {
    if (effect_library()[i]->name() == "temperature_rate_squared") place = i;
    if (effect_library()[i]->family() == Family::kSlowNoise && !slow_noise) slow_noise = i;
  }
  assert_true(effect_library()[place]->name() == "temperature_rate_squared" && place < slow_noise);
}

static void test_added_effect_refuses_what_it_does_not_know(void**) {
  try {
    read_parameters(find_effect("temperature_rate_squared"), {{"k_dph", 3}});
    fail_msg("taken");
  } catch (const Error& error) {
    assert_true(std::string(error.what()).find("k_dph_per_degc2_min2") != std::string::npos);
  }
}

static void test_added_effect_offers_the_column_it_simulates(void**) {
  RunInput run;
  run.rate_degc_min = {-2, 0, 3};
  run.t_s = {0, 1, 2};
  const auto columns = find_effect("temperature_rate_squared").estimator()->columns(run, {});
  assert_true(columns.size() == 1 && columns[0] == (Column{4, 0, 9}));
}

static void test_the_same_name_twice_is_refused(void**) {
  try {
    add_effect(*library_entry_TemperatureRateSquared());
    fail_msg("taken twice");
  } catch (const Error& error) {
    assert_true(std::string(error.what()).find("there already") != std::string::npos);
  }
}

// In the folder the list is made from the files: a copy of this one there is found by its last line.
static void test_list_of_the_library_is_made_from_the_files(void**) {
  FILE* list = popen("host/lib/physics/effects/effect_list.sh tests/host/effects", "r");
  char line[100] = "";
  assert_non_null(list);
  assert_non_null(std::fgets(line, sizeof line, list));
  pclose(list);
  assert_string_equal(line, "ENTRY(TemperatureRateSquared)\n");
}

int main() {
  add_effect(*library_entry_TemperatureRateSquared());
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_added_effect_is_simulated_by_its_name),
      cmocka_unit_test(test_added_effect_has_its_place_in_its_family),
      cmocka_unit_test(test_added_effect_refuses_what_it_does_not_know),
      cmocka_unit_test(test_added_effect_offers_the_column_it_simulates),
      cmocka_unit_test(test_the_same_name_twice_is_refused),
      cmocka_unit_test(test_list_of_the_library_is_made_from_the_files),
  };
  return cmocka_run_group_tests_name("an added effect", tests, nullptr, nullptr);
}
