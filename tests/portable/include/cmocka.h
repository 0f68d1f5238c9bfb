// SPDX-License-Identifier: MIT
// What the core's tests use of CMocka, for machines that have no CMocka library: checks, and a runner that goes on after a
// failed test.  Only tests/portable compiles against it.
#ifndef TESTS_PORTABLE_CMOCKA_H
#define TESTS_PORTABLE_CMOCKA_H
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

struct CMUnitTest {
  const char* name;
  void (*function)(void** state);
  int (*setup)(void** state); /* before the test, or NULL */
};
#define cmocka_unit_test(f) cmocka_unit_test_setup(f, NULL)
#define cmocka_unit_test_setup(f, setup)                                                                               \
  { #f, f, setup }
#define cmocka_run_group_tests(tests, setup, teardown) portable_run(tests, sizeof(tests) / sizeof((tests)[0]))
#define cmocka_run_group_tests_name(name, tests, setup, teardown) cmocka_run_group_tests(tests, setup, teardown)

static jmp_buf portable_end; /* of the running test: 1 failed, 2 skipped */

static inline int portable_run(const struct CMUnitTest* tests, size_t n) {
  volatile size_t n_failed = 0, n_skipped = 0;
  for (volatile size_t i = 0; i < n; i++) {
    void* state = NULL;
    const int how = setjmp(portable_end);
    if (how == 0 && tests[i].setup != NULL && tests[i].setup(&state) != 0) longjmp(portable_end, 1);
    if (how == 0) tests[i].function(&state);
    if (how == 1) fprintf(stderr, "FAILED %s\n", tests[i].name);
    n_failed += how == 1;
    n_skipped += how == 2;
  }
  fprintf(stderr, "%zu tests, %zu failed, %zu skipped\n", n, n_failed, n_skipped);
  return n_failed == 0 ? 0 : 1;
}

#define portable_check(is_true, ...)                                                                                   \
  do {                                                                                                                 \
    if (!(is_true)) {                                                                                                  \
      fprintf(stderr, "%s:%d: ", __FILE__, __LINE__);                                                                  \
      fprintf(stderr, __VA_ARGS__);                                                                                    \
      fputc('\n', stderr);                                                                                             \
      longjmp(portable_end, 1);                                                                                        \
    }                                                                                                                  \
  } while (0)
#define fail_msg(...) portable_check(0, __VA_ARGS__)
#define skip() longjmp(portable_end, 2)
#define print_message printf
#define assert_true(a) portable_check(a, "%s", #a)
#define assert_false(a) portable_check(!(a), "not %s", #a)
#define assert_non_null(a) portable_check((a) != NULL, "%s is null", #a)
#define assert_int_equal(a, b)                                                                                         \
  portable_check((unsigned long long)(a) == (unsigned long long)(b), "%s == %s: %lld, %lld", #a, #b, (long long)(a),   \
                 (long long)(b))
#define assert_int_not_equal(a, b)                                                                                     \
  portable_check((unsigned long long)(a) != (unsigned long long)(b), "%s != %s", #a, #b)
/* A function: the comparison of an unsigned number with 0 is no mistake here. */
static inline int portable_is_in(unsigned long long a, unsigned long long lo, unsigned long long hi) {
  return a >= lo && a <= hi;
}
#define assert_in_range(a, lo, hi)                                                                                     \
  portable_check(portable_is_in((unsigned long long)(a), (unsigned long long)(lo), (unsigned long long)(hi)),          \
                 "%s: %lld", #a, (long long)(a))
#define assert_memory_equal(a, b, n) portable_check(memcmp(a, b, n) == 0, "memory of %s and %s", #a, #b)
#define assert_string_equal(a, b) portable_check(strcmp(a, b) == 0, "\"%s\", \"%s\"", a, b)
#define assert_string_not_equal(a, b) portable_check(strcmp(a, b) != 0, "\"%s\" twice", a)
#endif
