// SPDX-License-Identifier: MIT
/* The short form of make fuzz-device: random operations on the whole app (tests/fuzz/fuzz_device.h says what must hold). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "common/unit.h"
#include "fuzz/fuzz_device.h"

static void test_random_operations_are_answered_and_write_only_where_meant(void** state) {
  (void)state;
  unit_rng_t rng = {unit_seed()};
  uint8_t data[400];
  for (int k = 0; k < 600; k++) {
    for (size_t i = 0; i < sizeof data; i++) data[i] = (uint8_t)unit_bits(&rng);
    data[0] |= 0x80;                /* unlocked at the start */
    fuzz_device(data, sizeof data); /* aborts where something does not hold */
  }
  assert_true(fuzz_counts.n_replies > 30000 && fuzz_counts.n_replays > 1000 && fuzz_counts.n_flash_commands > 1000 &&
              fuzz_counts.n_cuts > 50);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_random_operations_are_answered_and_write_only_where_meant)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
