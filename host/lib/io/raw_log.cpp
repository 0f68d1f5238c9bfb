// SPDX-License-Identifier: MIT
#include "io/raw_log.h"

#include <charconv>
#include <cmath>
#include <limits>

#include "base/error.h"

namespace imucal {

namespace {
constexpr double kTempCountsPerDegc = 65536;
constexpr double kMaxRawTempDegc = 10000;
constexpr double kTemperatureHolds_s = 1 + 1e-6; // a second, and a clock's rounding
constexpr float kMaxRate = 1e12F;                // as in a log of means
} // namespace

RawDecimator::RawDecimator(const Log& header) : log_(header) {
  const auto rate = log_.metadata.find("rate_hz");
  if (rate == log_.metadata.end())
    throw data_error(log_.path + ": a raw log needs its sample rate: \"# rate_hz = 100\"");
  double rate_hz = 0;
  const char* last = rate->second.data() + rate->second.size();
  const auto parsed = std::from_chars(rate->second.data(), last, rate_hz);
  if (parsed.ec != std::errc() || parsed.ptr != last || !(rate_hz >= 1) || rate_hz > IMUCAL_SUM_MAX_RATE_HZ)
    throw data_error(log_.path + ": # rate_hz: expected 1.." + std::to_string(IMUCAL_SUM_MAX_RATE_HZ) + ", found \"" +
                     rate->second + "\"");
  if (log_.axes.size() > IMUCAL_MAX_CHANNELS)
    throw data_error(log_.path + ": a raw log has at most " + std::to_string(IMUCAL_MAX_CHANNELS) + " axes");
  const imucal_status status =
      imucal_sum_init(&sum_, static_cast<uint32_t>(log_.axes.size()), static_cast<uint32_t>(std::lround(rate_hz)));
  if (status != IMUCAL_OK) throw data_error(log_.path + ": " + imucal_status_text(status));
}

void RawDecimator::refuse(const std::string& problem) const {
  throw data_error(log_.path + ":" + std::to_string(line_) + ": sample at t_s = " + std::to_string(t_s_) + ": " +
                   problem);
}

void RawDecimator::begin(double t_s, double temp_degc, long line) {
  t_s_ = t_s;
  line_ = line;
  if (!(t_s >= 0) || t_s >= 4294967295.0) refuse("the time must be in 0..4294967295 s");
  sample_ = {};
  sample_.t_us = static_cast<uint64_t>(std::llround(t_s * 1e6));
  sample_.n_channels = static_cast<uint8_t>(log_.axes.size());
  is_whole_ = true;
  if (std::abs(temp_degc) > kMaxRawTempDegc) refuse("temp_degc is out of range");
  if (std::isfinite(temp_degc)) {
    temp_counts_ = static_cast<int32_t>(std::lround(temp_degc * kTempCountsPerDegc));
    temp_t_s_ = t_s;
  }
  has_temperature_ = temp_t_s_ && t_s - *temp_t_s_ <= kTemperatureHolds_s;
  if (has_temperature_) sample_.temp_counts = temp_counts_;
}

void RawDecimator::counts(size_t axis, double value) {
  if (std::isnan(value)) {
    is_whole_ = false;
    return;
  }
  if (value != std::floor(value) || value < INT32_MIN || value > INT32_MAX)
    refuse("axis " + log_.axes[axis].name + ": counts are whole numbers of 32 bits, found " + std::to_string(value));
  sample_.counts[axis] = static_cast<int32_t>(value);
}

void RawDecimator::flags(size_t axis, int bits) {
  const auto bit = static_cast<uint8_t>(1U << axis);
  if (bits & kSaturated) sample_.saturated = static_cast<uint8_t>(sample_.saturated | bit);
  if (bits & kSensorFault) sample_.fault = static_cast<uint8_t>(sample_.fault | bit);
  if (bits & kSamplesMissing) is_whole_ = false;
}

void RawDecimator::end() {
  if (!is_whole_) return;
  imucal_second_t second;
  const imucal_status status = imucal_sum_add(&sum_, &sample_, &second);
  if (status == IMUCAL_SECOND_READY) take(second);
  if (status < 0) refuse(imucal_status_text(status));
  run_has_temperature_ = run_has_temperature_ && has_temperature_;
}

void RawDecimator::take(const imucal_second_t& second) {
  log_.t_s.push_back(second.t_s);
  log_.line.push_back(static_cast<uint32_t>(line_));
  const double temp_counts = static_cast<double>(imucal_mean_q16_rne(second.temp_sum, second.n_samples)) / 65536;
  log_.temp_degc.push_back(run_has_temperature_ ? temp_counts / kTempCountsPerDegc
                                                : std::numeric_limits<double>::quiet_NaN());
  run_has_temperature_ = true;
  for (size_t a = 0; a < log_.axes.size(); ++a) {
    LogAxis& axis = log_.axes[a];
    const float rate = imucal_unit_from_q16(imucal_mean_q16_rne(second.sum[a], second.n_samples),
                                            static_cast<float>(axis.to_internal), 0.0F);
    if (!second.is_gap && !(std::abs(rate) <= kMaxRate))
      refuse("axis " + axis.name +
             ": a mean beyond +-1e12, as no rate is: mend its counts or their scale in the header");
    axis.rate_dph.push_back(second.is_gap ? std::numeric_limits<double>::quiet_NaN() : static_cast<double>(rate));
    axis.flags.push_back(second.flags[a]);
    axis.noise_ratio.push_back(imucal_sum_noise_ratio(&sum_, &second, static_cast<uint32_t>(a)));
  }
}

Log RawDecimator::finish() {
  imucal_second_t second;
  if (imucal_sum_flush(&sum_, &second) == IMUCAL_SECOND_READY) take(second);
  for (LogAxis& axis : log_.axes) axis.to_internal = 1;
  if (log_.t_s.empty()) throw data_error(log_.path + ": no whole sample");
  return std::move(log_);
}

} // namespace imucal
