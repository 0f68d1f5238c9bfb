// SPDX-License-Identifier: MIT
// A device at the other end of a transport: requests with sequence numbers and repetition, streamed records
// with their losses counted.  The frames are made and read by common/link.c, the very code the device runs.
//
// A request is repeated when no reply comes in time; the device answers a repetition from the reply it kept,
// so that nothing is done twice.  A device that stays silent through all repetitions ends in device_error,
// never in a hang. Noise on the line costs the frames it touches: those of requests are repeated, those of
// streams are counted lost.
//
// A request that changes anything goes out inside COMMAND.  The device is unlocked for it when first needed, by the serial
// number it told, and again when the time is over; where another program unlocked it since, that is an error, not a race.
// So it is where the device restarted: nobody knows whether a command whose reply was lost was done.
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "device/transport.h"
#include "link.h"
#include "table.h"

namespace imucal {

struct DeviceOptions {
  double reply_timeout_s = 1.0; // of one try
  int tries = 6;                // of one request, the first included
};

// What happened on the line since it was opened.
struct LinkStatistics {
  uint64_t bytes = 0, frames = 0; // received
  uint64_t spoilt = 0;            // frames dropped: wrong CRC, malformed, too long, of unknown type
  uint64_t repeated_requests = 0; // tries beyond the first
  uint64_t stale_replies = 0;     // replies to an earlier try or an earlier program
  uint64_t lost_records = 0;      // streamed records that never came, by their counters
  uint64_t doubled_records = 0;   // records received twice
};

// One finished second, as streamed.
using SecondRecord = imucal_link_second_t;

// What an event SENSOR_COUNTED says, by its detail (IMUCAL_SENSOR_*): "the sensor's bus failed, the FIFO overran".
std::string sensor_trouble(uint32_t detail);

class Device {
public:
  // Called for every streamed record while a request or `poll` waits: id is IMUCAL_LINK_ID_SECOND, …
  // It must not send requests itself.
  using StreamHandler = std::function<void(uint8_t id, const imucal_link_any_t& record)>;

  explicit Device(std::unique_ptr<Transport> transport, DeviceOptions options = {});

  // Greets the device, reads name, serial, channels; changes nothing.
  // device_error: silent, of another protocol version, or with channels of which no log can be made (channel_trouble).
  void connect();

  const imucal_link_hello_reply_t& hello() const { return hello_; }
  const std::vector<imucal_link_channel_info_reply_t>& channels() const { return channels_; }
  std::string serial() const;
  std::string channel_name(size_t i) const;
  const std::string& port() const { return transport_->name(); }
  const char* port_kind() const { return transport_->kind(); }
  const LinkStatistics& statistics() const { return statistics_; }

  void on_stream(StreamHandler handler) { handler_ = std::move(handler); }

  imucal_link_info_reply_t info();
  // The number of the device's start, asked for again: another one than hello().boot_id after a restart.
  uint32_t boot_id_now() { return greet().boot_id; }
  // The same in a hurry: all tries together last about within_s.  A longer wait for one reply than the default was asked
  // for by the user (a slow line) and stays.
  imucal_link_info_reply_t info_within(double within_s);
  imucal_link_counters_reply_t counters();
  imucal_link_state_reply_t state();
  // What became of the samples since the device's start; nothing: older firmware, which does not count them.
  std::optional<imucal_link_samples_reply_t> samples();
  // What sensor and supply met since the device's start; nothing: older firmware, or a board that does not count it.
  std::optional<imucal_link_sensor_reply_t> sensor();
  void stream(unsigned what, unsigned innovation_channels, uint16_t progress_period_s);

  void cal_start(const imucal_link_cal_start_t& start);
  imucal_link_cal_state_reply_t cal_state(uint8_t channel);
  imucal_link_cal_filter_reply_t cal_filter(uint8_t channel);
  // The device's verdict on a channel that calibrates (common/health.h).
  imucal_link_health_reply_t health(uint8_t channel);
  void cal_stop(uint8_t action);
  // The device makes a table of its filters and flashes it; returns the table's sequence number.
  uint32_t table_from_cal(uint32_t created_s);

  // Bytes of the table in a slot (IMUCAL_LINK_SLOT_RULING: the ruling one); device_error: none there.
  std::vector<uint8_t> read_table(uint8_t slot = IMUCAL_LINK_SLOT_RULING);
  // Sends, flashes, and returns the sequence number.  The device checks the table before it touches its
  // flash.
  uint32_t write_table(const std::vector<uint8_t>& bytes);
  void rollback();
  void erase();
  void reboot();

  // Receives for up to timeout_s, or until at least one frame came; false: nothing came.
  bool poll(double timeout_s);

  // One request and its reply.  A DONE with a negative status becomes device_error, unless `status` is given:
  // then it is left there and the reply is not to be used.
  imucal_link_any_t request(uint8_t id, const void* message, uint8_t reply_id, double patience = 1.0,
                            imucal_status* status = nullptr);

private:
  imucal_link_any_t command(uint8_t id, const void* message, double patience = 1.0);
  imucal_link_hello_reply_t greet();
  void unlock();
  void refuse_restarted(uint8_t id);
  imucal_link_any_t exchange(uint8_t id, const void* message, uint8_t request_id, uint8_t reply_id, double patience,
                             imucal_status* status);
  bool receive(double timeout_s, const std::function<bool()>& on_frame);
  void take_stream(uint8_t id, const imucal_link_any_t& record);
  // Type of the reply that came (reply_id, or DONE with a refusal); 0: none in time.
  uint8_t await_reply(uint8_t request_id, uint8_t sequence, uint8_t reply_id, double timeout_s,
                      imucal_link_any_t* reply);

  std::unique_ptr<Transport> transport_;
  DeviceOptions options_;
  imucal_link_rx_t rx_;
  std::vector<uint8_t> pending_; // received, not yet looked at
  size_t pending_at_ = 0;
  uint8_t sequence_;
  uint32_t token_ = 0, number_ = 0; // of the running unlock; 0: none yet
  imucal_link_hello_reply_t hello_{};
  std::vector<imucal_link_channel_info_reply_t> channels_;
  int last_counter_[4] = {-1, -1, -1, -1}; // per stream
  LinkStatistics statistics_;
  StreamHandler handler_;
};

// Why no log or table can be made of a device with these channels, with the names; empty: it can.  A name ends in its unit
// (_dph, _mg) with something before it; stems name the columns of the flags, so that none comes twice; what separates the
// fields of a log (comma, =, #, quotation marks, blanks, what does not print) is in no name.
std::string channel_trouble(const std::vector<std::string>& names);

// Text of a fixed-size field.
template <size_t N> std::string fixed_text(const char (&field)[N]) {
  size_t n = 0;
  while (n < N && field[n]) ++n;
  return std::string(field, n);
}

} // namespace imucal
