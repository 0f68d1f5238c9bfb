// SPDX-License-Identifier: MIT
#include "device/device.h"

#include <algorithm>
#include <cstring>
#include <random>

#include "base/axis_unit.h"
#include "base/clock.h"
#include "base/error.h"
#include "num.h"

namespace imucal {

namespace {

const char* request_name(uint8_t id) {
  switch (id) {
#define NAME_OF(number, name, NAME)                                                                                    \
  case number:                                                                                                         \
    return #NAME;
    IMUCAL_LINK_MESSAGES(NAME_OF)
#undef NAME_OF
  default:
    return "?";
  }
}

// What to do about a refusal, beyond what the status says.
std::string remedy(imucal_status status) {
  switch (status) {
  case IMUCAL_ERR_BUSY:
    return "; a calibration runs: end the program that runs it, or stop it with calibrate stop";
  case IMUCAL_ERR_STALE:
    return "; another program has unlocked the device in the meantime: the port is in use, end that program";
  case IMUCAL_ERR_NO_MARK:
    return "; flash the older table from a file";
  case IMUCAL_ERR_NO_TABLE:
    return "; calibrate the device or flash a table";
  case IMUCAL_ERR_NO_OTHER:
    return "; only one table is in flash";
  case IMUCAL_ERR_SERIAL:
    return "; use the table of this device (calibrate info shows its serial)";
  case IMUCAL_ERR_FLASH:
  case IMUCAL_ERR_VERIFY:
    return ": its driver, the program unit that it declares, or worn cells; a table that ruled before still rules";
  case IMUCAL_ERR_SUPPLY:
    return "; nothing was changed: raise the supply voltage and flash again";
  case IMUCAL_ERR_SLOTS:
    return "; tables are not safe from a power cut: mend erase_bytes or the flash callbacks of the device's firmware";
  case IMUCAL_ERR_GEOMETRY:
    return "; the device's firmware declares flash that no table fits: mend its port (common/store.h, "
           "firmware/README.md)";
  case IMUCAL_ERR_UNKNOWN:
    return "; the firmware does not know this request: update it";
  case IMUCAL_ERR_NOT_LEARNT:
    return "; the filters saw no usable seconds";
  default:
    return "";
  }
}

constexpr uint16_t kUnlock_s = 120;
constexpr double kFlashPatience = 5.0; // erase and program take longer than an answer

} // namespace

static bool is_channel_name(const std::string& name) {
  const std::string stem = axis_stem(name), unit = name.substr(stem.size());
  return !stem.empty() && (unit == "_dph" || unit == "_mg") && std::all_of(name.begin(), name.end(), [](char c) {
    return c > ' ' && c < '\x7F' && !std::strchr(",=#\"'", c);
  });
}

std::string channel_trouble(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "'" : ", '") + printable(name) + "'";
  std::vector<std::string> stems;
  for (const std::string& name : names) {
    const std::string stem = axis_stem(name);
    if (!is_channel_name(name))
      return "'" + printable(name) + "' of its channels " + list + " does not end in its unit";
    if (std::find(stems.begin(), stems.end(), stem) != stems.end())
      return "two of its channels " + list + " are called '" + stem + "' before the unit";
    stems.push_back(stem);
  }
  return "";
}

std::string sensor_trouble(uint32_t detail) {
  static const char* const kNames[IMUCAL_SENSOR_N_COUNTS] = {"another chip answers in the sensor's place",
                                                             "the sensor's bus fails",
                                                             "the sensor's FIFO overran",
                                                             "samples were lost",
                                                             "the sensor sent invalid packets",
                                                             "the sensor reset itself and was set up again",
                                                             "the sensor's temperature stands still",
                                                             "the sensor's data stand still",
                                                             "the supply is too low to program the flash"};
  std::string text;
  for (unsigned i = 0; i < IMUCAL_SENSOR_N_COUNTS; ++i)
    if (detail & 1U << i) text += (text.empty() ? "" : ", ") + std::string(kNames[i]);
  return text.empty() ? "an event of the sensor that this program does not know" : text;
}

