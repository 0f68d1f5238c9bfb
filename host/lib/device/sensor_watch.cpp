// SPDX-License-Identifier: MIT
#include "device/sensor_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/error.h"
#include "base/format.h"
#include "base/median.h"
#include "health.h"
#include "io/log.h"

namespace imucal {

namespace {

constexpr size_t kRateSeconds = 5, kRefuseSeconds = 10;
constexpr double kRateTolerance = 0.1, kRateSlack = 1.5; // part of the nominal rate; samples of a second
constexpr double kMostRate = 2, kLeastRate = 0.5;        // of the nominal one
constexpr uint32_t kStanding_s = 300;                    // one reading for so long
constexpr double kCountsTo = 4e9;                        // samples that a count of 32 bits holds

std::string number(double value) {
  return format(value < 1000 ? "%.4g" : "%.0f", value);
}

} // namespace

std::string rate_text(double seen_hz, double nominal_hz, double slack_hz) {
  const double off_hz = seen_hz - nominal_hz;
  if (std::abs(off_hz) <= std::max(kRateTolerance * nominal_hz, slack_hz)) return "";
  return number(seen_hz) + " samples a second where the board says " + number(nominal_hz) +
         ": rate_hz of the board, or the unit of its time stamps (us), is wrong" +
         (off_hz < 0 ? ", or samples are lost" : "");
}

// The first and the last second may be cut: seconds held samples - nominal .. samples + nominal, at most.
std::string rate_text(const imucal_link_samples_reply_t& counted, double nominal_hz) {
  const double n = counted.seconds;
  if (n < kRateSeconds || n * nominal_hz > kCountsTo) return "";
  const double seen_hz = counted.summed / n;
  return rate_text(seen_hz, nominal_hz,
                   kRateTolerance * nominal_hz + std::max(kRateSlack, std::max(seen_hz, nominal_hz) / n));
}

void SensorWatch::add(const SecondRecord& second) {
  if (has_first_ && samples_.size() < kRefuseSeconds) samples_.push_back(second.n_samples);
  if (!has_first_ || second.temp_degc != temp_degc_) temp_degc_ = second.temp_degc, temp_from_s_ = second.t_s;
  has_first_ = true;
  t_s_ = second.t_s;
  const bool is_usable = !second.is_gap && std::any_of(channels_.begin(), channels_.end(), [&](size_t i) {
    return !(second.flags[i] & (kSaturated | kSensorFault));
  });
  is_faulty_by_samples_ = second.is_gap;
  if (!is_usable && n_faulty_ == 0) faulty_from_s_ = second.t_s;
  n_faulty_ = is_usable ? 0 : n_faulty_ + 1;
}

void SensorWatch::told(uint32_t trouble) {
  if (trouble & IMUCAL_SENSOR_STUCK_TEMP && !stuck_from_s_) stuck_from_s_ = t_s_;
}

std::string SensorWatch::new_rate_warning() {
  if (is_rate_told_ || samples_.size() < kRateSeconds) return "";
  is_rate_told_ = true;
  return rate_text(median({samples_.begin(), samples_.begin() + kRateSeconds}), nominal_hz_, kRateSlack);
}

void SensorWatch::require_rate(const std::string& where) const {
  if (samples_.size() < kRefuseSeconds) return;
  const auto [least, most] = std::minmax_element(samples_.begin(), samples_.end());
  if (*most >= kLeastRate * nominal_hz_ && *least <= kMostRate * nominal_hz_) return;
  const std::string text = rate_text(median(samples_), nominal_hz_, 0);
  throw device_error(where + ": " + text + "; nothing is learnt of such seconds: mend that and start again");
}

void SensorWatch::require_usable(const std::string& where, double patience_s) const {
  if (n_faulty_ < patience_s) return;
  const std::string standing = standing_text();
  throw device_error(where + ": " + standing + (standing.empty() ? "" : "; ") + "from " +
                     std::to_string(faulty_from_s_) + " s on every second is faulty (" +
                     (is_faulty_by_samples_ ? "fewer than half of its samples" : "a fault of the sensor or its rail") +
                     "), " + std::to_string(n_faulty_) +
                     " s by now: the run is ended; mend the sensor and start again (--faulty-s waits longer)");
}

std::string SensorWatch::standing_text() const {
  if (stuck_from_s_)
    return "the sensor's temperature stands still since " + std::to_string(*stuck_from_s_) +
           " s, as the device told: check the thermometer";
  if (degc_per_count_ >= static_cast<double>(IMUCAL_HEALTH_COARSE_DEGC) || t_s_ - temp_from_s_ < kStanding_s) return "";
  char reading[32];
  std::snprintf(reading, sizeof reading, "%.2f", static_cast<double>(temp_degc_));
  return "the thermometer has given " + std::string(reading) + " degC and nothing else since " +
         std::to_string(temp_from_s_) + " s (does it still measure?)";
}

} // namespace imucal
