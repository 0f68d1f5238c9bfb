// SPDX-License-Identifier: MIT
#include "analysis/dp/stream.h"

#include <algorithm>
#include <cmath>

namespace imucal {

DpStream::DpStream(const DpOperator& op, std::vector<long> n)
    : op_(op), n_(std::move(n)), states_(op.filter.size(), 0.0), moments_(n_.size()) {
  for (long steps : n_) {
    next_t0_.push_back(op.history_n(steps));
    carry_ = std::max(carry_, steps + op.history_n(steps));
  }
  capacity_ = std::max(1L << 18, 4 * carry_);
  piece_.dt_s = op.dt_s;
  piece_.rate_dph.reserve(static_cast<size_t>(capacity_));
}

void DpStream::push(double rate_dph) {
  piece_.n_missing += std::isnan(rate_dph);
  piece_.rate_dph.push_back(rate_dph);
  if (piece_.size() == capacity_) work(false);
}

void DpStream::work(bool last) {
  std::vector<long> first;
  for (long t0 : next_t0_) first.push_back(t0 - start_);
  const auto fresh = DpRecord(piece_, op_, states_).moments(n_, first);
  for (size_t i = 0; i < n_.size(); ++i) {
    // Blocks only matter where the record is short; long ones are joined so that memory stays bounded.
    auto& m = moments_[i];
    const bool join = m.count.size() > 4096;
    for (size_t b = 0; b < fresh[i].count.size(); ++b) {
      if (join) {
        m.sum_sq.back() += fresh[i].sum_sq[b], m.count.back() += fresh[i].count[b];
      } else {
        m.sum_sq.push_back(fresh[i].sum_sq[b]), m.count.push_back(fresh[i].count[b]);
      }
    }
    next_t0_[i] = std::max(next_t0_[i], size() - n_[i] + 1);
  }
  if (last) return;
  const long drop = piece_.size() - carry_;
  for (long k = 0; k < drop; ++k) {
    const double y = piece_.rate_dph[static_cast<size_t>(k)];
    double predicted = 0;
    for (size_t i = 0; i < states_.size(); ++i) predicted += states_[i] *= op_.filter.phi[i];
    if (std::isnan(y)) {
      --piece_.n_missing;
      continue;
    }
    for (size_t i = 0; i < states_.size(); ++i) states_[i] += op_.filter.gain[i] * (y - predicted);
  }
  piece_.rate_dph.erase(piece_.rate_dph.begin(), piece_.rate_dph.begin() + drop);
  start_ += drop;
}

std::vector<DpRecord::Moments> DpStream::finish() {
  work(true);
  return std::move(moments_);
}

} // namespace imucal