Device::Device(std::unique_ptr<Transport> transport, DeviceOptions options)
    : transport_(std::move(transport)), options_(options), sequence_(static_cast<uint8_t>(std::random_device{}())) {
  imucal_link_rx_init(&rx_);
}

std::string Device::serial() const {
  return fixed_text(hello_.serial);
}
std::string Device::channel_name(size_t i) const {
  return fixed_text(channels_.at(i).name);
}

bool Device::receive(double timeout_s, const std::function<bool()>& on_frame) {
  if (pending_at_ == pending_.size()) {
    pending_.resize(4096);
    pending_at_ = 0;
    const size_t n = transport_->read(pending_.data(), pending_.size(), timeout_s);
    pending_.resize(n);
    statistics_.bytes += n;
  }
  while (pending_at_ < pending_.size()) {
    const imucal_status status = imucal_link_rx_put(&rx_, pending_[pending_at_++]);
    statistics_.spoilt = rx_.n_crc + rx_.n_resync + rx_.n_overflow + rx_.n_unknown;
    if (status != IMUCAL_FRAME_READY) continue;
    ++statistics_.frames;
    if (on_frame()) return true;
  }
  return false;
}

void Device::take_stream(uint8_t id, const imucal_link_any_t& record) {
  const int counter = record.event.counter; // the first field of every streamed record
  int& last = last_counter_[id - IMUCAL_LINK_ID_SECOND];
  if (last >= 0) {
    const int step = (counter - last) & 0xFFFF;
    if (step == 0) {
      ++statistics_.doubled_records;
      return;
    }
    if (step < 0x8000) statistics_.lost_records += static_cast<uint64_t>(step - 1);
  }
  last = counter;
  if (handler_) handler_(id, record);
}

static bool is_stream(uint8_t type) {
  return type >= IMUCAL_LINK_ID_SECOND && type <= IMUCAL_LINK_ID_EVENT;
}

bool Device::poll(double timeout_s) {
  const double end_s = now_s() + timeout_s;
  bool came = false;
  do {
    receive(std::max(0.0, end_s - now_s()), [&] {
      const uint8_t type = imucal_link_rx_type(&rx_);
      imucal_link_any_t message;
      if (imucal_link_rx_message(&rx_, &message) != IMUCAL_OK) return false;
      if (is_stream(type)) {
        came = true;
        take_stream(type, message);
      } else {
        ++statistics_.stale_replies;
      }
      return false;
    });
  } while (!came && now_s() < end_s);
  return came;
}

uint8_t Device::await_reply(uint8_t request_id, uint8_t sequence, uint8_t reply_id, double timeout_s,
                            imucal_link_any_t* reply) {
  const double end_s = now_s() + timeout_s;
  uint8_t got = 0;
  const auto on_frame = [&] {
    const uint8_t type = imucal_link_rx_type(&rx_);
    const uint8_t answered = imucal_link_rx_sequence(&rx_);
    if (imucal_link_rx_message(&rx_, reply) != IMUCAL_OK) return false;
    if (is_stream(type)) {
      take_stream(type, *reply);
      return false;
    }
    const bool is_done = type == IMUCAL_LINK_ID_DONE && reply->done.request == request_id;
    const bool is_refusal = is_done && reply->done.status < 0;
    if (answered == sequence && (type == reply_id || is_refusal))
      got = type;
    else
      ++statistics_.stale_replies;
    return got != 0;
  };
  do {
    receive(std::max(0.0, end_s - now_s()), on_frame);
  } while (!got && now_s() < end_s);
  return got;
}

