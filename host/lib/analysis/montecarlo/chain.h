// SPDX-License-Identifier: MIT
// The calibration as the MCU does it, run by the C core itself: raw counts -> sum -> kf -> table -> comp.
// Nothing of the filter is written here a second time; the only arithmetic is the host's own share (phi, q, r
// of the error model, as `calibrate` sends them) and the reading of results.
//
// Order of calls: construct; push every sample; finish; then read.  One object per run; no sharing between
// threads.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "analysis/montecarlo/whiteness.h"
#include "comp.h"
#include "io/model.h"
#include "learn.h"
#include "physics/sim/raw_samples.h"
#include "sample.h"
#include "sum.h"
#include "table.h"

namespace imucal {

// What host and device agree on before a calibration.
struct ChainSetup {
  ErrorModel filter; // what the filter assumes
  int order = 3;
  double t0_degc = 0, range_degc = 1;
  double span_lo_degc = -1, span_hi_degc = 1; // valid span of the table
  double prior_sigma_dph = kPriorSigma;
  RawFormat raw;             // scales of the counts
  bool is_tracked = false;   // temperature between the steps of a coarse thermometer (common/track.h)
  size_t white_from_s = 0;   // second from which the innovations' whiteness is judged
  bool keeps_seconds = true; // seconds() for whoever asks later
};

// The filter's configuration (analysis/fit/fit.h) with the quantisation of the counts, lsb^2/(12 n), in its white
// noise.
imucal_kf_config_t filter_config(const ChainSetup& setup);

// A second as the filter saw it.
struct SecondMean {
  float z_dph, temp_degc;
  uint32_t gap_s;    // seconds without a measurement just before
  float noise_ratio; // white variance over that of a whole second
};

class CoreChain {
public:
  explicit CoreChain(const ChainSetup& setup);

  void push(const imucal_sample_t& sample);
  void push(const RawSample& sample);
  // A second summed elsewhere to the integers that imucal_sum_add gives, its temperature read by `thermometer`.
  void push(const imucal_second_t& second, const imucal_thermometer_t& thermometer);
  // End of data: last second, table (encoded and decoded again), compensation prepared.  data_error with the
  // core's own words where it refuses.
  void finish();

  const imucal_kf_t& kf() const { return learn_.kf; }
  uint32_t n_seconds(imucal_learn_outcome_t outcome) const { return learn_.n[outcome]; }
  const imucal_sum_t& sum() const { return sum_; }
  const imucal_thermometer_t& thermometer() const { return thermometer_; }
  const imucal_comp_t& comp() const { return comp_; }
  const imucal_table_channel_t& table() const { return table_.channel[0]; }
  const std::vector<SecondMean>& seconds() const { return seconds_; } // none unless keeps_seconds

  // B(T) that the compensation takes out of a sample, by running a zero sample through it.
  double compensated_bias_dph(double temp_degc) const;
  // B(T) of the table's float32 coefficients, in double.
  double table_bias_dph(double temp_degc) const;
  // b0 … bM of the filter's state in double, before rounding to the table's float32.
  std::vector<double> coefficients() const;
  // Covariance of b0 … bM from the filter's factors, in double, row-major [dph^2].
  std::vector<double> coefficient_covariance() const;
  // Whiteness, over the seconds from `white_from_s` on (whiteness.h): sums of e(k) e(k-lag), e = innovation over its
  // standard deviation; number of terms; (sum nu/S)^2 / sum 1/S.
  const double* lag_sums() const { return white_.lag_sums; }
  const int64_t* lag_counts() const { return white_.lag_counts; }
  double mean_innovation2() const {
    return white_.inverse > 0 ? white_.weighted * white_.weighted / white_.inverse : 0.0;
  }

private:
  friend class ChainLanes; // goes on with eight of them
  void take(const imucal_second_t& second);
  float value_of(const imucal_second_t& second) const; // its mean [dph]
  void count_used(const imucal_second_t& second, const imucal_thermometer_t& thermometer, float z_dph);

  ChainSetup setup_;
  imucal_sum_t sum_;
  imucal_thermometer_t thermometer_;
  imucal_learn_t learn_;
  imucal_table_t table_;
  imucal_comp_t comp_;
  std::vector<SecondMean> seconds_;
  size_t n_seconds_ = 0;   // used
  uint32_t n_bridged_ = 0; // seconds bridged before the newest one used
  Whiteness<double, float> white_;
};

} // namespace imucal
