// SPDX-License-Identifier: MIT
// The fit's result as a table.
#include <charconv>
#include <cmath>
#include <cstring>
#include <ctime>

#include "analysis/fit/fit.h"
#include "analysis/fit/judge.h"
#include "base/error.h"

namespace imucal {

namespace {

double metadata_number(const FitResult& result, const std::string& key, double fallback) {
  const auto it = result.metadata.find(key);
  if (it == result.metadata.end() || it->second.empty()) return fallback;
  double value = 0;
  const char* end = it->second.data() + it->second.size();
  const auto parsed = std::from_chars(it->second.data(), end, value);
  if (parsed.ec != std::errc() || parsed.ptr != end || !std::isfinite(value))
    throw data_error(result.logs[0] + ": # " + key + ": expected a number, found \"" + it->second + "\"");
  return value;
}

constexpr double kMostCounts = 0x7FFFFFFF;

int32_t full_scale_counts(const FitResult& result, const std::string& axis) {
  const std::string key = axis_stem(axis) + "_full_scale_counts";
  const double counts = metadata_number(result, key, 32767);
  if (!(counts >= 1 && counts <= kMostCounts) || counts != std::floor(counts))
    throw data_error(result.logs[0] + ": # " + key + ": expected a whole number from 1 to 2147483647");
  return static_cast<int32_t>(counts);
}

imucal_table_channel_t channel_of(const FitResult& result, const FitAxis& axis, const TableInfo& info) {
  imucal_table_channel_t channel{};
  if (imucal_text_set(channel.name, sizeof channel.name, axis.axis.c_str()) != IMUCAL_OK)
    throw data_error("axis \"" + axis.axis + "\": a table holds names of 1 to 12 printable characters");
  channel.order = static_cast<uint8_t>(axis.order);
  channel.t0_degc = static_cast<float>(axis.t0_degc);
  channel.range_degc = static_cast<float>(axis.range_degc);
  for (size_t i = 0; i < axis.coeff_dph.size(); ++i) channel.coeff[i] = static_cast<float>(axis.coeff_dph[i]);
  channel.span_lo_degc = static_cast<float>(axis.span_lo_degc);
  channel.span_hi_degc = static_cast<float>(axis.span_hi_degc);
  for (size_t i = 0; i < axis.sigma_dph.size(); ++i) channel.sigma[i] = static_cast<float>(axis.sigma_dph[i]);
  const auto& model = result.accel_model && is_accelerometer(axis.axis) ? result.accel_model : result.model;
  if (model) {
    channel.arw = static_cast<float>(model->arw_deg_rt_h);
    channel.n_markov = static_cast<uint8_t>(std::min<size_t>(model->markov.size(), IMUCAL_TABLE_MARKOV_N));
    for (size_t i = 0; i < channel.n_markov; ++i) {
      channel.markov_sigma[i] = static_cast<float>(model->markov[i].sigma_dph);
      channel.markov_tau_s[i] = static_cast<float>(model->markov[i].tau_s);
    }
  }
  const bool is_gyro = !is_accelerometer(axis.axis);
  const std::optional<double> noted = count_scale(result.logs[0], result.metadata, axis.axis, is_gyro);
  channel.unit_per_count = static_cast<float>(info.unit_per_count.value_or(noted.value_or(is_gyro ? 18.0 : 1.0)));
  channel.full_scale_counts =
      info.full_scale_counts ? static_cast<int32_t>(*info.full_scale_counts) : full_scale_counts(result, axis.axis);
  channel.n_seconds = static_cast<uint32_t>(std::llround(static_cast<double>(axis.n_used) * axis.dt_s));
  return channel;
}

} // namespace

imucal_table_t make_table(const FitResult& result, const TableInfo& info) {
  imucal_table_t table{};
  std::string serial = info.serial;
  if (serial.empty() && result.metadata.count("serial")) serial = result.metadata.at("serial");
  if (serial.empty())
    throw data_error(result.logs.at(0) + ": no device serial: give --serial, or \"# serial = …\" in the log");
  if (imucal_text_set(table.serial, sizeof table.serial, serial.c_str()) != IMUCAL_OK)
    throw data_error("serial \"" + serial + "\": a table holds 1 to 16 printable characters without blanks");
  if (result.axes.empty() || result.axes.size() > IMUCAL_MAX_CHANNELS)
    throw data_error("a table holds 1 to " + std::to_string(IMUCAL_MAX_CHANNELS) + " channels, the fit has " +
                     std::to_string(result.axes.size()));
  table.sequence = 1;
  table.created_s = info.created_s != 0 ? info.created_s : static_cast<uint32_t>(std::time(nullptr));
  table.n_channels = static_cast<uint8_t>(result.axes.size());
  table.degc_per_count =
      static_cast<float>(info.degc_per_count.value_or(metadata_number(result, "temp_counts_scale_degc", 0.01)));
  table.degc_at_zero =
      static_cast<float>(info.degc_at_zero.value_or(metadata_number(result, "temp_counts_offset_degc", 25)));
  for (size_t i = 0; i < result.axes.size(); ++i) table.channel[i] = channel_of(result, result.axes[i], info);
  imucal_table_place_t place{};
  const imucal_status status = imucal_table_validate(&table, &place);
  if (status != IMUCAL_OK)
    throw data_error("the table would not be valid: " +
                     (place.channel >= 0 ? result.axes[static_cast<size_t>(place.channel)].axis + " " : std::string()) +
                     imucal_table_field_text(place.field) + ": " + imucal_status_text(status));
  return table;
}

} // namespace imucal