imucal_link_any_t Device::exchange(uint8_t id, const void* message, uint8_t request_id, uint8_t reply_id,
                                   double patience, imucal_status* status) {
  const uint8_t sequence = ++sequence_;
  uint8_t frame[IMUCAL_LINK_MAX_FRAME];
  size_t length = 0;
  if (const imucal_status packed = imucal_link_pack(id, sequence, message, frame, sizeof frame, &length);
      packed != IMUCAL_OK)
    throw device_error(port() + ": " + request_name(request_id) + ": " + imucal_status_text(packed));
  imucal_link_any_t reply;
  for (int attempt = 0; attempt < options_.tries; ++attempt) {
    statistics_.repeated_requests += attempt > 0;
    transport_->write(frame, length, options_.reply_timeout_s * patience);
    const uint8_t type = await_reply(request_id, sequence, reply_id, options_.reply_timeout_s * patience, &reply);
    if (type == 0) continue;
    const bool failed = type == IMUCAL_LINK_ID_DONE && reply.done.status < 0;
    *status = failed ? static_cast<imucal_status>(reply.done.status) : IMUCAL_OK;
    return reply;
  }
  throw device_error(port() + ": the device does not answer (" + request_name(request_id) + " sent " +
                     std::to_string(options_.tries) + " times); check cable, port and baud rate" +
                     (statistics_.bytes == 0 ? ", and that no other program uses the port" : "") +
                     "; restart the device and repeat the command. Its flash still holds the last good table");
}

// STATE brings the challenge, UNLOCK the token; nobody else's is touched unless this succeeds.
void Device::unlock() {
  imucal_link_unlock_t unlock{};
  unlock.challenge = state().challenge;
  std::memcpy(unlock.serial, hello_.serial, sizeof unlock.serial);
  unlock.seconds = kUnlock_s;
  token_ = request(IMUCAL_LINK_ID_UNLOCK, &unlock, IMUCAL_LINK_ID_UNLOCK_REPLY).unlock_reply.token;
  number_ = 0;
}

// A command that was refused may have been done before the device restarted, and its reply lost.
void Device::refuse_restarted(uint8_t id) {
  const uint32_t boot_id = greet().boot_id;
  if (boot_id == hello_.boot_id) return;
  hello_.boot_id = boot_id;
  token_ = 0; // the next command unlocks anew
  throw device_error(port() + ": the device restarted while it was asked for " + request_name(id) +
                     ": it may have been done or not; see what rules now (calibrate info), then repeat the command");
}

imucal_link_any_t Device::request(uint8_t id, const void* message, uint8_t reply_id, double patience,
                                  imucal_status* status) {
  imucal_status outcome = IMUCAL_OK;
  imucal_link_any_t reply;
  if (!imucal_link_is_guarded(id)) {
    reply = exchange(id, message, id, reply_id, patience, &outcome);
  } else {
    if (token_ == 0) unlock();
    for (int attempt = 0; attempt < 2; ++attempt) {
      imucal_link_command_t command{};
      size_t length = 0;
      command.token = token_;
      command.number = ++number_;
      command.request = id;
      if (const imucal_status packed =
              imucal_link_encode(id, message, command.payload, sizeof command.payload, &length);
          packed != IMUCAL_OK)
        throw device_error(port() + ": " + request_name(id) + ": " + imucal_status_text(packed));
      command.length = static_cast<uint8_t>(length);
      reply = exchange(IMUCAL_LINK_ID_COMMAND, &command, id, reply_id, patience, &outcome);
      if (outcome != IMUCAL_ERR_LOCKED && outcome != IMUCAL_ERR_STALE) break;
      refuse_restarted(id);
      if (outcome == IMUCAL_ERR_STALE) break;
      unlock(); // its time was over: nothing was done, so once more
    }
  }
  if (status) *status = outcome;
  if (outcome == IMUCAL_OK || status) return reply;
  throw device_error(port() + ": the device refuses " + request_name(id) + ": " + imucal_status_text(outcome) +
                     (reply.done.detail ? " (detail " + std::to_string(reply.done.detail) + ")" : "") +
                     remedy(outcome));
}

imucal_link_any_t Device::command(uint8_t id, const void* message, double patience) {
  return request(id, message, IMUCAL_LINK_ID_DONE, patience);
}

imucal_link_hello_reply_t Device::greet() {
  imucal_link_hello_t greeting{};
  greeting.protocol = IMUCAL_LINK_PROTOCOL;
  greeting.nonce = std::random_device{}();
  return request(IMUCAL_LINK_ID_HELLO, &greeting, IMUCAL_LINK_ID_HELLO_REPLY).hello_reply;
}

