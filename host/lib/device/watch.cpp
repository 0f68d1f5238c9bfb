// SPDX-License-Identifier: MIT
#include "device/watch.h"

#include <algorithm>
#include <cstdio>
#include <string>

#include "base/clock.h"
#include "base/error.h"

namespace imucal {

namespace {

constexpr double kSilence_s = 1.0;  // without any record: ask the device whether it is alive
constexpr double kAnswer_s = 1.8;   // from then on, until it counts as gone: 2.8 s in all
constexpr double kStall_s = 2.5;    // of a sensor that has delivered
constexpr double kFirst_s = 30.0;   // until it delivers
constexpr double kCount_s = 0.3;    // how long samples are counted where no second comes
constexpr double kMaxStep_s = 60.0; // of the sensor's clock

std::string seconds_text(double seconds) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g s", seconds);
  return text;
}

} // namespace

Watch::Watch(Device* device, double stall_s)
    : device_(*device), stall_s_(stall_s), last_record_s_(now_s()), last_second_s_(last_record_s_),
      uptime_us_(device->info().uptime_us) {}

void Watch::restarted() const {
  throw device_error(device_.port() + ": the device restarted after " + seconds_text(elapsed_s_) +
                     " of sensor time; check its supply and start again. It keeps its last good table");
}

// It streams no seconds any more.
void Watch::stopped(const imucal_link_info_reply_t& info) const {
  const bool is_idle = info.session == IMUCAL_SESSION_IDLE, has_run_back = info.uptime_us < uptime_us_;
  if (device_.boot_id_now() != device_.hello().boot_id || (is_idle && has_run_back)) restarted();
  const std::string after = device_.port() + ": after " + seconds_text(elapsed_s_) + " of sensor time ";
  if (is_idle)
    throw device_error(after +
                       "the device no longer streams, though it did not restart: another program has stopped it; "
                       "end that program and start again");
  const auto seconds = [](uint64_t time_us) { return seconds_text(static_cast<double>(time_us) * 1e-6); };
  throw device_error(after +
                     "the device stopped the calibration as though no host were there. It did not restart: its " +
                     (has_run_back ? "clock ran back, from " + seconds(uptime_us_) + " to " + seconds(info.uptime_us)
                                   : "clock jumped to " + seconds(info.uptime_us)) +
                     "; time_us of its port must have 64 bits and never step (32 bits of microseconds last 71.6 min)");
}

void Watch::saw(uint8_t id, const imucal_link_any_t& record) {
  last_record_s_ = now_s();
  if (id == IMUCAL_LINK_ID_SECOND) {
    const uint32_t t_s = record.second.t_s;
    elapsed_s_ += !has_second_ || t_s <= t_s_ ? 1.0 : std::min(static_cast<double>(t_s - t_s_), kMaxStep_s);
    t_s_ = t_s;
    has_second_ = true;
    last_second_s_ = last_record_s_;
  } else if (id == IMUCAL_LINK_ID_PROGRESS) {
    has_sensor_ended_ = has_sensor_ended_ || record.progress.session == IMUCAL_SESSION_SENSOR_ENDED;
  } else if (id == IMUCAL_LINK_ID_EVENT && record.event.code == IMUCAL_EVENT_SENSOR_ENDED) {
    has_sensor_ended_ = true;
  } else if (id == IMUCAL_LINK_ID_EVENT && record.event.code == IMUCAL_EVENT_HOST_SILENT) {
    has_stopped_ = true;
  } else if (id == IMUCAL_LINK_ID_EVENT && record.event.code == IMUCAL_EVENT_BOOT) {
    restarted();
  }
}

// A device that has started anew streams events at most.
void Watch::ask() {
  const imucal_link_info_reply_t info = device_.info_within(kAnswer_s);
  last_record_s_ = now_s();
  if (info.session == IMUCAL_SESSION_SENSOR_ENDED) has_sensor_ended_ = true;
  if (!(info.stream_what & IMUCAL_STREAM_SECOND)) stopped(info);
  uptime_us_ = info.uptime_us;
  has_stopped_ = false;
}

bool Watch::are_samples_coming() {
  const std::optional<imucal_link_samples_reply_t> before = device_.samples();
  if (!before) return false;
  const double begin_s = now_s();
  while (now_s() < begin_s + kCount_s) device_.poll(kCount_s);
  return device_.samples()->samples != before->samples;
}

void Watch::check() {
  if (has_sensor_ended_) return;
  const double patience_s = stall_s_ > 0 ? stall_s_ : has_second_ ? kStall_s : kFirst_s;
  const bool is_stalled = now_s() - last_second_s_ > patience_s;
  if (is_stalled || has_stopped_ || now_s() - last_record_s_ > kSilence_s) ask();
  if (!is_stalled || has_sensor_ended_ || now_s() - last_second_s_ <= patience_s) return;
  is_sensor_silent_ = true;
  if (are_samples_coming())
    throw device_error(device_.port() + ": samples come, but no second of them has ended for " +
                       seconds_text(patience_s) +
                       ": are the time stamps of the board in microseconds, and do they run?");
  throw device_error(device_.port() + ": the device answers, but its sensor has delivered nothing for " +
                     seconds_text(patience_s) + "; check the sensor (or start its feed)");
}

} // namespace imucal
