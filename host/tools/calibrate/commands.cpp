// SPDX-License-Identifier: MIT
#include "calibrate/commands.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>

#include "base/clock.h"
#include "device/recorder.h"
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
  case IMUCAL_ORIGIN_FLASH:
    return "in flash at the start";
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

void print_axes(const imucal_table_t& table) {
  for (size_t i = 0; i < table.n_channels; ++i) {
    const imucal_table_channel_t& c = table.channel[i];
    if (c.order == 0) {
      std::printf("  %-10s not calibrated\n", fixed_text(c.name).c_str());
      continue;
    }
    const float worst = *std::max_element(c.sigma, c.sigma + IMUCAL_TABLE_SIGMA_N);
    std::printf("  %-10s order %u, %.1f to %.1f degC, worst predicted error %.2f %s (one sigma), coefficients",
                fixed_text(c.name).c_str(), c.order, static_cast<double>(c.span_lo_degc),
                static_cast<double>(c.span_hi_degc), static_cast<double>(worst), channel_unit(c).c_str());
    for (unsigned k = 0; k <= c.order; ++k) std::printf(" %.2f", static_cast<double>(c.coeff[k]));
    std::printf("\n");
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

Exit show_info(Device* device, const CommonOptions& common) {
  const imucal_link_info_reply_t info = device->info();
  const imucal_link_counters_reply_t counters = device->counters();
  const imucal_link_state_reply_t state = device->state();
  const bool has_table = info.table_status == IMUCAL_OK;
  Json json = device_json(*device);
  json["session"] = session_text(info.session);
  json["uptime_s"] = static_cast<double>(info.uptime_us) * 1e-6;
  json["t_s"] = info.t_s;
  json["has_table"] = has_table;
  json["table_status"] = status_text(info.table_status);
  json["sequence"] = info.sequence;
  json["table_crc"] = has_table ? Json(hex(state.table_crc)) : Json(nullptr);
  json["table_origin"] = origin_text(state.table_origin);
  json["table_created_s"] = state.table_created_s;
  json["unlocked_s"] = state.unlocked_s;
  json["refused"] = refused_json(state);
  json["ruling_slot"] = has_table ? Json(info.ruling_slot) : Json(nullptr);
  json["slots"] = Json::array();
  for (int i = 0; i < 2; ++i)
    json["slots"].push_back({{"status", status_text(info.slot_status[i])}, {"sequence", info.slot_sequence[i]}});
  json["channels"] = Json::array();
  for (size_t i = 0; i < device->channels().size(); ++i) {
    const imucal_link_channel_info_reply_t& c = device->channels()[i];
    json["channels"].push_back({{"axis", device->channel_name(i)},
                                {"unit_per_count", shortest(c.unit_per_count)},
                                {"full_scale_counts", c.full_scale_counts},
                                {"compensated", c.is_compensated != 0},
                                {"degc_per_count", shortest(c.degc_per_count)},
                                {"degc_at_zero", shortest(c.degc_at_zero)}});
  }
  json["counters"] = counters_json(counters);
  if (common.wants_json()) write_json(common.json_path, json);
  if (!common.talks()) return Exit::kDone;
  std::printf("%s on %s: firmware %s, serial %s, %zu channels at %.0f Hz, %s\n",
              fixed_text(device->hello().device).c_str(), device->port().c_str(),
              fixed_text(device->hello().firmware).c_str(), device->serial().c_str(), device->channels().size(),
              static_cast<double>(device->hello().rate_hz), session_text(info.session));
  if (has_table)
    std::printf("table: sequence %u rules (slot %u, %u bytes, CRC %s), made %s, %s\n", info.sequence, info.ruling_slot,
                info.table_bytes, hex(state.table_crc).c_str(), utc_text(state.table_created_s).c_str(),
                origin_text(state.table_origin));
  else
    std::printf("table: none, the device runs uncompensated (%s)\n", status_text(info.table_status));
  for (int i = 0; i < 2; ++i)
    std::printf("  slot %d: %s%s\n", i, status_text(info.slot_status[i]),
                info.slot_sequence[i] ? (", sequence " + std::to_string(info.slot_sequence[i])).c_str() : "");
  for (size_t i = 0; i < device->channels().size(); ++i)
    std::printf("  %-10s %.6g per count, full scale %d counts, %s\n", device->channel_name(i).c_str(),
                static_cast<double>(device->channels()[i].unit_per_count), device->channels()[i].full_scale_counts,
                device->channels()[i].is_compensated ? "compensated" : "raw");
  std::printf("since start: %u samples, %u seconds, %u gaps, %u bad records; line: %u frames, %u spoilt, %u "
              "dropped\n",
              counters.samples, counters.seconds, counters.gaps, counters.feed_errors, counters.rx_frames,
              counters.rx_crc + counters.rx_resync + counters.rx_overflow, counters.tx_dropped);
  std::printf(
      "refused: %u locked, %u old or foreign, %u unlocks, %u busy, %u reserved fields, %u tables; flash failed %u "
      "times; %u calibrations stopped without a host\n",
      state.refused_locked, state.refused_stale, state.refused_unlock, state.refused_busy, state.refused_reserved,
      state.refused_table, state.flash_failed, state.sessions_silent);
  return Exit::kDone;
}

Exit monitor(Device* device, const MonitorOptions& options, const CommonOptions& common) {
  (void)interrupted(); // from here on Ctrl-C ends the recording in order
  LogRecorder raw(options.raw_path, *device, LogRecorder::What::kRaw, options.may_overwrite);
  LogRecorder compensated(options.compensated_path, *device, LogRecorder::What::kCompensated, options.may_overwrite);
  const bool prints = options.raw_path.empty() && options.compensated_path.empty() && common.talks();
  bool has_ended = false;
  uint32_t first_t_s = 0, t_s = 0;
  size_t n = 0;
  double last_s = now_s();
  Progress progress("recording", options.duration_s, common.quiet || prints);
  if (prints) {
    std::printf("    t_s  temp_degc");
    for (size_t i = 0; i < device->channels().size(); ++i)
      std::printf("  %12s  compensated", device->channel_name(i).c_str());
    std::printf("\n");
  }
  device->stream(0, 0, 1); // what a former program left running
  device->on_stream([&](uint8_t id, const imucal_link_any_t& record) {
    last_s = now_s();
    if (id == IMUCAL_LINK_ID_EVENT && record.event.code == IMUCAL_EVENT_SENSOR_ENDED) has_ended = true;
    if (id != IMUCAL_LINK_ID_SECOND) return;
    const SecondRecord& second = record.second;
    if (n++ == 0) first_t_s = second.t_s - 1;
    t_s = second.t_s;
    raw.add(second);
    compensated.add(second);
    progress.update(t_s - first_t_s, std::to_string(t_s - first_t_s) + " s");
    if (!prints) return;
    std::printf("%7u  %9.3f", second.t_s, static_cast<double>(second.temp_degc));
    for (size_t i = 0; i < second.n_channels; ++i)
      std::printf("  %12.2f  %11.2f", static_cast<double>(second.raw[i]), static_cast<double>(second.out[i]));
    std::printf("%s\n", second.is_gap ? "  gap" : "");
    std::fflush(stdout);
  });
  device->stream(IMUCAL_STREAM_SECOND | IMUCAL_STREAM_EVENT, 0, 1);
  while (!interrupted() && !has_ended && !(options.duration_s > 0 && n > 0 && t_s - first_t_s >= options.duration_s)) {
    device->poll(0.2);
    if (now_s() - last_s > 2.0) {
      device->info(); // device_error when it is gone
      last_s = now_s();
    }
  }
  progress.finish();
  device->stream(0, 0, 1);
  device->on_stream({});
  raw.close();
  compensated.close();
  if (common.wants_json())
    write_json(common.json_path, {{"seconds", n}, {"sensor_ended", has_ended}, {"link", link_json(*device)}});
  if (common.talks() && !prints) {
    std::printf("%zu seconds recorded\n", n);
    tell_losses(*device);
  }
  return Exit::kDone;
}

Json axes_json(const imucal_table_t& table) {
  Json axes = Json::array();
  const Json whole = to_json(table);
  for (const Json& axis : whole["axes"])
    if (axis["order"] != 0) axes.push_back(axis);
  return axes;
}

Exit calibrate_device(Device* device, const RunOptions& options, const std::string& table_path,
                      const CommonOptions& common) {
  const double start_s = now_s();
  const RunResult result = run_calibration(device, options);
  if (!table_path.empty()) write_table(table_path, result.table);
  Json json = {{"axes", Json::array()}};
  const Json in_table = axes_json(result.table);
  for (const AxisResult& axis : result.axes) {
    const auto found =
        std::find_if(in_table.begin(), in_table.end(), [&](const Json& entry) { return entry["axis"] == axis.name; });
    Json entry = *found;
    entry["residual_rms_" + channel_unit(result.table.channel[axis.channel])] = axis.residual_rms;
    entry["measurements"] = axis.state.n;
    entry["bridged_s"] = axis.state.n_missed;
    entry["mean_nis"] = shortest(axis.state.mean_nis);
    entry["lag1"] = shortest(axis.state.lag1);
    const float* sigma = result.table.channel[axis.channel].sigma;
    entry["worst_sigma"] = shortest(*std::max_element(sigma, sigma + IMUCAL_TABLE_SIGMA_N));
    entry["curve"] = curve_json(axis, result.table.channel[axis.channel]);
    json["axes"].push_back(entry);
  }
  json["device"] = device_json(*device);
  json["sequence"] = result.table.sequence;
  json["ended_by"] = end_text(result.end);
  json["error_reached"] = options.until_error > 0 ? Json(result.is_error_reached) : Json(nullptr);
  json["seconds"] = result.seconds;
  json["gaps"] = result.gaps;
  json["seen_degc"] = {result.seen.lo_degc, result.seen.hi_degc};
  json["made_by"] = result.is_device_made ? "device" : "host";
  json["wall_s"] = now_s() - start_s;
  json["notes"] = result.notes;
  json["link"] = link_json(*device);
  if (common.wants_json()) write_json(common.json_path, json);
  if (common.talks()) {
    std::printf("%.0f s of sensor time in %.1f s, %.2f to %.2f degC; %s\n", result.seconds, now_s() - start_s,
                result.seen.lo_degc, result.seen.hi_degc, end_text(result.end));
    std::printf("table %u flashed on %s, read back and verified%s%s\n", result.table.sequence, device->serial().c_str(),
                table_path.empty() ? "" : "; written to ", table_path.c_str());
    print_axes(result.table);
    for (const std::string& note : result.notes) std::printf("note: %s\n", note.c_str());
    tell_losses(*device);
    if (!result.is_error_reached) std::printf("the error of %.2f asked for was not reached\n", options.until_error);
  }
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
    throw device_error(device->port() + ": a table still rules after erasing; the flash may be worn out");
  if (common.wants_json()) write_json(common.json_path, {{"erased", true}});
  if (common.talks()) std::printf("both slots erased; %s runs uncompensated\n", device->serial().c_str());
  return Exit::kDone;
}

} // namespace imucal