void Device::connect() {
  hello_ = greet();
  if (hello_.protocol != IMUCAL_LINK_PROTOCOL)
    throw device_error(port() + ": the device speaks protocol version " + std::to_string(hello_.protocol) +
                       ", this program " + std::to_string(IMUCAL_LINK_PROTOCOL) + "; update the older one");
  channels_.clear();
  for (uint8_t i = 0; i < hello_.n_channels; ++i) {
    const imucal_link_channel_info_t which{i};
    channels_.push_back(
        request(IMUCAL_LINK_ID_CHANNEL_INFO, &which, IMUCAL_LINK_ID_CHANNEL_INFO_REPLY).channel_info_reply);
  }
  std::vector<std::string> names;
  for (size_t i = 0; i < channels_.size(); ++i) names.push_back(channel_name(i));
  if (const std::string trouble = channel_trouble(names); !trouble.empty())
    throw device_error(port() + ": nothing can be recorded or calibrated of this device: " + trouble +
                       "; give each channel of the board's firmware a name of its own that ends in _dph or _mg "
                       "(gx_dph, ax_mg)");
}

imucal_link_info_reply_t Device::info_within(double within_s) {
  constexpr int kTries = 3;
  const DeviceOptions asked = options_;
  if (asked.reply_timeout_s <= DeviceOptions().reply_timeout_s)
    options_.reply_timeout_s = std::min(asked.reply_timeout_s, within_s / kTries);
  options_.tries = std::min(asked.tries, std::max(1, static_cast<int>(within_s / options_.reply_timeout_s + 1e-9)));
  try {
    const imucal_link_info_reply_t reply = info();
    options_ = asked;
    return reply;
  } catch (...) {
    options_ = asked;
    throw;
  }
}

imucal_link_info_reply_t Device::info() {
  const imucal_link_info_t none{};
  return request(IMUCAL_LINK_ID_INFO, &none, IMUCAL_LINK_ID_INFO_REPLY).info_reply;
}

imucal_link_state_reply_t Device::state() {
  const imucal_link_state_t none{};
  return request(IMUCAL_LINK_ID_STATE, &none, IMUCAL_LINK_ID_STATE_REPLY).state_reply;
}

imucal_link_counters_reply_t Device::counters() {
  const imucal_link_counters_t none{};
  return request(IMUCAL_LINK_ID_COUNTERS, &none, IMUCAL_LINK_ID_COUNTERS_REPLY).counters_reply;
}

std::optional<imucal_link_samples_reply_t> Device::samples() {
  const imucal_link_samples_t none{};
  imucal_status status = IMUCAL_OK;
  const imucal_link_any_t reply = request(IMUCAL_LINK_ID_SAMPLES, &none, IMUCAL_LINK_ID_SAMPLES_REPLY, 1.0, &status);
  if (status == IMUCAL_OK) return reply.samples_reply;
  return std::nullopt;
}

std::optional<imucal_link_sensor_reply_t> Device::sensor() {
  const imucal_link_sensor_t none{};
  imucal_status status = IMUCAL_OK;
  const imucal_link_any_t reply = request(IMUCAL_LINK_ID_SENSOR, &none, IMUCAL_LINK_ID_SENSOR_REPLY, 1.0, &status);
  if (status == IMUCAL_OK && reply.sensor_reply.is_counted) return reply.sensor_reply;
  return std::nullopt;
}

void Device::stream(unsigned what, unsigned innovation_channels, uint16_t progress_period_s) {
  imucal_link_stream_t wanted{};
  wanted.what = static_cast<uint8_t>(what);
  wanted.channels = static_cast<uint8_t>(innovation_channels);
  wanted.period_s = progress_period_s;
  command(IMUCAL_LINK_ID_STREAM, &wanted);
}

void Device::cal_start(const imucal_link_cal_start_t& start) {
  command(IMUCAL_LINK_ID_CAL_START, &start);
}

