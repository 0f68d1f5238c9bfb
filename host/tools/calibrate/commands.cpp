// SPDX-License-Identifier: MIT
#include "calibrate/commands.h"

#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <optional>

#include "analysis/fit/judge.h"
#include "base/clock.h"
#include "base/progress.h"
#include "calibrate/fit_json.h"
#include "cli/text.h"
#include "device/recorder.h"
#include "device/sensor_watch.h"
#include "device/watch.h"
#include "io/notice.h"
#include "io/table_json.h"

namespace imucal {

namespace {

const char* status_text(int status) {
  return imucal_status_text(static_cast<imucal_status>(status));
}

const char* session_text(unsigned session) {
  switch (session) {
  case IMUCAL_SESSION_IDLE:
    return "idle";
  case IMUCAL_SESSION_CALIBRATING:
    return "calibrating";
  case IMUCAL_SESSION_KEPT:
    return "calibration stopped, filters kept";
  case IMUCAL_SESSION_SENSOR_ENDED:
    return "the sensor ended while calibrating";
  default:
    return "unknown";
  }
}

const char* origin_text(unsigned origin) {
  switch (origin) {
  case IMUCAL_ORIGIN_NONE:
    return "none";
  case IMUCAL_ORIGIN_FILTERS:
    return "of the device's filters";
  case IMUCAL_ORIGIN_HOST:
    return "flashed by a host";
  case IMUCAL_ORIGIN_ROLLBACK:
    return "rolled back to";
  default:
    return "unknown";
  }
}

std::string hex(uint32_t value) {
  char text[12];
  std::snprintf(text, sizeof text, "%08X", value);
  return text;
}

std::string utc_text(uint32_t time_s) {
  const std::time_t time = time_s;
  std::tm fields{};
  char text[32];
  ::gmtime_r(&time, &fields);
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%S UTC", &fields);
  return text;
}

// What the device did not do, by reason.
Json refused_json(const imucal_link_state_reply_t& state) {
  return {{"locked", state.refused_locked},     {"stale", state.refused_stale},
          {"unlock", state.refused_unlock},     {"busy", state.refused_busy},
          {"reserved", state.refused_reserved}, {"table", state.refused_table},
          {"flash_failed", state.flash_failed}, {"sessions_silent", state.sessions_silent}};
}

Json link_json(const Device& device) {
  const LinkStatistics& s = device.statistics();
  return {{"bytes", s.bytes},
          {"frames", s.frames},
          {"spoilt_frames", s.spoilt},
          {"repeated_requests", s.repeated_requests},
          {"stale_replies", s.stale_replies},
          {"lost_records", s.lost_records},
          {"doubled_records", s.doubled_records}};
}

Json device_json(const Device& device) {
  const imucal_link_hello_reply_t& hello = device.hello();
  return {{"port", device.port()},
          {"device", fixed_text(hello.device)},
          {"firmware", fixed_text(hello.firmware)},
          {"serial", device.serial()},
          {"rate_hz", static_cast<double>(hello.rate_hz)}};
}

Json counters_json(const imucal_link_counters_reply_t& c) {
  return {{"rx_frames", c.rx_frames},
          {"rx_crc", c.rx_crc},
          {"rx_resync", c.rx_resync},
          {"rx_overflow", c.rx_overflow},
          {"rx_unknown", c.rx_unknown},
          {"rx_repeated", c.rx_repeated},
          {"tx_dropped", c.tx_dropped},
          {"samples", c.samples},
          {"duplicates", c.duplicates},
          {"backward", c.backward},
          {"jumps", c.jumps},
          {"feed_errors", c.feed_errors},
          {"seconds", c.seconds},
          {"gaps", c.gaps},
          {"filter_refused", c.filter_refused},
          {"watchdog_resets", c.watchdog_resets}};
}

// Losses on the line, where there were any: nothing is dropped in silence.
void tell_losses(const Device& device) {
  const LinkStatistics& s = device.statistics();
  if (s.lost_records == 0 && s.spoilt == 0 && s.repeated_requests == 0) return;
  std::printf("line: %llu spoilt frames, %llu records lost, %llu requests repeated\n",
              static_cast<unsigned long long>(s.spoilt), static_cast<unsigned long long>(s.lost_records),
              static_cast<unsigned long long>(s.repeated_requests));
}

Json samples_json(const imucal_link_samples_reply_t& n) {
  return {{"delivered", n.samples},     {"summed", n.summed},       {"duplicates", n.duplicates},
          {"behind", n.behind},         {"ahead", n.ahead},         {"refused", n.refused},
          {"unreadable", n.unreadable}, {"clock_set", n.clock_set}, {"clock_wrapped", n.clock_wrapped},
          {"jumps", n.jumps},           {"seconds", n.seconds},     {"gaps", n.gaps}};
}

// Samples that were left out and clocks that jumped, where there were any: nothing is dropped in silence.
void tell_samples(const imucal_link_samples_reply_t& n) {
  if (n.samples == n.summed && n.unreadable + n.clock_set + n.clock_wrapped + n.jumps == 0) return;
  std::printf(
      "samples: %u delivered, %u left out (%u doubled, %u behind, %u ahead, %u refused), %u unreadable; the clock "
      "was set back %u times, wrapped %u times, jumped by a second or more %u times\n",
      n.samples, n.duplicates + n.behind + n.ahead + n.refused, n.duplicates, n.behind, n.ahead, n.refused,
      n.unreadable, n.clock_set, n.clock_wrapped, n.jumps);
}

Json sensor_json(const imucal_link_sensor_reply_t& n) {
  return {{"name", fixed_text(n.name)},
          {"status", n.status},
          {"status_text", status_text(n.status)},
          {"identity", n.identity},
          {"starts", n.starts},
          {"wrong_identity", n.wrong_identity},
          {"bus_errors", n.bus_errors},
          {"overruns", n.overruns},
          {"lost", n.lost},
          {"invalid", n.invalid},
          {"resets", n.resets},
          {"stuck_temp", n.stuck_temp},
          {"stuck_data", n.stuck_data},
          {"saturated", n.saturated},
          {"clock_ppm", shortest(n.drift_ppm)},
          {"supply_refused", n.supply_refused},
          {"is_supply_low", n.is_supply_low != 0}};
}

void print_sensor(const imucal_link_sensor_reply_t& n) {
  std::printf(
      "sensor %s: %s, identity 0x%02X, started %u times, clock %+.0f ppm; %u wrong identities, %u bus errors, %u "
      "overruns, %u samples lost, %u invalid, %u resets, %u saturated; stood still: temperature %u times, data %u "
      "times\n",
      fixed_text(n.name).c_str(), n.status == IMUCAL_OK ? "works" : status_text(n.status), n.identity, n.starts,
      static_cast<double>(n.drift_ppm), n.wrong_identity, n.bus_errors, n.overruns, n.lost, n.invalid, n.resets,
      n.saturated, n.stuck_temp, n.stuck_data);
  if (n.supply_refused || n.is_supply_low)
    std::printf("supply: %s; the flash was left alone %u times because it was too low\n",
                n.is_supply_low ? "too low to program the flash" : "good", n.supply_refused);
}

void print_axes(const imucal_table_t& table) {
  for (size_t i = 0; i < table.n_channels; ++i) {
    const imucal_table_channel_t& c = table.channel[i];
    if (c.order == 0) {
      std::printf("  %-10s not calibrated\n", fixed_text(c.name).c_str());
      continue;
    }
    const float worst = *std::max_element(c.sigma, c.sigma + IMUCAL_TABLE_SIGMA_N);
    const bool is_accel = channel_unit(c) == "mg";
    const int digits = is_accel ? 4 : 2;
    std::printf("  %-10s order %u, %.1f to %.1f degC, worst predicted error %.*f %s (one sigma), coefficients",
                fixed_text(c.name).c_str(), c.order, static_cast<double>(c.span_lo_degc),
                static_cast<double>(c.span_hi_degc), digits, static_cast<double>(worst), channel_unit(c).c_str());
    for (unsigned k = 0; k <= c.order; ++k) std::printf(" %.*f", digits, static_cast<double>(c.coeff[k]));
    std::printf("\n");
    if (is_accel) std::printf("  %-10s b0 holds gravity along the axis, as it lay\n", "");
  }
}

// Predicted one-sigma error on a fine grid (the table holds nine temperatures).
Json curve_json(const AxisResult& axis, const imucal_table_channel_t& channel) {
  constexpr int kPoints = 61;
  Json temperatures = Json::array(), sigmas = Json::array();
  const double lo = static_cast<double>(channel.span_lo_degc), hi = static_cast<double>(channel.span_hi_degc);
  for (int i = 0; i < kPoints; ++i) {
    const double temp_degc = lo + (hi - lo) * i / (kPoints - 1);
    temperatures.push_back(temp_degc);
    sigmas.push_back(shortest(imucal_kf_bias_sigma(&axis.filter, static_cast<float>(temp_degc))));
  }
  return {{"temp_degc", temperatures}, {"sigma_" + channel_unit(channel), sigmas}};
}

// The table is of this device, and counts mean the same here.
void require_table_of(const imucal_table_t& table, const Device& device, const std::string& path) {
  const std::string serial = fixed_text(table.serial);
  if (serial != device.serial())
    throw data_error(path + ": serial: the table is of device '" + serial + "', on " + device.port() + " is '" +
                     device.serial() + "'; use the table of this device");
  if (table.n_channels != device.channels().size())
    throw data_error(path + ": axes: " + std::to_string(table.n_channels) + " in the table, the device has " +
                     std::to_string(device.channels().size()));
  for (size_t i = 0; i < table.n_channels; ++i) {
    if (fixed_text(table.channel[i].name) != device.channel_name(i))
      throw data_error(path + ": axes[" + std::to_string(i) + "].axis: '" + fixed_text(table.channel[i].name) +
                       "', the device's channel is '" + device.channel_name(i) + "'");
    if (table.channel[i].unit_per_count != device.channels()[i].unit_per_count)
      throw data_error(path + ": axes[" + std::to_string(i) + "] (" + device.channel_name(i) +
                       "): the value of a count is " + std::to_string(shortest(table.channel[i].unit_per_count)) +
                       ", the device's is " + std::to_string(shortest(device.channels()[i].unit_per_count)));
  }
}

} // namespace

Exit list_ports(const CommonOptions& common) {
  const std::vector<SerialPortInfo> ports = list_serial_ports();
  Json json = {{"ports", Json::array()}};
  for (const SerialPortInfo& port : ports)
    json["ports"].push_back({{"port", port.name}, {"description", port.description}, {"usb_serial", port.usb_serial}});
  if (common.wants_json()) write_json(common.json_path, json);
  if (!common.talks()) return Exit::kDone;
  for (const SerialPortInfo& port : ports)
    std::printf("%s  %s%s%s\n", port.name.c_str(), port.description.c_str(), port.usb_serial.empty() ? "" : "  serial ",
                port.usb_serial.c_str());
  if (ports.empty())
    std::printf("no serial devices on this machine (pseudo-terminals and tcp:HOST:PORT are not listed)\n");
  return Exit::kDone;
}

namespace {

struct DeviceState {
  imucal_link_info_reply_t info;
  imucal_link_counters_reply_t counters;
  imucal_link_state_reply_t state;
  std::optional<imucal_link_samples_reply_t> samples;
  std::optional<imucal_link_sensor_reply_t> sensor;
  bool has_table() const { return info.table_status == IMUCAL_OK; }
  // Empty: the sensor delivers as many samples as the board says, or too few seconds to tell.
  std::string rate_warning(const Device& device) const {
    return samples ? rate_text(*samples, static_cast<double>(device.hello().rate_hz)) : "";
  }
};

Json channels_json(const Device& device) {
  Json list = Json::array();
  for (size_t i = 0; i < device.channels().size(); ++i) {
    const imucal_link_channel_info_reply_t& c = device.channels()[i];
    list.push_back({{"axis", device.channel_name(i)},
                    {"unit_per_count", shortest(c.unit_per_count)},
                    {"full_scale_counts", c.full_scale_counts},
                    {"compensated", c.is_compensated != 0},
                    {"degc_per_count", shortest(c.degc_per_count)},
                    {"degc_at_zero", shortest(c.degc_at_zero)}});
  }
  return list;
}

Json info_json(const Device& device, const DeviceState& now) {
  const auto& [info, counters, state, samples, sensor] = now;
  Json json = device_json(device);
  json["session"] = session_text(info.session);
  json["uptime_s"] = static_cast<double>(info.uptime_us) * 1e-6;
  json["t_s"] = info.t_s;
  json["has_table"] = now.has_table();
  json["table_status"] = status_text(info.table_status);
  json["sequence"] = info.sequence;
  json["table_crc"] = now.has_table() ? Json(hex(state.table_crc)) : Json(nullptr);
  json["table_origin"] = origin_text(state.table_origin);
  json["table_created_s"] = state.table_created_s;
  json["unlocked_s"] = state.unlocked_s;
  json["refused"] = refused_json(state);
  json["ruling_slot"] = now.has_table() ? Json(info.ruling_slot) : Json(nullptr);
  json["slots"] = Json::array();
  for (int i = 0; i < 2; ++i)
    json["slots"].push_back({{"status", status_text(info.slot_status[i])}, {"sequence", info.slot_sequence[i]}});
  json["channels"] = channels_json(device);
  json["counters"] = counters_json(counters);
  if (samples) json["samples"] = samples_json(*samples);
  json["sensor"] = sensor ? sensor_json(*sensor) : Json(nullptr);
  const std::string warning = now.rate_warning(device);
  json["rate_warning"] = warning.empty() ? Json(nullptr) : Json(warning);
  return json;
}

void print_table_state(const DeviceState& now) {
  const auto& [info, counters, state, samples, sensor] = now;
  if (now.has_table())
    std::printf("table: sequence %u rules (slot %u, %u bytes, CRC %s), made %s, %s\n", info.sequence, info.ruling_slot,
                info.table_bytes, hex(state.table_crc).c_str(), utc_text(state.table_created_s).c_str(),
                origin_text(state.table_origin));
  else
    std::printf("table: none, the device runs uncompensated (%s)\n", status_text(info.table_status));
  for (int i = 0; i < 2; ++i)
    std::printf("  slot %d: %s%s\n", i, status_text(info.slot_status[i]),
                info.slot_sequence[i] ? (", sequence " + std::to_string(info.slot_sequence[i])).c_str() : "");
}

void print_counts(const DeviceState& now) {
  const auto& [info, counters, state, samples, sensor] = now;
  std::printf("since start: %u samples, %u seconds, %u gaps, %u bad records; line: %u frames, %u spoilt, %u "
              "dropped\n",
              counters.samples, counters.seconds, counters.gaps, counters.feed_errors, counters.rx_frames,
              counters.rx_crc + counters.rx_resync + counters.rx_overflow, counters.tx_dropped);
  if (samples) tell_samples(*samples);
  if (sensor) print_sensor(*sensor);
  std::printf(
      "refused: %u locked, %u old or foreign, %u unlocks, %u busy, %u reserved fields, %u tables; flash failed %u "
      "times; %u calibrations stopped without a host\n",
      state.refused_locked, state.refused_stale, state.refused_unlock, state.refused_busy, state.refused_reserved,
      state.refused_table, state.flash_failed, state.sessions_silent);
}

void print_info(const Device& device, const DeviceState& now) {
  std::printf("%s on %s: firmware %s, serial %s, %zu channels at %.0f Hz, %s\n",
              fixed_text(device.hello().device).c_str(), device.port().c_str(),
              fixed_text(device.hello().firmware).c_str(), device.serial().c_str(), device.channels().size(),
              static_cast<double>(device.hello().rate_hz), session_text(now.info.session));
  print_table_state(now);
  for (size_t i = 0; i < device.channels().size(); ++i)
    std::printf("  %-10s %.6g per count, full scale %d counts, %s\n", device.channel_name(i).c_str(),
                static_cast<double>(device.channels()[i].unit_per_count), device.channels()[i].full_scale_counts,
                device.channels()[i].is_compensated ? "compensated" : "raw");
  print_counts(now);
  if (const std::string warning = now.rate_warning(device); !warning.empty())
    std::printf("note: since start %s\n", warning.c_str());
}

} // namespace

Exit show_info(Device* device, const CommonOptions& common) {
  const DeviceState now{device->info(), device->counters(), device->state(), device->samples(), device->sensor()};
  if (common.wants_json()) write_json(common.json_path, info_json(*device, now));
  if (common.talks()) print_info(*device, now);
  return Exit::kDone;
}

namespace {

// One recording: what comes, and where it goes.
class Recording {
public:
  Recording(Device* device, const MonitorOptions& options, const CommonOptions& common)
      : device_(*device), options_(options),
        raw_(options.raw_path, *device, LogRecorder::What::kRaw, options.may_overwrite),
        compensated_(options.compensated_path, *device, LogRecorder::What::kCompensated, options.may_overwrite),
        prints_(options.raw_path.empty() && options.compensated_path.empty() && common.talks()),
        is_quiet_(common.quiet), sensor_(static_cast<double>(device->hello().rate_hz), 0, {}),
        progress_("recording", options.duration_s, common.quiet || prints_), watch_(device, options.stall_s) {}

