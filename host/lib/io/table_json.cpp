// SPDX-License-Identifier: MIT
#include "io/table_json.h"

#include <charconv>
#include <cmath>
#include <cstring>
#include <ctime>
#include <iterator>
#include <sstream>

#include "base/error.h"
#include "io/input.h"
#include "io/json_file.h"
#include "io/output.h"
#include "num.h"

namespace imucal {

namespace {

template <size_t N> std::string fixed_text(const char (&field)[N]) {
  return std::string(field, strnlen(field, N));
}

bool is_binary(const std::string& path) {
  return path.size() > 4 && path.compare(path.size() - 4, 4, ".bin") == 0;
}

Json numbers(const float* values, size_t n) {
  Json list = Json::array();
  for (size_t i = 0; i < n; ++i) list.push_back(shortest(values[i]));
  return list;
}

// Seconds since 1970 to "2026-11-21T06:22:00Z" and back.
std::string utc_text(uint32_t s) {
  const time_t time = s;
  tm parts{};
  ::gmtime_r(&time, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

uint32_t utc_seconds(const JsonField& field) {
  tm parts{};
  const std::string text = field.text();
  const char* end = ::strptime(text.c_str(), "%Y-%m-%dT%H:%M:%SZ", &parts);
  if (!end || *end) field.refuse("expected a time such as \"2026-11-21T06:22:00Z\"");
  const time_t time = ::timegm(&parts);
  if (time < 0 || time > INT64_C(0xFFFFFFFF)) field.refuse("time outside 1970 to 2106");
  return static_cast<uint32_t>(time);
}

double evenly(float lo, float hi, size_t i, size_t n) {
  return static_cast<double>(lo) +
         (static_cast<double>(hi) - static_cast<double>(lo)) * static_cast<double>(i) / static_cast<double>(n - 1);
}

Json temperatures(const imucal_table_channel_t& channel) {
  Json list = Json::array();
  for (size_t i = 0; i < IMUCAL_TABLE_SIGMA_N; ++i)
    list.push_back(evenly(channel.span_lo_degc, channel.span_hi_degc, i, IMUCAL_TABLE_SIGMA_N));
  return list;
}

Json to_json(const imucal_table_channel_t& channel) {
  const std::string unit = channel_unit(channel);
  Json markov = Json::array();
  for (size_t i = 0; i < channel.n_markov; ++i)
    markov.push_back(
        {{"sigma_" + unit, shortest(channel.markov_sigma[i])}, {"tau_s", shortest(channel.markov_tau_s[i])}});
  return {{"axis", fixed_text(channel.name)},
          {"order", channel.order},
          {"t0_degc", shortest(channel.t0_degc)},
          {"range_degc", shortest(channel.range_degc)},
          {"coeff_" + unit, numbers(channel.coeff, channel.order + 1u)},
          {"scale_coeff", numbers(channel.scale_coeff, channel.scale_order + 1u)},
          {"span_degc", {shortest(channel.span_lo_degc), shortest(channel.span_hi_degc)}},
          {"temp_degc", temperatures(channel)},
          {"sigma_" + unit, numbers(channel.sigma, IMUCAL_TABLE_SIGMA_N)},
          {"model", {{"arw_deg_rt_h", shortest(channel.arw)}, {"markov", markov}}},
          {unit + "_per_count", shortest(channel.unit_per_count)},
          {"full_scale_counts", channel.full_scale_counts},
          {"n_seconds", channel.n_seconds}};
}

void set_text(char* to, size_t size, const JsonField& field) {
  if (imucal_text_set(to, size, field.text().c_str()) != IMUCAL_OK)
    field.refuse("expected 1 to " + std::to_string(size) + " printable characters without blanks");
}

float single(const JsonField& field) {
  const double value = field.number(-3e38, 3e38);
  return static_cast<float>(value);
}

// The elements of a list with lo to hi of them; returns how many.
size_t fill(const JsonField& field, float* values, size_t lo, size_t hi) {
  const std::vector<JsonField> elements = field.elements();
  if (elements.size() < lo || elements.size() > hi)
    field.refuse(std::to_string(elements.size()) + " numbers, expected " + std::to_string(lo) +
                 (lo == hi ? "" : " to " + std::to_string(hi)));
  for (size_t i = 0; i < elements.size(); ++i) values[i] = single(elements[i]);
  return elements.size();
}

void fill_model(const JsonField& field, const std::string& unit, imucal_table_channel_t* channel) {
  field.only({"arw_deg_rt_h", "markov"});
  channel->arw = single(field.at("arw_deg_rt_h"));
  const auto markov = field.find("markov");
  if (!markov) return;
  const std::vector<JsonField> terms = markov->elements();
  if (terms.size() > IMUCAL_TABLE_MARKOV_N)
    markov->refuse(std::to_string(terms.size()) + " terms, a table holds " + std::to_string(IMUCAL_TABLE_MARKOV_N));
  channel->n_markov = static_cast<uint8_t>(terms.size());
  for (size_t i = 0; i < terms.size(); ++i) {
    channel->markov_sigma[i] = single(terms[i].at("sigma_" + unit));
    channel->markov_tau_s[i] = single(terms[i].at("tau_s"));
  }
}

void refuse_unknown(const JsonField& field, const std::string& unit) {
  const std::string coeff = "coeff_" + unit, sigma = "sigma_" + unit, scale = unit + "_per_count";
  field.only({"axis", "order", "t0_degc", "range_degc", coeff.c_str(), "scale_coeff", "span_degc", "temp_degc",
              sigma.c_str(), "model", scale.c_str(), "full_scale_counts", "n_seconds", "residual_rms_dph",
              "residual_rms_mg", "accepted", "error_factor"});
}

TableNote note_from_json(const JsonField& field) {
  TableNote note;
  note.axis = field.at("axis").text();
  if (const auto accepted = field.find("accepted"))
    for (const JsonField& rule : accepted->elements()) note.accepted.push_back(rule.text());
  if (const auto factor = field.find("error_factor")) note.error_factor = factor->number(1, 1e6);
  return note;
}

imucal_table_channel_t channel_from_json(const JsonField& field) {
  imucal_table_channel_t channel{};
  set_text(channel.name, sizeof channel.name, field.at("axis"));
  const std::string unit = channel_unit(channel);
  refuse_unknown(field, unit);
  channel.order = static_cast<uint8_t>(field.at("order").integer(0, IMUCAL_MAX_ORDER));
  channel.t0_degc = single(field.at("t0_degc"));
  channel.range_degc = single(field.at("range_degc"));
  fill(field.at("coeff_" + unit), channel.coeff, channel.order + 1u, channel.order + 1u);
  if (const auto scale = field.find("scale_coeff")) {
    const size_t n = fill(*scale, channel.scale_coeff, 1, IMUCAL_TABLE_SCALE_N);
    channel.scale_order = static_cast<uint8_t>(n - 1);
  }
  float span[2];
  fill(field.at("span_degc"), span, 2, 2);
  channel.span_lo_degc = span[0];
  channel.span_hi_degc = span[1];
  fill(field.at("sigma_" + unit), channel.sigma, IMUCAL_TABLE_SIGMA_N, IMUCAL_TABLE_SIGMA_N);
  fill_model(field.at("model"), unit, &channel);
  channel.unit_per_count = single(field.at(unit + "_per_count"));
  channel.full_scale_counts = static_cast<int32_t>(field.at("full_scale_counts").integer(1, 0x7FFFFFFF));
  channel.n_seconds = static_cast<uint32_t>(field.at("n_seconds").integer(0, INT64_C(0xFFFFFFFF)));
  (void)note_from_json(field); // refused where it is not valid
  return channel;
}

std::string described(const imucal_table_t& table, imucal_table_place_t place) {
  if (place.channel < 0) return imucal_table_field_text(place.field);
  return "axes[" + std::to_string(place.channel) + "] (" + fixed_text(table.channel[place.channel].name) + ") " +
         imucal_table_field_text(place.field);
}

std::string text_of(float value) {
  std::ostringstream out;
  out << shortest(value);
  return out.str();
}

// Collects differences of one table field after another.
class Comparison {
public:
  std::vector<std::string> lines;
  std::string prefix;

  void number(const std::string& field, float left, float right) {
    if (imucal_bits_from_float(left) != imucal_bits_from_float(right) && !(left == right))
      lines.push_back(prefix + field + ": " + text_of(left) + " against " + text_of(right));
  }
  void whole(const std::string& field, long left, long right) {
    if (left != right)
      lines.push_back(prefix + field + ": " + std::to_string(left) + " against " + std::to_string(right));
  }
  void text(const std::string& field, const std::string& left, const std::string& right) {
    if (left != right) lines.push_back(prefix + field + ": " + left + " against " + right);
  }
  void list(const std::string& field, const float* left, const float* right, size_t n) {
    for (size_t i = 0; i < n; ++i) number(field + "[" + std::to_string(i) + "]", left[i], right[i]);
  }
};

void compare(const imucal_table_channel_t& a, const imucal_table_channel_t& b, Comparison* found) {
  const std::string unit = channel_unit(a);
  found->prefix = fixed_text(a.name) + " ";
  found->text("axis", fixed_text(a.name), fixed_text(b.name));
  found->whole("order", a.order, b.order);
  found->number("t0_degc", a.t0_degc, b.t0_degc);
  found->number("range_degc", a.range_degc, b.range_degc);
  found->list("coeff_" + unit, a.coeff, b.coeff, IMUCAL_MAX_COEFF);
  found->whole("scale_order", a.scale_order, b.scale_order);
  found->list("scale_coeff", a.scale_coeff, b.scale_coeff, IMUCAL_TABLE_SCALE_N);
  found->number("span_degc[0]", a.span_lo_degc, b.span_lo_degc);
  found->number("span_degc[1]", a.span_hi_degc, b.span_hi_degc);
  found->list("sigma_" + unit, a.sigma, b.sigma, IMUCAL_TABLE_SIGMA_N);
  found->number("model.arw_deg_rt_h", a.arw, b.arw);
  found->whole("model.markov", a.n_markov, b.n_markov);
  found->list("model.markov.sigma_" + unit, a.markov_sigma, b.markov_sigma, IMUCAL_TABLE_MARKOV_N);
  found->list("model.markov.tau_s", a.markov_tau_s, b.markov_tau_s, IMUCAL_TABLE_MARKOV_N);
  found->number(unit + "_per_count", a.unit_per_count, b.unit_per_count);
  found->whole("full_scale_counts", a.full_scale_counts, b.full_scale_counts);
  found->whole("n_seconds", a.n_seconds, b.n_seconds);
}

} // namespace

double shortest(float value) {
  if (!std::isfinite(value)) return static_cast<double>(value);
  char text[40];
  const auto written = std::to_chars(text, text + sizeof text, value);
  double read = 0;
  std::from_chars(text, written.ptr, read);
  return read;
}

std::string channel_unit(const imucal_table_channel_t& channel) {
  const std::string name = fixed_text(channel.name);
  const size_t at = name.rfind('_');
  return at == std::string::npos || at + 1 == name.size() ? "dph" : name.substr(at + 1);
}

Json to_json(const imucal_table_t& table, const std::vector<TableNote>& notes) {
  Json json = {{"imucal_table", IMUCAL_TABLE_VERSION},
               {"serial", fixed_text(table.serial)},
               {"sequence", table.sequence},
               {"created", utc_text(table.created_s)},
               {"degc_per_count", shortest(table.degc_per_count)},
               {"degc_at_zero", shortest(table.degc_at_zero)},
               {"axes", Json::array()}};
  for (size_t i = 0; i < table.n_channels; ++i) {
    Json axis = to_json(table.channel[i]);
    for (const TableNote& note : notes)
      if (fixed_text(table.channel[i].name) == note.axis)
        axis["accepted"] = note.accepted, axis["error_factor"] = note.error_factor;
    json["axes"].push_back(axis);
  }
  return json;
}

imucal_table_t table_from_json(const JsonField& field) {
  const JsonField version = field.version_of("imucal_table", "a table");
  if (version.integer(0, 1000000) != IMUCAL_TABLE_VERSION)
    version.refuse("table version not known to this program (it knows " + std::to_string(IMUCAL_TABLE_VERSION) +
                   "); update imucal or calibrate again");
  field.only({"imucal_table", "serial", "sequence", "created", "degc_per_count", "degc_at_zero", "axes"});
  imucal_table_t table{};
  set_text(table.serial, sizeof table.serial, field.at("serial"));
  table.sequence = static_cast<uint32_t>(field.at("sequence").integer(1, INT64_C(0xFFFFFFFE)));
  table.created_s = utc_seconds(field.at("created"));
  table.degc_per_count = single(field.at("degc_per_count"));
  table.degc_at_zero = single(field.at("degc_at_zero"));
  const JsonField axes = field.at("axes");
  const std::vector<JsonField> list = axes.elements();
  if (list.empty() || list.size() > IMUCAL_MAX_CHANNELS)
    axes.refuse(std::to_string(list.size()) + " axes, expected 1 to " + std::to_string(IMUCAL_MAX_CHANNELS));
  table.n_channels = static_cast<uint8_t>(list.size());
  for (size_t i = 0; i < list.size(); ++i) table.channel[i] = channel_from_json(list[i]);
  imucal_table_place_t where{-1, IMUCAL_FIELD_NONE};
  if (const imucal_status status = imucal_table_validate(&table, &where); status != IMUCAL_OK)
    throw data_error(field.place() + ": " + described(table, where) + ": " + imucal_status_text(status));
  return table;
}

imucal_table_t read_table(const std::string& path) {
  if (!is_binary(path)) return table_from_json(read_json(path));
  Input file(path);
  std::vector<uint8_t> bytes(2 * IMUCAL_TABLE_MAX_BYTES); // no table is that long
  size_t n_bytes = 0;
  while (const size_t n = file.read(reinterpret_cast<char*>(bytes.data()) + n_bytes, bytes.size() - n_bytes))
    n_bytes += n;
  bytes.resize(n_bytes);
  return table_from_bytes(bytes, path);
}

std::vector<uint8_t> table_bytes(const imucal_table_t& table, const std::string& place) {
  imucal_table_place_t where{-1, IMUCAL_FIELD_NONE};
  imucal_status status = imucal_table_validate(&table, &where);
  std::vector<uint8_t> bytes(IMUCAL_TABLE_MAX_BYTES);
  size_t length = 0;
  if (status == IMUCAL_OK) status = imucal_table_encode(&table, bytes.data(), bytes.size(), &length);
  if (status != IMUCAL_OK) throw data_error(place + ": " + described(table, where) + ": " + imucal_status_text(status));
  bytes.resize(length);
  return bytes;
}

imucal_table_t table_from_bytes(const std::vector<uint8_t>& bytes, const std::string& place) {
  imucal_table_t table{};
  imucal_table_place_t where{-1, IMUCAL_FIELD_NONE};
  if (const imucal_status status = imucal_table_decode(bytes.data(), bytes.size(), &table, &where); status != IMUCAL_OK)
    throw data_error(place + ": " +
                     (where.channel >= 0 ? "axes[" + std::to_string(where.channel) + "] " : std::string()) +
                     imucal_table_field_text(where.field) + ": " + imucal_status_text(status));
  return table;
}

std::vector<TableNote> read_table_notes(const std::string& path) {
  std::vector<TableNote> notes;
  if (is_binary(path)) return notes;
  for (const JsonField& axis : read_json(path).at("axes").elements()) {
    const TableNote note = note_from_json(axis);
    if (!note.accepted.empty()) notes.push_back(note);
  }
  return notes;
}

void write_table(const std::string& path, const imucal_table_t& table, const std::vector<TableNote>& notes) {
  if (!is_binary(path)) return write_json(path, to_json(table, notes));
  const std::vector<uint8_t> bytes = table_bytes(table, path);
  write_text(path, std::string(bytes.begin(), bytes.end()));
}

std::vector<std::string> table_differences(const imucal_table_t& left, const imucal_table_t& right) {
  Comparison found;
  found.text("serial", fixed_text(left.serial), fixed_text(right.serial));
  found.number("degc_per_count", left.degc_per_count, right.degc_per_count);
  found.number("degc_at_zero", left.degc_at_zero, right.degc_at_zero);
  found.whole("number of axes", left.n_channels, right.n_channels);
  for (size_t i = 0; i < std::min(left.n_channels, right.n_channels); ++i)
    compare(left.channel[i], right.channel[i], &found);
  return found.lines;
}

} // namespace imucal
