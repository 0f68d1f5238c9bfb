// SPDX-License-Identifier: MIT
// Sums of squares of second differences of running sums p: what an Allan deviation spends its time on.
//
//   d(t0) = p[t0 + n] - 2 p[t0] + p[t0 - n]        over n, so that d/n is the prediction error of the mean (dp.h)
//
// Four n are taken abreast: the middle one of the three running sums is loaded and doubled once for all of them.  d is
// (p[t0 + n] + p[t0 - n]) - 2 p[t0]: its rounding is that of the running sums themselves.  Every second or fourth d is found
// by taking all of them abreast: less work than these one by one.
// Bits: the square at t0 is added to chain t0 mod 8, in rising order.  So a sum depends on its range alone: not on the
// n beside it, and not on the machine.
#pragma once
#include <cstddef>

namespace imucal {

// Values of t0, one after the other.
struct T0Range {
  long begin = 0, end = 0;
};

// The windows of n at t0.begin, t0.begin + step, … below t0.end.
struct SpacedWindows {
  long n = 1, step = 1;
  T0Range t0;
};

constexpr size_t kAbreast = 4;
inline bool can_be_abreast(long step) {
  return step == 1 || step == 2 || step == 4;
}

// sum[k] becomes the sum of d^2 over windows[k], for `count` <= kAbreast of them that can be abreast.  Fastest where their
// ranges are much the same.
void second_difference_sums(const double* p, size_t count, const SpacedWindows* windows, double* sum);

// The same of one n, with any step.  With step 1 quicker than abreast where a range holds less than some hundred t0.
double spaced_second_difference_sum(const double* p, const SpacedWindows& windows);

// d times scale at every t0 of the range.
void second_differences(const double* p, long n, T0Range t0, double scale, double* d);

} // namespace imucal
