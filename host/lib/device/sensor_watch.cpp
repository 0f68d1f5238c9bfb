// SPDX-License-Identifier: MIT
#include "device/sensor_watch.h"

#include <algorithm>
#include <cstdio>

#include "base/error.h"
#include "health.h"
#include "io/log.h"

namespace imucal {

namespace {

constexpr uint32_t kStanding_s = 300; // one reading for so long

} // namespace

void SensorWatch::add(const SecondRecord& second) {
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

void SensorWatch::require_usable(const std::string& where, double patience_s) const {
  if (n_faulty_ < patience_s) return;
  const std::string standing = standing_text();
  throw device_error(where + ": " + standing + (standing.empty() ? "" : "; ") + "from " + std::to_string(faulty_from_s_) +
                     " s on every second is faulty (" +
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
