// SPDX-License-Identifier: MIT
// store built for program units of 256 bytes: its sizes, and power cuts at every unit as in test_store_torn.c.
#define IMUCAL_STORE_MAX_PROGRAM 256u
// Its own build of the room, beside the one that every test is linked with.
#define imucal_store_check large_check
#define imucal_store_load large_load
#define imucal_store_write large_write
#define imucal_store_origin large_origin
#define imucal_store_rollback large_rollback
#define imucal_store_erase large_erase
#include "unit.h"

#include "store.c"

#include "torn/torn.h"

static imucal_status check(uint32_t slot_bytes, uint32_t program_bytes) {
  torn_nor_t nor;
  torn_nor_init(&nor, (torn_nor_geometry_t){slot_bytes, slot_bytes, program_bytes});
  const imucal_flash_t flash = torn_nor_flash(&nor);
  return imucal_store_check(&flash);
}

static void test_units_up_to_256_are_usable(void** state) {
  (void)state;
  assert_int_equal(check(4096, 64), IMUCAL_OK);
  assert_int_equal(check(4096, 128), IMUCAL_OK);
  assert_int_equal(check(4096, 256), IMUCAL_OK);
  assert_int_equal(check(2304, 256), IMUCAL_OK); /* 864 in four units, five marks */
  assert_int_equal(check(2048, 256), IMUCAL_ERR_GEOMETRY);
  assert_int_equal(check(4096, 512), IMUCAL_ERR_GEOMETRY);
}

static void test_cut_at_every_unit_of_256_old_or_new_table_rules(void** state) {
  (void)state;
  static torn_state_t start;
  static const int patterns[] = {TORN_NOR_ALL_WAVER, TORN_NOR_MIXED};
  torn_counts_t counts = {0};
  for (int channels = 1; channels <= 6; channels += 5)
    for (int mode = 0; mode < TORN_NOR_MODES; mode++)
      for (int s = 0; s < TORN_STARTS; s++) {
        torn_path_t path = {
            .seed = unit_seed(), .geometry = TORN_GEOMETRIES - 1, .mode = mode, .channels = channels, .start = s};
        torn_start(&start, &path);
        torn_everywhere(&start, &path, 1, patterns, 2, &counts);
      }
  assert_true(torn_n_cuts(&counts, 0) > 1000);
  assert_int_equal(torn_n_failures(&counts), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_units_up_to_256_are_usable),
      cmocka_unit_test(test_cut_at_every_unit_of_256_old_or_new_table_rules),
  };
  return cmocka_run_group_tests_name("store_large_units", tests, NULL, NULL);
}
