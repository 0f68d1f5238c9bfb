// SPDX-License-Identifier: MIT
// CMocka for C++ and a comparison of doubles (CMocka 1.1 compares floats only).  Include after the project's headers.
#pragma once
#include <csetjmp>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
extern "C" {
#include <cmocka.h>
}
#include <cmath>
#include <cstdio>

inline void check_near(double got, double expected, double tolerance, const char* file, int line) {
  if (std::fabs(got - expected) <= tolerance) return;
  std::fprintf(stderr, "got %.15g, expected %.15g within %.3g\n", got, expected, tolerance);
  _fail(file, line);
}
#define assert_near(got, expected, tolerance) check_near(got, expected, tolerance, __FILE__, __LINE__)
