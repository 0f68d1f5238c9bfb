// SPDX-License-Identifier: MIT
#include "analysis/dp/sizes.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/simd.h"

namespace imucal {

namespace {

// The order of doubles that are not negative is that of their bits.
typedef int64_t LaneBits __attribute__((vector_size(32)));

struct Tally {
  double lo, hi, largest;
  long below;
  double* kept; // where the next goes

  IMUCAL_WIDE_PART void one(double d) {
    const double size = std::fabs(d);
    *kept = size;
    kept += (size >= lo) & (size <= hi);
    below += size < lo;
    largest = size > largest ? size : largest;
  }
};

IMUCAL_WIDE_PART void find_reaching(const double* d, const LaneBits& lo, LaneBits* mask) {
  constexpr int64_t kAll = std::numeric_limits<int64_t>::max();
  const LaneBits without_sign = {kAll, kAll, kAll, kAll};
  LaneBits bits;
  std::memcpy(&bits, d, sizeof bits);
  *mask = (bits & without_sign) >= lo;
}

IMUCAL_WIDE_PART bool any(const LaneBits& mask) {
  return ((mask[0] | mask[1]) | (mask[2] | mask[3])) != 0;
}

// Nineteen of twenty are below lo, near to one another where n is large: sixteen at a time.
IMUCAL_WIDE void tally_all(const double* d, long n, Tally* out) {
  Tally t = *out;
  const Lanes lo_lanes = {t.lo, t.lo, t.lo, t.lo};
  LaneBits lo;
  std::memcpy(&lo, &lo_lanes, sizeof lo);
  long k = 0;
  for (; k + 16 <= n; k += 16) {
    LaneBits reaches[4];
    for (long j = 0; j < 4; ++j) find_reaching(d + k + 4 * j, lo, &reaches[j]);
    if (!any((reaches[0] | reaches[1]) | (reaches[2] | reaches[3]))) {
      t.below += 16;
      continue;
    }
    for (long j = k; j < k + 16; j += 4) {
      if (!any(reaches[(j - k) / 4])) {
        t.below += 4;
        continue;
      }
      t.one(d[j]), t.one(d[j + 1]), t.one(d[j + 2]), t.one(d[j + 3]);
    }
  }
  for (; k < n; ++k) t.one(d[k]);
  *out = t;
}

} // namespace

double order_statistic(std::vector<double>* x, double part) {
  const double place = part * static_cast<double>(x->size() - 1);
  const auto k = static_cast<long>(place);
  std::nth_element(x->begin(), x->begin() + k, x->end());
  const double lower = (*x)[static_cast<size_t>(k)];
  const double upper = k + 1 < static_cast<long>(x->size()) ? *std::min_element(x->begin() + k + 1, x->end()) : lower;
  return lower + (place - static_cast<double>(k)) * (upper - lower);
}

Sizes::Sizes(std::vector<double> sample) : lo_(0), hi_(std::numeric_limits<double>::infinity()) {
  if (sample.empty()) return;
  const double error = 4 * std::sqrt(kPercentile * (1 - kPercentile) / static_cast<double>(sample.size()));
  lo_ = order_statistic(&sample, kPercentile - error);
  hi_ = order_statistic(&sample, kPercentile + error);
}

void Sizes::add(const double* d, long n) {
  // Room for all of them, whether they are kept or not.
  if (const auto most = static_cast<size_t>(n_kept_ + n); kept_.size() < most) kept_.resize(most + most / 2);
  Tally tally = {lo_, hi_, largest_, below_, kept_.data() + n_kept_};
  tally_all(d, n, &tally);
  largest_ = tally.largest, below_ = tally.below;
  n_kept_ = tally.kept - kept_.data();
  count_ += n;
}

double Sizes::largest() const {
  return count_ > 0 ? largest_ : 0;
}

std::optional<double> Sizes::percentile() {
  const double place = kPercentile * static_cast<double>(count_ - 1);
  const auto k = static_cast<long>(place);
  const long first = k - below_, second = std::min(k + 1, count_ - 1) - below_;
  if (count_ == 0 || first < 0 || second >= n_kept_) return std::nullopt;
  const auto begin = kept_.begin(), end = begin + n_kept_;
  std::nth_element(begin, begin + first, end);
  const double lower = begin[first];
  const double upper = second > first ? *std::min_element(begin + first + 1, end) : lower;
  return lower + (place - static_cast<double>(k)) * (upper - lower);
}

} // namespace imucal
