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
  double sum_sq, largest;
  long below, kept;
};

constexpr int64_t kSignless = std::numeric_limits<int64_t>::max();

// Of n values (a multiple of 8): those of |d| within [lo, hi] into `kept`, which has room for n.
IMUCAL_WIDE Tally tally_eights(const double* d, long n, double lo, double hi, double* kept) {
  LaneBits lo_bits, hi_bits, signless = {kSignless, kSignless, kSignless, kSignless};
  const Lanes lo_lanes = {lo, lo, lo, lo}, hi_lanes = {hi, hi, hi, hi};
  std::memcpy(&lo_bits, &lo_lanes, sizeof lo_bits), std::memcpy(&hi_bits, &hi_lanes, sizeof hi_bits);
  LaneBits below0 = {0, 0, 0, 0}, below1 = below0, largest0 = below0, largest1 = below0;
  Lanes s0 = {0, 0, 0, 0}, s1 = s0;
  Tally out = {0, 0, 0, 0};
  for (long k = 0; k < n; k += 8) {
    Lanes d0, d1;
    load_lanes(&d0, d + k), load_lanes(&d1, d + k + 4);
    s0 += d0 * d0, s1 += d1 * d1;
    LaneBits b0, b1;
    std::memcpy(&b0, &d0, sizeof b0), std::memcpy(&b1, &d1, sizeof b1);
    b0 &= signless, b1 &= signless;
    const LaneBits more0 = b0 > largest0, more1 = b1 > largest1;
    largest0 = (b0 & more0) | (largest0 & ~more0), largest1 = (b1 & more1) | (largest1 & ~more1);
    const LaneBits under0 = b0 < lo_bits, under1 = b1 < lo_bits;
    below0 -= under0, below1 -= under1;
    const LaneBits in = (~under0 & (b0 <= hi_bits)) | (~under1 & (b1 <= hi_bits));
    if (((in[0] | in[1]) | (in[2] | in[3])) == 0) continue;
    for (long j = k; j < k + 8; ++j) {
      const double size = std::fabs(d[j]);
      kept[out.kept] = size;
      out.kept += (size >= lo) & (size <= hi);
    }
  }
  const Lanes s = s0 + s1;
  out.sum_sq = (s[0] + s[1]) + (s[2] + s[3]);
  const LaneBits below = below0 + below1;
  out.below = static_cast<long>(below[0] + below[1] + below[2] + below[3]);
  int64_t most = 0;
  for (int l = 0; l < 4; ++l) most = std::max({most, largest0[l], largest1[l]});
  std::memcpy(&out.largest, &most, sizeof most);
  return out;
}

Tally tally_one(double d, double lo, double hi, double* kept) {
  const double size = std::fabs(d);
  *kept = size;
  return {d * d, size, size < lo, size >= lo && size <= hi};
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
  const auto take = [&](const Tally& t) {
    sum_sq_ += t.sum_sq, largest_ = std::max(largest_, t.largest);
    below_ += t.below, n_kept_ += t.kept;
  };
  const long eights = n / 8 * 8;
  take(tally_eights(d, eights, lo_, hi_, kept_.data() + n_kept_));
  for (long k = eights; k < n; ++k) take(tally_one(d[k], lo_, hi_, kept_.data() + n_kept_));
  count_ += n;
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