imucal_link_cal_state_reply_t Device::cal_state(uint8_t channel) {
  const imucal_link_cal_state_t which{channel};
  return request(IMUCAL_LINK_ID_CAL_STATE, &which, IMUCAL_LINK_ID_CAL_STATE_REPLY).cal_state_reply;
}

imucal_link_cal_filter_reply_t Device::cal_filter(uint8_t channel) {
  const imucal_link_cal_filter_t which{channel};
  return request(IMUCAL_LINK_ID_CAL_FILTER, &which, IMUCAL_LINK_ID_CAL_FILTER_REPLY).cal_filter_reply;
}

imucal_link_health_reply_t Device::health(uint8_t channel) {
  const imucal_link_health_t which{channel};
  return request(IMUCAL_LINK_ID_HEALTH, &which, IMUCAL_LINK_ID_HEALTH_REPLY).health_reply;
}

void Device::cal_stop(uint8_t action) {
  const imucal_link_cal_stop_t stop{action};
  command(IMUCAL_LINK_ID_CAL_STOP, &stop);
}

uint32_t Device::table_from_cal(uint32_t created_s) {
  imucal_link_table_from_cal_t make{};
  make.created_s = created_s;
  std::memcpy(make.serial, hello_.serial, sizeof make.serial);
  return command(IMUCAL_LINK_ID_TABLE_FROM_CAL, &make, kFlashPatience).done.detail;
}

std::vector<uint8_t> Device::read_table(uint8_t slot) {
  std::vector<uint8_t> bytes;
  size_t total = 1; // told by the first reply
  while (bytes.size() < total) {
    imucal_link_table_read_t part{};
    part.slot = slot;
    part.offset = static_cast<uint16_t>(bytes.size());
    part.length = static_cast<uint8_t>(
        std::min<size_t>(IMUCAL_LINK_MAX_DATA, bytes.empty() ? IMUCAL_LINK_MAX_DATA : total - bytes.size()));
    const auto reply = request(IMUCAL_LINK_ID_TABLE_READ, &part, IMUCAL_LINK_ID_TABLE_READ_REPLY).table_read_reply;
    total = reply.total;
    if (reply.offset != part.offset || reply.length == 0 || total > IMUCAL_TABLE_MAX_BYTES)
      throw device_error(port() + ": the device sent another part of its table than asked for; restart it");
    bytes.insert(bytes.end(), reply.data, reply.data + reply.length);
  }
  return bytes;
}

uint32_t Device::write_table(const std::vector<uint8_t>& bytes) {
  imucal_link_table_begin_t begin{};
  begin.total = static_cast<uint16_t>(bytes.size());
  begin.crc = imucal_get_u32(bytes.data() + bytes.size() - 4);
  command(IMUCAL_LINK_ID_TABLE_BEGIN, &begin, kFlashPatience);
  for (size_t at = 0; at < bytes.size();) {
    imucal_link_table_data_t data{};
    data.offset = static_cast<uint16_t>(at);
    data.length = static_cast<uint8_t>(std::min<size_t>(IMUCAL_LINK_MAX_DATA, bytes.size() - at));
    std::copy_n(bytes.data() + at, data.length, data.data);
    command(IMUCAL_LINK_ID_TABLE_DATA, &data);
    at += data.length;
  }
  const imucal_link_table_commit_t commit{};
  return command(IMUCAL_LINK_ID_TABLE_COMMIT, &commit, kFlashPatience).done.detail;
}

void Device::rollback() {
  const imucal_link_rollback_t none{};
  command(IMUCAL_LINK_ID_ROLLBACK, &none, kFlashPatience);
}

void Device::erase() {
  const imucal_link_erase_t confirm{IMUCAL_LINK_ERASE_CONFIRM};
  command(IMUCAL_LINK_ID_ERASE, &confirm, kFlashPatience);
}

void Device::reboot() {
  const imucal_link_reboot_t none{};
  command(IMUCAL_LINK_ID_REBOOT, &none);
}

} // namespace imucal
