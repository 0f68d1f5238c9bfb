// SPDX-License-Identifier: MIT
// Raw logs (host/formats.md, Log) to 1-s means, by the C core's own summation (common/sum.h): the seconds, flags and rounding are
// those of the device.
//
//   # rate_hz = 100
//   # gx_counts_scale_dph = 18
//   t_s,temp_degc,gx_counts,gx_flags
//   0.000,24.81,22,0
// t_s: time of the sample.  A sample with an empty count is left out for all axes (the second is flagged).  A second with
// fewer than half of its samples has no rate.  temp_degc enters the sum as counts of 2^-16 degC; where it is empty the last one
// holds, for a second (sample.h); a second with a sample that has none has no temperature.
#pragma once
#include "io/log.h"
#include "sample.h"
#include "sum.h"

namespace imucal {

class RawDecimator {
public:
  // header: axes named in internal units, to_internal = unit per count; metadata with rate_hz.  data_error otherwise.
  explicit RawDecimator(const Log& header);

  // One sample: begin, counts and flags of the axes, end.  data_error names file, time and column: a count that is no
  // whole number of 32 bits, negative time.
  void begin(double t_s, double temp_degc, long line); // line of the file, for messages
  void counts(size_t axis, double value);
  void flags(size_t axis, int bits);
  void end();
  Log finish();

private:
  [[noreturn]] void refuse(const std::string& problem) const;
  void take(const imucal_second_t& second);

  Log log_;
  imucal_sum_t sum_{};
  imucal_sample_t sample_{};
  double t_s_ = 0;
  long line_ = 0;
  bool is_whole_ = true, has_temperature_ = true; // of the sample
  int32_t temp_counts_ = 0;                       // the last reading, and when it was
  std::optional<double> temp_t_s_;
  bool run_has_temperature_ = true; // of every sample of the running second
};

} // namespace imucal
