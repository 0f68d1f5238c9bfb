// SPDX-License-Identifier: MIT
// store: the short form of `make torn`.  Power cut at every unit of every operation, a driver that fails at any call:
// always the old or the new table rules.
#include "unit.h"

#include "torn/torn.h"

static void test_cut_at_every_unit_old_or_new_table_rules(void** state) {
  (void)state;
  static torn_state_t start;
  static const int patterns[] = {TORN_NOR_ALL_WAVER, TORN_NOR_MIXED};
  torn_counts_t counts = {0};
  for (int g = 0; g < TORN_GEOMETRIES; g++)
    for (int mode = 0; mode < TORN_NOR_MODES; mode++)
      for (int s = 0; s < TORN_STARTS; s++) {
        torn_path_t path = {.seed = unit_seed(), .geometry = g, .mode = mode, .channels = 1, .start = s};
        torn_start(&start, &path);
        torn_everywhere(&start, &path, 1, patterns, 2, &counts);
      }
  assert_true(torn_n_cuts(&counts, 0) > 10000);
  assert_int_equal(torn_n_failures(&counts), 0);
}

static void test_cut_three_times_in_a_row_old_or_new_table_rules(void** state) {
  (void)state;
  torn_counts_t counts = {0};
  const int n_cuts = unit_repeats(3000);
  torn_sample(unit_seed(), (uint64_t)n_cuts, 1, &counts);
  assert_int_equal(torn_n_cuts(&counts, 2), n_cuts);
  assert_int_equal(torn_n_failures(&counts), 0);
}

static void test_bits_flipped_at_rest_never_make_a_table(void** state) {
  (void)state;
  torn_counts_t counts = {0};
  torn_flips(unit_seed(), 2, &counts);
  assert_int_equal(torn_n_failures(&counts), 0);
}

static void test_driver_fails_at_any_call_done_only_where_it_is(void** state) {
  (void)state;
  torn_counts_t counts = {0};
  uint64_t n_failed_calls = 0;
  torn_failures(unit_seed(), &counts, &n_failed_calls);
  assert_true(n_failed_calls > 5000);
  assert_int_equal(torn_n_failures(&counts), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_cut_at_every_unit_old_or_new_table_rules),
      cmocka_unit_test(test_cut_three_times_in_a_row_old_or_new_table_rules),
      cmocka_unit_test(test_bits_flipped_at_rest_never_make_a_table),
      cmocka_unit_test(test_driver_fails_at_any_call_done_only_where_it_is),
  };
  return cmocka_run_group_tests_name("store_torn", tests, NULL, NULL);
}
