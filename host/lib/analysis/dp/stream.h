// SPDX-License-Identifier: MIT
// Curves of records of any length in bounded memory: samples are pushed one by one.
//
// Memory: about 40 bytes times max(2^18, 4 (n + history) of the longest tau), whatever the record's length.  The result
// is that of DpRecord::moments on the whole record: the same windows, the same filter (its states are carried over).
#pragma once
#include <vector>

#include "analysis/dp/dp.h"

namespace imucal {

class DpStream {
public:
  DpStream(const DpOperator& op, std::vector<long> n);
  void push(double rate_dph); // NaN: missing
  // The moments so far; blocks are as they came.  Call once, at the end.
  std::vector<DpRecord::Moments> finish();
  long size() const { return start_ + piece_.size(); }

private:
  void work(bool last);

  DpOperator op_;
  std::vector<long> n_, next_t0_; // next window of each n, counted from the record's start
  Series piece_;                  // samples from start_ on
  long start_ = 0, carry_ = 0, capacity_ = 0;
  std::vector<double> states_; // of the nominal filter before piece_
  std::vector<DpRecord::Moments> moments_;
};

} // namespace imucal
