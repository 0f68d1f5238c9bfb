// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/chain.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "analysis/fit/factors.h"
#include "analysis/fit/fit.h"
#include "base/error.h"

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
  must(imucal_learn_init(&learn_, &config), "filter");
  imucal_thermometer_init(&thermometer_, static_cast<float>(setup.raw.temp_lsb_degc),
                          static_cast<float>(setup.raw.temp_offset_degc));
  thermometer_.is_tracked = setup.is_tracked;
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

void CoreChain::take(const imucal_second_t& second) {
  imucal_thermometer_read(&thermometer_, &second);
  push(second, thermometer_);
}

float CoreChain::value_of(const imucal_second_t& second) const {
  const int64_t mean_q16 = imucal_mean_q16_rne(second.sum[0], second.n_samples);
  return imucal_unit_from_q16(mean_q16, static_cast<float>(setup_.raw.counts_scale_dph), 0.0f);
}

void CoreChain::push(const imucal_second_t& second, const imucal_thermometer_t& thermometer) {
  const float z_dph = value_of(second);
  if (imucal_learn_second(&learn_, &thermometer, &sum_, &second, 0, z_dph) != IMUCAL_LEARN_USED) return;
  count_used(second, thermometer, z_dph);
  const imucal_kf_stats_t& stats = learn_.kf.stats;
  if (n_seconds_ > setup_.white_from_s) white_.keep(stats.innovation, stats.innovation_weight);
}

void CoreChain::count_used(const imucal_second_t& second, const imucal_thermometer_t& thermometer, float z_dph) {
  const uint32_t n_bridged = learn_.kf.stats.n_missed;
  if (setup_.keeps_seconds)
    seconds_.push_back(
        {z_dph, thermometer.temp_degc, n_bridged - n_bridged_, imucal_sum_noise_ratio(&sum_, &second, 0)});
  n_bridged_ = n_bridged;
  ++n_seconds_;
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
  must(imucal_table_from_kf(&channel, &learn_.kf, static_cast<float>(setup_.span_lo_degc),
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
  const double tn = (temp_degc - static_cast<double>(table().t0_degc)) / static_cast<double>(table().range_degc);
  double sum = 0;
  for (size_t i = IMUCAL_MAX_COEFF; i-- > 0;) sum = sum * tn + static_cast<double>(table().coeff[i]);
  return sum;
}

std::vector<double> CoreChain::coefficients() const {
  const Eigen::VectorXd b = power_from_chebyshev(learn_.kf.config.order) * factors_of(learn_.kf).coeff();
  return {b.data(), b.data() + b.size()};
}

std::vector<double> CoreChain::coefficient_covariance() const {
  const Eigen::MatrixXd to_power = power_from_chebyshev(learn_.kf.config.order);
  const Eigen::MatrixXd cov = to_power * factors_of(learn_.kf).covariance() * to_power.transpose();
  return {cov.data(), cov.data() + cov.size()};
}

} // namespace imucal
