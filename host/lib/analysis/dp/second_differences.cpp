// SPDX-License-Identifier: MIT
#include "analysis/dp/second_differences.h"

#include <algorithm>

#include "base/simd.h"

namespace imucal {

namespace {

constexpr long kChains = 8; // of additions: one need not wait for the one before
typedef double Chains[kChains];

// Adds d^2 of K values of n, each over the same t0 in [b, e).
template <size_t K> IMUCAL_WIDE_PART void add_squares(const double* p, const long* n, long b, long e, Chains* chains) {
  const auto add_at = [=](long t) {
    for (size_t k = 0; k < K; ++k) {
      const double d = (p[t + n[k]] + p[t - n[k]]) - 2 * p[t];
      chains[k][t % kChains] += d * d;
    }
  };
  long t = b;
  for (; t < e && t % kChains != 0; ++t) add_at(t);
  Lanes sum[K][2];
  for (size_t k = 0; k < K; ++k) load_lanes(&sum[k][0], chains[k]), load_lanes(&sum[k][1], chains[k] + 4);
  for (; t + kChains <= e; t += kChains)
    for (long half = 0; half < 2; ++half) {
      const double* const at = p + t + 4 * half;
      Lanes twice, hi, lo;
      load_lanes(&twice, at);
      twice += twice;
      for (size_t k = 0; k < K; ++k) {
        load_lanes(&hi, at + n[k]), load_lanes(&lo, at - n[k]);
        const Lanes d = (hi + lo) - twice;
        sum[k][half] += d * d;
      }
    }
  for (size_t k = 0; k < K; ++k) store_lanes(sum[k][0], chains[k]), store_lanes(sum[k][1], chains[k] + 4);
  for (; t < e; ++t) add_at(t);
}

IMUCAL_WIDE void add_squares_of_one(const double* p, const long* n, long b, long e, Chains* chains) {
  add_squares<1>(p, n, b, e, chains);
}

IMUCAL_WIDE void add_squares_abreast(const double* p, const long* n, long b, long e, Chains* chains) {
  add_squares<kAbreast>(p, n, b, e, chains);
}

// The chains begin with the range: no ends to be taken one by one before them, which a short range would feel.
IMUCAL_WIDE double sum_of_short(const double* p, long n, long b, long e) {
  Lanes s0 = {0, 0, 0, 0}, s1 = {0, 0, 0, 0}, hi, mid, lo;
  long t = b;
  for (; t + kChains <= e; t += kChains) {
    load_lanes(&hi, p + t + n), load_lanes(&mid, p + t), load_lanes(&lo, p + t - n);
    const Lanes d0 = (hi + lo) - (mid + mid);
    load_lanes(&hi, p + t + 4 + n), load_lanes(&mid, p + t + 4), load_lanes(&lo, p + t + 4 - n);
    const Lanes d1 = (hi + lo) - (mid + mid);
    s0 += d0 * d0, s1 += d1 * d1;
  }
  const Lanes s = s0 + s1;
  double sum = (s[0] + s[1]) + (s[2] + s[3]);
  for (; t < e; ++t) {
    const double d = (p[t + n] + p[t - n]) - 2 * p[t];
    sum += d * d;
  }
  return sum;
}

// Of the chains that the windows lie in (every t0 of a chain is the same mod `step`); the others become 0.
double sum_of_chains(double* s, const SpacedWindows& windows) {
  const auto mask = static_cast<unsigned long>(windows.step - 1); // the steps are powers of two
  for (long c = 0; mask != 0 && c < kChains; ++c)
    if ((static_cast<unsigned long>(c - windows.t0.begin) & mask) != 0) s[c] = 0;
  return ((s[0] + s[4]) + (s[1] + s[5])) + ((s[2] + s[6]) + (s[3] + s[7]));
}

} // namespace

void second_difference_sums(const double* p, size_t count, const SpacedWindows* windows, double* sum) {
  Chains chains[kAbreast] = {};
  long n[kAbreast] = {};
  // What all ranges have is taken abreast, what lies before and behind it one n after the other.
  T0Range common = windows[0].t0;
  for (size_t k = 0; k < count; ++k) {
    n[k] = windows[k].n;
    common = {std::max(common.begin, windows[k].t0.begin), std::min(common.end, windows[k].t0.end)};
  }
  const bool is_abreast = count == kAbreast && common.begin < common.end;
  for (size_t k = 0; k < count; ++k) {
    const T0Range& t0 = windows[k].t0;
    add_squares_of_one(p, &n[k], t0.begin, is_abreast ? common.begin : t0.end, &chains[k]);
  }
  if (is_abreast) {
    add_squares_abreast(p, n, common.begin, common.end, chains);
    for (size_t k = 0; k < count; ++k) add_squares_of_one(p, &n[k], common.end, windows[k].t0.end, &chains[k]);
  }
  for (size_t k = 0; k < count; ++k) sum[k] = sum_of_chains(chains[k], windows[k]);
}

double spaced_second_difference_sum(const double* p, const SpacedWindows& windows) {
  const long n = windows.n, step = windows.step;
  const T0Range t0 = windows.t0;
  if (step == 1) return sum_of_short(p, n, t0.begin, t0.end);
  const auto square_at = [p, n](long t) {
    const double d = (p[t + n] + p[t - n]) - 2 * p[t];
    return d * d;
  };
  double s0 = 0, s1 = 0, s2 = 0,
         s3 = 0; // no array: the compiler would keep it in memory, and every addition wait for that
  long t = t0.begin;
  for (; t + 3 * step < t0.end; t += 4 * step) {
    s0 += square_at(t), s1 += square_at(t + step);
    s2 += square_at(t + 2 * step), s3 += square_at(t + 3 * step);
  }
  for (; t < t0.end; t += step) s0 += square_at(t);
  return (s0 + s1) + (s2 + s3);
}

IMUCAL_WIDE void second_differences(const double* p, long n, T0Range t0, double scale, double* d) {
  for (long t = t0.begin; t < t0.end; ++t) d[t - t0.begin] = ((p[t + n] + p[t - n]) - 2 * p[t]) * scale;
}

} // namespace imucal
