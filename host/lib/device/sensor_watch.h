// SPDX-License-Identifier: MIT
// What the seconds say of the sensor before a run is over: can anything be learnt of its seconds at all, does its thermometer
// stand still.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "device/device.h"

namespace imucal {

constexpr double kFaultyPatience_s = 600;

class SensorWatch {
public:
  // channels: those of which something is to be learnt.
  SensorWatch(double degc_per_count, std::vector<size_t> channels)
      : degc_per_count_(degc_per_count), channels_(std::move(channels)) {}

  void add(const SecondRecord& second);
  // An event SENSOR_COUNTED with these bits.
  void told(uint32_t trouble);

  // device_error, whose message begins with `where`: for so many seconds in a row no channel had one to learn from.
  void require_usable(const std::string& where, double patience_s) const;
  // "the sensor's temperature stands still since 660 s …": the device told it, or it gave one reading for minutes up to now.
  // Empty: it moves, or its quantum is too coarse to say.
  std::string standing_text() const;

private:
  double degc_per_count_;
  std::vector<size_t> channels_;
  bool has_first_ = false;
  uint32_t t_s_ = 0, n_faulty_ = 0, faulty_from_s_ = 0;
  bool is_faulty_by_samples_ = false; // the last second held too few
  float temp_degc_ = 0;
  uint32_t temp_from_s_ = 0; // this reading, and no other, from then on
  std::optional<uint32_t> stuck_from_s_;
};

} // namespace imucal
