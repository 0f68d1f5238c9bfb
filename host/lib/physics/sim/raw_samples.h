// SPDX-License-Identifier: MIT
// Raw samples of a simulated (or recorded) gyro: what the sensor's registers would show, at e.g. 100 Hz.
//
// The generator takes 1-s means and makes the samples of that second around them: sample = mean + d_i, where
// the d_i are white noise of standard deviation sigma_1s sqrt(rate) less their own mean.  For white noise
// mean and deviations are independent, so the samples have exactly the model's distribution and their mean is
// the given one: a device fed with them sees the very log that `gyrosim log` writes for the same seed, up to
// quantisation.  Markov processes and temperature are constant within a second (of a 100-s process this omits
// 0.08 dph of 20). Then time stamps get jitter (within their own second), samples go missing, values are
// quantised and saturate.
//
// Quantisation: each value is rounded by itself, as a converter does; with `dithered` the rounding error is
// carried on to the next sample (first-order noise shaping), so that sums come out right within one count
// whatever their length: a recorded log replayed this way is given back with an error of at most one count
// over the rate.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/fast_normal.h"

namespace imucal {

constexpr size_t kMaxRawAxes = 6;

struct RawFormat {
  double rate_hz = 100;
  double counts_scale_dph = 18;   // one count (0.005 deg/s)
  int32_t max_counts = 32767;     // the register saturates at +- this
  double temp_lsb_degc = 0.01;    // one temperature count
  double temp_offset_degc = 25;   // temperature at zero counts
  double temp_noise_degc = 0;     // white, per sample
  double jitter_s = 0;            // standard deviation of the time stamps, cut at 0.4 of the sample interval
  double missing_frac = 0;        // part of the samples that never arrives
  bool dithered = false;          // carry the rounding error from sample to sample
  std::vector<double> axis_scale; // unit per count of each axis where they differ (accelerometers: mg)

  double temp_degc(double counts) const { return temp_offset_degc + temp_lsb_degc * counts; }
  double rate_dph(double counts) const { return counts_scale_dph * counts; }
  double scale(size_t axis) const { return axis < axis_scale.size() ? axis_scale[axis] : counts_scale_dph; }
};

struct RawSample {
  uint64_t t_us = 0; // since the start
  int32_t temp_counts = 0;
  int32_t counts[kMaxRawAxes] = {};
  uint32_t saturated = 0; // bit a: axis a is at its limit
  uint32_t absent = 0;    // bit a: axis a has no value here (its mean was NaN)
};

class RawSampler {
public:
  // run: the address of the random streams (sim::stream_run of the log).  usage_error: bad format.
  RawSampler(const RawFormat& format, size_t n_axes, uint64_t seed, uint64_t run);

  // Append the samples of the second that ends at t_end_s.  mean_dph (NaN: no value) and white_sigma_dph: one
  // per axis; the latter is the standard deviation of white noise in a 1-s mean (0: all samples alike).
  void second(double t_end_s, double temp_degc, const double* mean_dph, const double* white_sigma_dph,
              std::vector<RawSample>* out);

  const RawFormat& format() const { return format_; }
  size_t samples_per_second() const { return n_; }

private:
  RawFormat format_;
  size_t n_axes_, n_;
  std::vector<FastNormal> noise_; // one stream per axis
  FastNormal thermometer_, jitter_, missing_;
  std::vector<double> deviation_;
  std::vector<double> carried_counts_; // rounding error per axis, then of the thermometer
};

} // namespace imucal
