// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/chain.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/error.h"
#include "analysis/fit/factors.h"
#include "analysis/fit/fit.h"

namespace imucal {

static void must(imucal_status status, const char* doing) {
  if (status < 0) throw data_error(std::string(doing) + ": the core says: " + imucal_status_text(status));
}

imucal_kf_config_t filter_config(const ChainSetup& setup) {
  const double lsb = setup.raw.counts_scale_dph;
  return kf_config(setup.filter, setup.order, setup.t0_degc, setup.range_degc, setup.prior_sigma_dph, 1.0,
                   lsb * lsb / 12 / setup.raw.rate_hz);
}

CoreChain::CoreChain(const ChainSetup& setup) : setup_(setup) {
  must(imucal_sum_init(&sum_, 1, static_cast<uint32_t>(setup.raw.rate_hz)), "1-s sums");
  const imucal_kf_config_t config = filter_config(setup);
  must(imucal_kf_init(&kf_, &config), "filter");
  imucal_track_init(&track_);
  std::memset(&table_, 0, sizeof table_);
  std::memset(&comp_, 0, sizeof comp_);
}

void CoreChain::push(const imucal_sample_t& sample) {
  imucal_second_t second;
  if (imucal_sum_add(&sum_, &sample, &second) == IMUCAL_SECOND_READY) take(second);
}

void CoreChain::push(const RawSample& raw) {
  imucal_sample_t sample;
  sample.t_us = raw.t_us;
  sample.temp_counts = raw.temp_counts;
  sample.counts[0] = raw.counts[0];
  sample.n_channels = 1;
  sample.saturated = raw.saturated & 1u;
  sample.fault = 0;
  push(sample);
}

void CoreChain::bridge(uint32_t n_s) {
  must(imucal_kf_skip(&kf_, n_s), "filter, gap");
  gap_s_ += n_s;
}

void CoreChain::take(const imucal_second_t& second) {
  bridge(second.n_skipped);
  imucal_track_skip(&track_, second.n_skipped);
  int64_t temp_q16 = imucal_mean_q16_rne(second.temp_sum, second.n_samples);
  if (setup_.is_tracked) temp_q16 = imucal_track_update(&track_, temp_q16);
  const uint32_t bad = second.flags[0] & (IMUCAL_FLAG_SATURATED | IMUCAL_FLAG_FAULT);
  if (second.is_gap || bad || (setup_.is_tracked && !track_.is_sure)) return bridge(1);
  const auto scale = static_cast<float>(setup_.raw.counts_scale_dph);
  const auto degc = static_cast<float>(setup_.raw.temp_lsb_degc),
             zero = static_cast<float>(setup_.raw.temp_offset_degc);
  const float z_dph = imucal_unit_from_q16(imucal_mean_q16_rne(second.sum[0], second.n_samples), scale, 0.0f);
  const float temp_degc = imucal_unit_from_q16(temp_q16, degc, zero);
  const float noise_ratio = imucal_sum_noise_ratio(&sum_, &second, 0);
  if (imucal_kf_update_scaled(&kf_, z_dph, temp_degc, noise_ratio) != IMUCAL_OK)
    return bridge(1); // refused and counted by the filter
  seconds_.push_back({z_dph, temp_degc, gap_s_, noise_ratio});
  gap_s_ = 0;
  keep_innovation();
}

void CoreChain::keep_innovation() {
  if (seconds_.size() <= setup_.white_from_s) return;
  const float inverse = kf_.stats.innovation_weight;
  const float e = kf_.stats.innovation * std::sqrt(inverse);
  weighted_ += static_cast<double>(kf_.stats.innovation * inverse);
  inverse_ += static_cast<double>(inverse);
  for (size_t i = 0; i < kInnovationLagCount; ++i) {
    const auto lag = static_cast<uint64_t>(kInnovationLags[i]);
    if (n_innovations_ < lag) break;
    lag_sums_[i] += static_cast<double>(e) * static_cast<double>(ring_[(n_innovations_ - lag) % kRing]);
    ++lag_counts_[i];
  }
  ring_[n_innovations_++ % kRing] = e;
}

void CoreChain::finish() {
  imucal_second_t last;
  if (imucal_sum_flush(&sum_, &last) == IMUCAL_SECOND_READY) take(last);
  imucal_table_t made;
  std::memset(&made, 0, sizeof made);
  must(imucal_text_set(made.serial, sizeof made.serial, "SIMULATED"), "table");
  made.sequence = 1;
  made.n_channels = 1;
  made.degc_per_count = static_cast<float>(setup_.raw.temp_lsb_degc);
  made.degc_at_zero = static_cast<float>(setup_.raw.temp_offset_degc);
  imucal_table_channel_t& channel = made.channel[0];
  must(imucal_table_from_kf(&channel, &kf_, static_cast<float>(setup_.span_lo_degc),
                            static_cast<float>(setup_.span_hi_degc)),
       "table");
  must(imucal_text_set(channel.name, sizeof channel.name, "gx_dph"), "table");
  channel.unit_per_count = static_cast<float>(setup_.raw.counts_scale_dph);
  channel.full_scale_counts = setup_.raw.max_counts;
  channel.arw = static_cast<float>(setup_.filter.arw_deg_rt_h);
  for (const Markov& m : setup_.filter.markov) {
    if (channel.n_markov == IMUCAL_TABLE_MARKOV_N) break;
    channel.markov_sigma[channel.n_markov] = static_cast<float>(m.sigma_dph);
    channel.markov_tau_s[channel.n_markov++] = static_cast<float>(m.tau_s);
  }
  // Through the bytes that would be in flash.
  uint8_t bytes[IMUCAL_TABLE_MAX_BYTES];
  size_t n_bytes = 0;
  must(imucal_table_encode(&made, bytes, sizeof bytes, &n_bytes), "table");
  must(imucal_table_decode(bytes, n_bytes, &table_, nullptr), "table");
  must(imucal_comp_prepare(&comp_, &table_, 0), "compensation");
}

double CoreChain::compensated_bias_dph(double temp_degc) const {
  const double counts = (temp_degc - setup_.raw.temp_offset_degc) / setup_.raw.temp_lsb_degc;
  uint32_t flags = 0;
  const int32_t out = imucal_comp_apply(&comp_, static_cast<int32_t>(std::lround(counts)), 0, &flags);
  return -static_cast<double>(out) * static_cast<double>(comp_.unit_per_lsb);
}

double CoreChain::table_bias_dph(double temp_degc) const {
  const double tn =
      (temp_degc - static_cast<double>(table().t0_degc)) / static_cast<double>(table().range_degc);
  double sum = 0;
  for (size_t i = IMUCAL_MAX_COEFF; i-- > 0;) sum = sum * tn + static_cast<double>(table().coeff[i]);
  return sum;
}

std::vector<double> CoreChain::coefficients() const {
  const Eigen::VectorXd b = power_from_chebyshev(kf_.config.order) * factors_of(kf_).coeff();
  return {b.data(), b.data() + b.size()};
}

std::vector<double> CoreChain::coefficient_covariance() const {
  const Eigen::MatrixXd to_power = power_from_chebyshev(kf_.config.order);
  const Eigen::MatrixXd cov = to_power * factors_of(kf_).covariance() * to_power.transpose();
  return {cov.data(), cov.data() + cov.size()};
}

} // namespace imucal
