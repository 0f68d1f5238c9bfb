// SPDX-License-Identifier: MIT
// Is the device still doing what it was told to: streaming seconds, with a sensor that delivers?  For every program that
// listens for long.  A restart is noticed by its BOOT event, or by asking after 1 s of silence, a device that does not
// answer then is gone 1.8 s later; a sensor that stops after
// 2.5 s (before its first second it may take 30 s: a feed that is yet to be started).
// A device that no longer streams has restarted only where the number of its start is another one, or where it is idle and
// its uptime began anew.  Else its clock jumped, so that it took the host for silent, or another program stopped it.
#pragma once
#include <cstdint>

#include "device/device.h"

namespace imucal {

class Watch {
public:
  // stall_s: how long the sensor may deliver nothing; 0: as above.  The device is connected; it is asked for its uptime.
  Watch(Device* device, double stall_s);

  // Every streamed record.  device_error: the device restarted.
  void saw(uint8_t id, const imucal_link_any_t& record);

  // Between two polls.  device_error: restarted, stopped, silent, or its sensor delivers nothing (then is_sensor_silent).
  void check();

  bool has_sensor_ended() const { return has_sensor_ended_; }
  bool is_sensor_silent() const { return is_sensor_silent_; } // the device itself answers
  // Seconds of sensor time so far; a step of the clock counts at most a minute.
  double elapsed_s() const { return elapsed_s_; }

private:
  void ask();
  bool are_samples_coming();
  [[noreturn]] void restarted() const;
  [[noreturn]] void stopped(const imucal_link_info_reply_t& info) const;

  Device& device_;
  double stall_s_;
  double last_record_s_, last_second_s_; // of this machine's clock
  double elapsed_s_ = 0;
  uint64_t uptime_us_;
  uint32_t t_s_ = 0;
  bool has_stopped_ = false; // the device says that it heard no host
  bool has_second_ = false, has_sensor_ended_ = false, is_sensor_silent_ = false;
};

} // namespace imucal
