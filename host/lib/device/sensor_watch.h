// SPDX-License-Identifier: MIT
// What the seconds say of the sensor before a run or a recording is over: does it deliver as many samples as the board says,
// can anything be learnt of its seconds at all, does its thermometer stand still.
//
// The rate is the median of the samples of five whole seconds (the first second may be cut).  It is told where it is off the
// nominal one by more than a tenth, and by more than the sample and a half by which jitter and cut seconds move it: healthy
// devices, whose clocks are off by 3 % at most, are never told.  Refused is a rate that ten seconds in a row show to be below
// half or above twice the nominal one.
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
  // nominal_hz: what the board says; channels: those of which something is to be learnt.
  SensorWatch(double nominal_hz, double degc_per_count, std::vector<size_t> channels)
      : nominal_hz_(nominal_hz), degc_per_count_(degc_per_count), channels_(std::move(channels)) {}

  void add(const SecondRecord& second);
  // An event SENSOR_COUNTED with these bits.
  void told(uint32_t trouble);

  // Once, when it is known: the rate is not the board's.  Else empty.
  std::string new_rate_warning();
  // device_error: a rate below half or above twice the nominal one; `where` begins the message.
  void require_rate(const std::string& where) const;
  // device_error: for so many seconds in a row no channel had one to learn from.
  void require_usable(const std::string& where, double patience_s) const;
  // "the sensor's temperature stands still since 660 s …": the device told it, or it gave one reading for minutes up to now.
  // Empty: it moves, or its quantum is too coarse to say.
  std::string standing_text() const;

private:
  double nominal_hz_, degc_per_count_;
  std::vector<size_t> channels_;
  std::vector<double> samples_; // of the first seconds but one
  bool has_first_ = false, is_rate_told_ = false;
  uint32_t t_s_ = 0, n_faulty_ = 0, faulty_from_s_ = 0;
  bool is_faulty_by_samples_ = false; // the last second held too few
  float temp_degc_ = 0;
  uint32_t temp_from_s_ = 0; // this reading, and no other, from then on
  std::optional<uint32_t> stuck_from_s_;
};

// A rate seen against the nominal one, in words; empty: they agree within a tenth or slack_hz.
std::string rate_text(double seen_hz, double nominal_hz, double slack_hz);

// The same by what the device counted since its start (SAMPLES).
std::string rate_text(const imucal_link_samples_reply_t& counted, double nominal_hz);

} // namespace imucal