  void listen();
  void close(); // both logs; data_error
  Json json() const;
  size_t seconds() const { return n_; }
  bool prints() const { return prints_; }
  uint32_t trouble() const { return trouble_; }
  // Ctrl-C before the duration that was asked for.
  bool is_cut_short() const { return is_interrupted_ && options_.duration_s > 0; }
  const std::optional<imucal_link_samples_reply_t>& samples() const { return samples_; }

private:
  void print_header() const;
  void print(const SecondRecord& second) const;
  void take(uint8_t id, const imucal_link_any_t& record);
  bool is_at_end();
  bool has_all() const { return options_.duration_s > 0 && watch_.elapsed_s() >= options_.duration_s; }

  Device& device_;
  const MonitorOptions& options_;
  LogRecorder raw_, compensated_;
  bool prints_, is_quiet_;
  SensorWatch sensor_;
  std::string rate_warning_; // empty: the rate is the board's, or not known yet
  Progress progress_;
  Watch watch_;
  size_t n_ = 0;
  bool is_interrupted_ = false;
  uint32_t trouble_ = 0; // IMUCAL_SENSOR_* that events told
  std::optional<imucal_link_samples_reply_t> samples_;
};

void Recording::print_header() const {
  std::printf("    t_s  temp_degc");
  for (size_t i = 0; i < device_.channels().size(); ++i)
    std::printf("  %12s  compensated", device_.channel_name(i).c_str());
  std::printf("\n");
}

void Recording::print(const SecondRecord& second) const {
  std::printf("%7u  %9.3f", second.t_s, static_cast<double>(second.temp_degc));
  for (size_t i = 0; i < second.n_channels; ++i)
    std::printf("  %12.2f  %11.2f", static_cast<double>(second.raw[i]), static_cast<double>(second.out[i]));
  std::printf("%s\n", second.is_gap ? "  gap" : "");
  std::fflush(stdout);
}

void Recording::take(uint8_t id, const imucal_link_any_t& record) {
  if (id == IMUCAL_LINK_ID_SECOND && has_all()) return; // came in one piece with the last one that was asked for
  watch_.saw(id, record);
  if (id == IMUCAL_LINK_ID_EVENT && record.event.code == IMUCAL_EVENT_SENSOR_COUNTED) trouble_ |= record.event.detail;
  if (id != IMUCAL_LINK_ID_SECOND) return;
  ++n_;
  raw_.add(record.second);
  compensated_.add(record.second);
  sensor_.add(record.second);
  progress_.update(watch_.elapsed_s(), std::to_string(static_cast<long>(watch_.elapsed_s())) + " s");
  if (prints_) print(record.second);
}

bool Recording::is_at_end() {
  is_interrupted_ = interrupted();
  return is_interrupted_ || watch_.has_sensor_ended() || raw_.has_failed() || compensated_.has_failed() || has_all();
}

void Recording::listen() {
  if (prints_) print_header();
  device_.stream(0, 0, 1); // what a former program left running
  const std::optional<imucal_link_samples_reply_t> before = device_.samples();
  device_.on_stream([this](uint8_t id, const imucal_link_any_t& record) { take(id, record); });
  device_.stream(IMUCAL_STREAM_SECOND | IMUCAL_STREAM_EVENT, 0, 1);
  while (!is_at_end()) {
    device_.poll(0.2);
    watch_.check();
    const std::string warning = sensor_.new_rate_warning();
    if (warning.empty()) continue;
    rate_warning_ = warning;
    if (!is_quiet_) notice(warning);
  }
  progress_.finish();
  device_.stream(0, 0, 1);
  device_.on_stream({});
  const std::optional<imucal_link_samples_reply_t> after = device_.samples();
  if (before && after) samples_ = samples_between(*before, *after);
}

void Recording::close() {
  raw_.close();
  compensated_.close();
}

Json Recording::json() const {
  Json json = {{"seconds", n_}, {"sensor_ended", watch_.has_sensor_ended()}, {"link", link_json(device_)}};
  if (samples_) json["samples"] = samples_json(*samples_);
  json["rate_warning"] = rate_warning_.empty() ? Json(nullptr) : Json(rate_warning_);
  json["sensor_trouble"] = trouble_ ? Json(sensor_trouble(trouble_)) : Json(nullptr);
  return json;
}

} // namespace

Exit monitor(Device* device, const MonitorOptions& options, const CommonOptions& common) {
  (void)interrupted(); // from here on Ctrl-C ends the recording in order
  Recording recording(device, options, common);
  recording.listen();
  recording.close();
  if (common.wants_json()) write_json(common.json_path, recording.json());
  if (common.talks() && !recording.prints()) {
    std::printf("%zu seconds recorded\n", recording.seconds());
    if (recording.samples()) tell_samples(*recording.samples());
    if (recording.trouble()) std::printf("%s: see calibrate info\n", sensor_trouble(recording.trouble()).c_str());
    tell_losses(*device);
  }
  return recording.is_cut_short() ? Exit::kInterrupted : Exit::kDone;
}

Json axes_json(const imucal_table_t& table) {
  Json axes = Json::array();
  const Json whole = to_json(table);
  for (const Json& axis : whole["axes"])
    if (axis["order"] != 0) axes.push_back(axis);
  return axes;
}

namespace {

Json axis_json(const AxisResult& axis, const RunResult& result, const Json& in_table) {
  Json entry = {{"axis", axis.name}, {"order", 0}};
  for (const Json& candidate : in_table)
    if (candidate["axis"] == axis.name) entry = candidate;
  const imucal_table_channel_t& channel = result.table.channel[axis.channel];
  entry["residual_rms_" + channel_unit(channel)] = axis.residual_rms;
  entry["measurements"] = axis.state.n;
  entry["bridged_s"] = axis.state.n_missed;
  entry["n_rejected"] = axis.health.n_rejected;
  entry["n_bad_temperature"] = axis.health.n_spikes;
  entry["mean_nis"] = shortest(axis.state.mean_nis);
  entry["lag1"] = shortest(axis.state.lag1);
  if (channel.order == 0) return entry;
  const float worst = *std::max_element(channel.sigma, channel.sigma + IMUCAL_TABLE_SIGMA_N);
  entry["worst_sigma"] = shortest(worst);
  entry["error_factor"] = axis.error_factor;
  entry["curve"] = curve_json(axis, channel);
  return entry;
}

// Of the model that an axis has; one model is that of all axes.
double turn_on_of(const RunOptions& options, size_t axis) {
  return options.models[options.models.size() > 1 ? axis : 0].turn_on_sigma_dph;
}

Json run_json(const Device& device, const RunOptions& options, const RunResult& result, double wall_s) {
  Json json = {{"axes", Json::array()}};
  const Json in_table = axes_json(result.table);
  for (size_t i = 0; i < result.axes.size(); ++i) {
    Json axis = axis_json(result.axes[i], result, in_table);
    if (const double sigma = turn_on_of(options, i); sigma > 0)
      axis["turn_on_sigma_" + channel_unit(result.table.channel[result.axes[i].channel])] = sigma;
    json["axes"].push_back(axis);
  }
  json["device"] = device_json(device);
  json["flashed"] = result.is_flashed;
  json["flash_error"] = result.flash_error.empty() ? Json(nullptr) : Json(result.flash_error);
  json["judgement"] = judgement_json(result.reasons);
  json["sequence"] = result.is_flashed ? Json(result.table.sequence) : Json(nullptr);
  json["ended_by"] = end_text(result.end);
  json["error_reached"] = options.until_error > 0 ? Json(result.is_error_reached) : Json(nullptr);
  json["seconds"] = result.seconds;
  json["gaps"] = result.gaps;
  json["seen_degc"] = {result.seen.lo_degc, result.seen.hi_degc};
  json["made_by"] = result.is_device_made ? "device" : "host";
  json["wall_s"] = wall_s;
  json["notes"] = result.notes;
  if (result.samples) json["samples"] = samples_json(*result.samples);
  json["link"] = link_json(device);
  return json;
}

// Once where all axes have one model.
void tell_turn_on(const RunOptions& options, const RunResult& result) {
  for (size_t i = 0; i < (options.models.size() > 1 ? result.axes.size() : 1); ++i)
    if (const double sigma = turn_on_of(options, i); sigma > 0)
      std::printf("  %s%s\n", options.models.size() > 1 ? (result.axes[i].name + ": ").c_str() : "",
                  turn_on_words(sigma, channel_unit(result.table.channel[result.axes[i].channel])).c_str());
}

void print_run(const Device& device, const RunOptions& options, const RunResult& result, const std::string& table_path,
               double wall_s) {
  std::printf("%.0f s of sensor time in %.1f s, %.2f to %.2f degC; %s\n", result.seconds, wall_s, result.seen.lo_degc,
              result.seen.hi_degc, end_text(result.end));
  if (result.is_flashed) {
    std::printf("table %u flashed on %s, read back and verified%s%s\n", result.table.sequence, device.serial().c_str(),
                table_path.empty() ? "" : "; written to ", table_path.c_str());
    print_axes(result.table);
    tell_turn_on(options, result);
  }
  for (const AxisResult& axis : result.axes)
    if (axis.health.n_rejected + axis.health.n_spikes > 0)
      std::printf("  %-10s left out: %u seconds with a knock, %u with a temperature out of reach\n", axis.name.c_str(),
                  axis.health.n_rejected, axis.health.n_spikes);
  for (const std::string& note : result.notes) std::printf("note: %s\n", note.c_str());
  if (result.samples) tell_samples(*result.samples);
  tell_losses(device);
  if (!result.is_error_reached) std::printf("the error of %.2f asked for was not reached\n", options.until_error);
}

// Why nothing was flashed, also with --quiet: it is the answer.
void tell_reasons(const Device& device, const RunResult& result) {
  for (const FitReason& reason : result.reasons)
    warn("calibrate: %s%s: %s\n", reason.is_accepted ? "accepted: " : "", reason.axis.c_str(), reason.text.c_str());
  if (!is_accepted(result.reasons))
    warn("calibrate: not accepted, nothing flashed: %s keeps its last good table; to insist: --accept RULE\n",
         device.serial().c_str());
  else if (!result.is_flashed && result.flash_error.empty())
    warn("calibrate: interrupted, nothing flashed: %s keeps its last good table (--keep-partial flashes what "
         "is there)\n",
         device.serial().c_str());
  if (!result.record_error.empty()) warn("calibrate: %s\n", result.record_error.c_str());
}

// Where the table goes that no flash has taken: the file asked for, else one beside the work, never over another.
std::string unflashed_path(const Device& device, const std::string& asked_for) {
  if (!asked_for.empty()) return asked_for;
  std::string stem = "unflashed-";
  for (const char c : device.serial()) stem += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
  std::string path = stem + ".json";
  for (int n = 2; ::access(path.c_str(), F_OK) == 0; ++n) path = stem + "-" + std::to_string(n) + ".json";
  return path;
}

// What its table says of rules that were accepted.
std::vector<TableNote> notes_of(const RunResult& result) {
  std::map<std::string, double> error_factor;
  for (const AxisResult& axis : result.axes) error_factor[axis.name] = axis.error_factor;
  return table_notes(result.reasons, error_factor);
}

// The run is not lost: what was learnt is in a file, and what to do is said.
Exit keep_unflashed(const Device& device, const RunResult& result, const std::string& path) {
  warn("calibrate: %s\n", printable(result.flash_error).c_str());
  write_table(path, result.table, notes_of(result));
  warn("calibrate: not flashed; what was learnt is good and is kept in %s: mend the device, then calibrate --port %s "
       "flash %s\n",
       path.c_str(), device.port().c_str(), path.c_str());
  return Exit::kDevice;
}

// The table is in flash, whatever becomes of the file.
void write_run_table(const std::string& path, const RunResult& result) {
  if (path.empty() || !result.is_flashed) return;
  try {
    write_table(path, result.table, notes_of(result));
  } catch (const Error& e) {
    throw Error(e.exit(), std::string(e.what()) + "; table " + std::to_string(result.table.sequence) +
                              " is flashed and verified, calibrate dump -o FILE reads it");
  }
}

} // namespace

Exit calibrate_device(Device* device, const RunOptions& options, const std::string& table_path,
                      const CommonOptions& common) {
  const double start_s = now_s();
  const RunResult result = run_calibration(device, options);
  write_run_table(table_path, result);
  const double wall_s = now_s() - start_s;
  if (common.wants_json()) write_json(common.json_path, run_json(*device, options, result, wall_s));
  if (common.talks()) print_run(*device, options, result, table_path, wall_s);
  tell_reasons(*device, result);
  if (!result.flash_error.empty()) return keep_unflashed(*device, result, unflashed_path(*device, table_path));
  if (!result.is_flashed) return is_accepted(result.reasons) ? Exit::kInterrupted : Exit::kNegative;
  if (!result.record_error.empty()) return Exit::kData;
  return result.is_error_reached ? Exit::kDone : Exit::kNegative;
}

Exit flash_table(Device* device, const std::string& path, const CommonOptions& common) {
  const imucal_table_t table = read_table(path);
  require_table_of(table, *device, path);
  device->write_table(table_bytes(table, path));
  const imucal_table_t flashed = table_from_bytes(device->read_table(), device->port());
  const std::vector<std::string> differences = table_differences(table, flashed);
  if (!differences.empty())
    throw device_error(device->port() + ": what was read back from flash differs: " + differences.front() +
                       "; do not use it (calibrate rollback returns to the table before)");
  if (common.wants_json())
    write_json(common.json_path, {{"sequence", flashed.sequence}, {"serial", device->serial()}, {"verified", true}});
  if (common.talks()) {
    std::printf("table %u flashed on %s, read back and verified\n", flashed.sequence, device->serial().c_str());
    print_axes(flashed);
    for (const TableNote& note : read_table_notes(path))
      if (note.error_factor > 1)
        std::printf("note: %s was accepted although rules spoke against it: its error is about %.3g times what the "
                    "table says\n",
                    note.axis.c_str(), note.error_factor);
  }
  return Exit::kDone;
}

Exit verify_table(Device* device, const std::string& path, const CommonOptions& common) {
  const imucal_table_t table = read_table(path);
  const imucal_link_info_reply_t info = device->info();
  std::vector<std::string> differences;
  if (info.table_status != IMUCAL_OK)
    differences.push_back(std::string("no table on the device: ") + status_text(info.table_status));
  else
    differences = table_differences(table, table_from_bytes(device->read_table(), device->port()));
  if (common.wants_json())
    write_json(common.json_path,
               {{"same", differences.empty()}, {"sequence", info.sequence}, {"differences", differences}});
  if (common.talks()) {
    for (const std::string& line : differences) std::printf("%s\n", line.c_str());
    if (differences.empty())
      std::printf("same: table %u on %s is %s\n", info.sequence, device->serial().c_str(), path.c_str());
    else
      std::printf("differs: %zu differences (%s against the device)\n", differences.size(), path.c_str());
  }
  return differences.empty() ? Exit::kDone : Exit::kNegative;
}

Exit dump_table(Device* device, const std::string& path, const CommonOptions& common) {
  const imucal_link_info_reply_t info = device->info();
  if (info.table_status != IMUCAL_OK)
    throw device_error(device->port() + ": no table to read: " + status_text(info.table_status) +
                       "; calibrate the device or flash a table");
  const imucal_table_t table = table_from_bytes(device->read_table(), device->port());
  write_table(path, table);
  if (common.wants_json()) write_json(common.json_path, {{"axes", axes_json(table)}, {"sequence", table.sequence}});
  if (common.talks() && path != "-") {
    std::printf("table %u of %s written to %s\n", table.sequence, device->serial().c_str(), path.c_str());
    print_axes(table);
  }
  return Exit::kDone;
}

Exit roll_back(Device* device, const CommonOptions& common) {
  const uint32_t before = device->info().sequence;
  device->rollback();
  const imucal_link_info_reply_t info = device->info();
  if (common.wants_json()) write_json(common.json_path, {{"before", before}, {"sequence", info.sequence}});
  if (common.talks()) std::printf("table %u rules again (was %u)\n", info.sequence, before);
  return Exit::kDone;
}

Exit stop_session(Device* device, const CommonOptions& common) {
  const unsigned session = device->info().session;
  device->cal_stop(IMUCAL_STOP_DISCARD);
  device->stream(0, 0, 1);
  if (common.wants_json()) write_json(common.json_path, {{"was", session_text(session)}});
  if (common.talks()) std::printf("%s: was %s, is idle\n", device->serial().c_str(), session_text(session));
  return Exit::kDone;
}

Exit erase_tables(Device* device, const CommonOptions& common) {
  device->erase();
  const imucal_link_info_reply_t info = device->info();
  if (info.table_status == IMUCAL_OK)
    throw device_error(device->port() +
                       ": a table still rules after erasing; look at the flash: its driver, or worn cells");
  if (common.wants_json()) write_json(common.json_path, {{"erased", true}});
  if (common.talks()) std::printf("both slots erased; %s runs uncompensated\n", device->serial().c_str());
  return Exit::kDone;
}

} // namespace imucal
