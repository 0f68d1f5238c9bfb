// SPDX-License-Identifier: MIT
#include "io/log.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <ostream>

#include "base/error.h"
#include "base/suggest.h"
#include "base/units.h"
#include "io/input.h"
#include "io/json_file.h"
#include "io/raw_log.h"

namespace imucal {

namespace {

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();
constexpr double kMaxJumpS = 7 * 86400.0;   // a longer step of the time is a clock that was set
constexpr double kMaxSpanS = 366 * 86400.0; // a year of seconds still fits into memory
constexpr double kMinTempDegc = -273.15, kMaxTempDegc = 2000;
constexpr double kMaxValue = 1e12;        // of a rate or another column
constexpr double kMaxIrregularPart = 0.1; // of the steps that are no multiples of the median one
constexpr double kMaxStepError = 0.25;    // of the median step

struct UnitSuffix {
  const char* text;
  double to_internal;
  bool is_gyro;
};
constexpr UnitSuffix kUnits[] = {{"_dph", 1.0, true},
                                 {"_dps", kDphPerDps, true},
                                 {"_radps", kDphPerRadps, true},
                                 {"_mg", 1.0, false},
                                 {"_ms2", kMgPerMs2, false}};

bool ends_with(const std::string& text, const std::string& suffix) {
  return text.size() >= suffix.size() && text.compare(text.size() - suffix.size(), suffix.size(), suffix) == 0;
}

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r");
  if (first == std::string::npos) return "";
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

// What a column after t_s and temp_degc means.
struct Column {
  enum Kind { kAxis, kFlags, kAuxiliary, kCounts } kind = kAxis;
  size_t index = 0; // axis the column belongs to
  std::string name;
};

bool is_raw(const std::vector<Column>& columns) {
  return std::any_of(columns.begin(), columns.end(), [](const Column& c) { return c.kind == Column::kCounts; });
}

// Lines of a file with their numbers; fgets-free so that long lines are whole.
class LineReader {
public:
  explicit LineReader(const std::string& path) : path_(path), file_(path) {}
  bool next() {
    last_length_ = line_.size();
    has_line_end_ = false;
    line_.clear();
    for (;;) {
      if (at_ == filled_) {
        filled_ = file_.read(buffer_.data(), buffer_.size());
        at_ = 0;
        if (filled_ == 0) {
          if (line_.empty()) return false;
          break;
        }
      }
      const char* begin = buffer_.data() + at_;
      const void* newline = std::memchr(begin, '\n', filled_ - at_);
      if (newline) {
        const auto length = static_cast<size_t>(static_cast<const char*>(newline) - begin);
        line_.append(begin, length);
        at_ += length + 1;
        has_line_end_ = true;
        break;
      }
      line_.append(begin, filled_ - at_);
      at_ = filled_;
    }
    if (++number_ == 1) strip_byte_order_mark(path_, &line_);
    if (!line_.empty() && line_.back() == '\r') line_.pop_back();
    return true;
  }
  // A file that ends inside a row, perhaps inside a number: without line end and shorter than the row before.
  void refuse_cut_row() const {
    if (!has_line_end_ && line_.size() < last_length_)
      fail("the last row has no line end and is shorter than the one before: the file is cut off in it; take it off, "
           "or end "
           "it with a line end where it is whole");
  }
  long number() const { return number_; }
  const std::string& line() const { return line_; }
  [[noreturn]] void fail(const std::string& problem) const {
    throw data_error(input_name(path_) + ":" + std::to_string(std::max(1L, number_)) + ": " + problem);
  }

private:
  std::string path_;
  Input file_;
  std::vector<char> buffer_ = std::vector<char>(1 << 16);
  size_t at_ = 0, filled_ = 0;
  std::string line_;
  size_t last_length_ = 0;
  bool has_line_end_ = true;
  long number_ = 0;
};

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> fields;
  size_t at = 0;
  for (;;) {
    const size_t comma = line.find(',', at);
    fields.push_back(trimmed(line.substr(at, comma - at)));
    if (comma == std::string::npos) return fields;
    at = comma + 1;
  }
}

// Reads "# key = value  key = value": several pairs are separated by two blanks.
void read_metadata(const std::string& line, std::map<std::string, std::string>* metadata) {
  std::string rest = trimmed(line.substr(1));
  while (!rest.empty()) {
    const size_t equals = rest.find('=');
    if (equals == std::string::npos) return; // a plain comment
    const std::string key = trimmed(rest.substr(0, equals));
    std::string value = rest.substr(equals + 1);
    const size_t start = value.find_first_not_of(' ');
    value = start == std::string::npos ? "" : value.substr(start);
    const size_t gap = value.find("  ");
    const bool more = gap != std::string::npos && value.find('=', gap) != std::string::npos;
    (*metadata)[printable(key)] = printable(trimmed(more ? value.substr(0, gap) : value));
    rest = more ? trimmed(value.substr(gap)) : "";
  }
}

// The axis that a column of counts becomes; its scale is in the metadata before the header.
LogAxis raw_axis(const LineReader& in, const std::string& name, const std::map<std::string, std::string>& metadata) {
  const std::string stem = name.substr(0, name.size() - std::strlen("_counts"));
  for (const UnitSuffix& unit : kUnits) {
    const auto scale = metadata.find(name + "_scale" + unit.text);
    if (scale == metadata.end()) continue;
    const char* last = scale->second.data() + scale->second.size();
    LogAxis axis;
    double per_count = 0;
    const auto result = std::from_chars(scale->second.data(), last, per_count);
    if (result.ec != std::errc() || result.ptr != last || !(per_count > 0) || !std::isfinite(per_count))
      in.fail("# " + scale->first + ": expected a positive number, found \"" + scale->second + "\"");
    axis.name = stem + (unit.is_gyro ? "_dph" : "_mg");
    axis.is_gyro = unit.is_gyro;
    axis.to_internal = per_count * unit.to_internal;
    return axis;
  }
  in.fail("column \"" + name + "\" needs its scale before the header, for example \"# " + name + "_scale_dph = 18\"");
}

std::vector<Column> read_header(const LineReader& in, Log* log) {
  const std::vector<std::string> names = split(in.line());
  if (names.size() < 3 || names[0] != "t_s" || names[1] != "temp_degc")
    in.fail("the header must be t_s,temp_degc,<axis>_dph,… ; found \"" + shortened(in.line()) + "\"");
  std::vector<Column> columns;
  for (size_t i = 2; i < names.size(); ++i) {
    const std::string& name = names[i];
    if (name.empty() || printable(name) != name) in.fail("column " + std::to_string(i + 1) + " has no printable name");
    if (std::count(names.begin(), names.end(), name) > 1) in.fail("column \"" + name + "\" is given twice");
    if (ends_with(name, "_flags")) {
      columns.push_back({Column::kFlags, 0, name});
      continue;
    }
    if (ends_with(name, "_counts")) {
      columns.push_back({Column::kCounts, log->axes.size(), name});
      log->axes.push_back(raw_axis(in, name, log->metadata));
      continue;
    }
    const auto* unit = std::find_if(std::begin(kUnits), std::end(kUnits),
                                    [&](const UnitSuffix& u) { return ends_with(name, u.text); });
    if (unit == std::end(kUnits)) {
      columns.push_back({Column::kAuxiliary, 0, name});
      continue;
    }
    columns.push_back({Column::kAxis, log->axes.size(), name});
    LogAxis axis;
    axis.name = name;
    axis.to_internal = unit->to_internal;
    axis.is_gyro = unit->is_gyro;
    log->axes.push_back(axis);
  }
  for (Column& column : columns) {
    if (column.kind != Column::kFlags) continue;
    // gx_flags belongs to gx_dph (or gx_dps, …).
    const std::string stem = column.name.substr(0, column.name.size() - std::strlen("_flags")) + "_";
    column.index = log->axes.size();
    for (size_t a = 0; a < log->axes.size(); ++a)
      if (log->axes[a].name.rfind(stem, 0) == 0) column.index = a;
    if (column.index == log->axes.size()) in.fail("column \"" + column.name + "\" belongs to no axis");
  }
  if (log->axes.empty()) in.fail("no axis column; names end in their unit: _dph, _dps, _radps, _mg or _ms2");
  if (is_raw(columns) &&
      std::any_of(columns.begin(), columns.end(), [](const Column& c) { return c.kind == Column::kAxis; }))
    in.fail("raw counts and rates in one log: a log has samples or 1-s means");
  return columns;
}

double parse_number(const LineReader& in, const char* first, const char* last, const std::string& column) {
  while (first < last && (*first == ' ' || *first == '\t')) ++first;
  while (last > first && (last[-1] == ' ' || last[-1] == '\t')) --last;
  if (first == last) return kMissing;
  double value = 0;
  const auto result = std::from_chars(*first == '+' ? first + 1 : first, last, value);
  if (result.ec != std::errc() || result.ptr != last)
    in.fail("column " + column + ": expected a number, found \"" + shortened(std::string(first, last)) + "\"");
  if (!std::isfinite(value)) in.fail("column " + column + ": is not a finite number; leave a missing value empty");
  return value;
}

void check_value(const LineReader& in, const Column& column, double value) {
  if (std::abs(value) > kMaxValue) in.fail("column " + column.name + ": is beyond +-1e12");
  const bool is_bits = std::isnan(value) || (value >= 0 && value <= 255 && value == std::floor(value));
  if (column.kind == Column::kFlags && !is_bits) in.fail("column " + column.name + ": expected whole bits 0..255");
}

// Walks the file; `values` has one entry per column after t_s and temp_degc.
template <typename OnHeader, typename OnRow> void walk(const std::string& path, OnHeader on_header, OnRow on_row) {
  LineReader in(path);
  Log header;
  header.path = path;
  std::vector<Column> columns;
  bool has_header = false;
  std::vector<double> values;
  double last_t_s = -std::numeric_limits<double>::infinity();
  double first_t_s = 0;
  size_t n_rows = 0;
  while (in.next()) {
    const std::string& line = in.line();
    if (trimmed(line).empty()) continue;
    if (line[0] == '#') {
      read_metadata(line, &header.metadata);
      continue;
    }
    if (!has_header) {
      if (header.metadata.count("imucal-log") && header.metadata["imucal-log"] != "1")
        in.fail("log version " + header.metadata["imucal-log"] + " is not known to this program (it knows 1)");
      columns = read_header(in, &header);
      values.resize(columns.size());
      on_header(header, columns);
      has_header = true;
      continue;
    }
    const char* at = line.data();
    const char* const end = at + line.size();
    double t_s = 0, temp_degc = 0;
    const size_t n_fields = columns.size() + 2;
    if (n_rows > 0) in.refuse_cut_row();
    for (size_t f = 0; f < n_fields; ++f) {
      const char* comma =
          f + 1 < n_fields ? static_cast<const char*>(std::memchr(at, ',', static_cast<size_t>(end - at))) : end;
      if (!comma) in.fail("expected " + std::to_string(n_fields) + " fields, found " + std::to_string(f + 1));
      static const std::string kTime = "t_s", kTemp = "temp_degc";
      const double value = parse_number(in, at, comma, f == 0 ? kTime : f == 1 ? kTemp : columns[f - 2].name);
      (f == 0 ? t_s : f == 1 ? temp_degc : values[f - 2]) = value;
      at = comma + 1;
    }
    if (std::isnan(t_s)) in.fail("t_s is empty");
    if (temp_degc < kMinTempDegc || temp_degc > kMaxTempDegc) in.fail("temp_degc is no temperature in degrees Celsius");
    for (size_t c = 0; c < values.size(); ++c) check_value(in, columns[c], values[c]);
    if (t_s - last_t_s > kMaxJumpS && std::isfinite(last_t_s))
      in.fail("t_s jumps by " + std::to_string((t_s - last_t_s) / 86400) +
              " days; cut the log where its clock was set");
    if (t_s <= last_t_s) in.fail("t_s does not increase; sort the log or cut it where the clock was set back");
    if (n_rows == 0) first_t_s = t_s;
    if (t_s - first_t_s > kMaxSpanS) in.fail("the log spans more than 366 days; cut it");
    last_t_s = t_s;
    ++n_rows;
    on_row(in, t_s, temp_degc, values);
  }
  if (!has_header) in.fail("empty log: no header line (t_s,temp_degc,…)");
  if (n_rows == 0) in.fail("empty log: a header and no rows");
}

} // namespace

bool Log::has_temperature() const {
  return std::any_of(temp_degc.begin(), temp_degc.end(), [](double t) { return std::isfinite(t); });
}

const LogAxis& Log::axis(const std::string& name) const {
  std::string list;
  std::vector<std::string> names;
  for (const LogAxis& a : axes) {
    if (a.name == name) return a;
    list += (list.empty() ? "" : ", ") + a.name;
    names.push_back(a.name);
  }
  throw data_error(path + ": no axis \"" + name + "\"" + did_you_mean(name, names) + " (there are: " + list + ")");
}

std::string Log::place(size_t row) const {
  if (row < line.size()) return path + ":" + std::to_string(line[row]);
  return path + ": row at t_s = " + std::to_string(t_s[row]);
}

// Steps must be multiples of the median one, as well as a clock can keep them.  Of a few rows nobody can say which step
// is the usual one.
static void check_steps(const Log& log) {
  constexpr size_t kFewRows = 10;
  if (log.size() < kFewRows) return;
  const double dt_s = log.dt_s();
  size_t n_irregular = 0, first = 0;
  for (size_t i = 1; i < log.size(); ++i) {
    const double steps = (log.t_s[i] - log.t_s[i - 1]) / dt_s;
    if (steps >= 0.5 && std::abs(steps - std::round(steps)) <= kMaxStepError) continue;
    if (n_irregular++ == 0) first = i;
  }
  if (static_cast<double>(n_irregular) <= kMaxIrregularPart * static_cast<double>(log.size() - 1)) return;
  throw data_error(log.place(first) + ": the rows are irregular: " + std::to_string(n_irregular) + " of " +
                   std::to_string(log.size() - 1) + " steps are no multiple of the usual " + std::to_string(dt_s) +
                   " s; average the log to even seconds");
}

double Log::dt_s() const {
  if (t_s.size() < 2) return 1.0;
  std::vector<double> steps(t_s.size() - 1);
  for (size_t i = 0; i + 1 < t_s.size(); ++i) steps[i] = t_s[i + 1] - t_s[i];
  std::nth_element(steps.begin(), steps.begin() + static_cast<long>(steps.size() / 2), steps.end());
  return steps[steps.size() / 2];
}

Log read_log(const std::string& path) {
  Log log;
  std::vector<Column> columns;
  std::vector<std::vector<double>*> auxiliary;
  std::optional<RawDecimator> decimator;
  walk(
      path,
      [&](const Log& header, const std::vector<Column>& header_columns) {
        log = header;
        columns = header_columns;
        if (is_raw(columns)) {
          decimator.emplace(header);
          return;
        }
        for (const Column& c : columns)
          auxiliary.push_back(c.kind == Column::kAuxiliary ? &log.auxiliary[c.name] : nullptr);
      },
      [&](const LineReader& in, double t_s, double temp_degc, const std::vector<double>& values) {
        if (decimator) {
          decimator->begin(t_s, temp_degc, in.number());
          for (size_t c = 0; c < columns.size(); ++c) {
            if (columns[c].kind == Column::kCounts) decimator->counts(columns[c].index, values[c]);
            if (columns[c].kind == Column::kFlags)
              decimator->flags(columns[c].index, std::isnan(values[c]) ? 0 : static_cast<int>(values[c]));
          }
          decimator->end();
          return;
        }
        log.t_s.push_back(t_s);
        log.line.push_back(static_cast<uint32_t>(in.number()));
        log.temp_degc.push_back(temp_degc);
        for (size_t c = 0; c < columns.size(); ++c) {
          LogAxis* axis = columns[c].kind == Column::kAuxiliary ? nullptr : &log.axes[columns[c].index];
          if (columns[c].kind == Column::kAxis) axis->rate_dph.push_back(values[c] * axis->to_internal);
          if (columns[c].kind == Column::kFlags)
            axis->flags.push_back(std::isnan(values[c]) ? 0 : static_cast<int>(values[c]));
          if (auxiliary[c]) auxiliary[c]->push_back(values[c]);
        }
      });
  if (decimator) log = decimator->finish();
  check_steps(log);
  return log;
}

// A raw log has too few seconds to need bounded memory: a hundredth of its rows.
static void scan_decimated(const std::string& path, const std::function<void(const Log& header)>& header,
                           const std::function<void(const LogRow&)>& row) {
  const Log log = read_log(path);
  Log empty = log;
  empty.t_s.clear();
  empty.temp_degc.clear();
  for (LogAxis& axis : empty.axes) axis.rate_dph.clear(), axis.flags.clear();
  header(empty);
  std::vector<double> rate_dph(log.axes.size());
  std::vector<int> flags(log.axes.size());
  for (size_t k = 0; k < log.size(); ++k) {
    for (size_t a = 0; a < log.axes.size(); ++a)
      rate_dph[a] = log.axes[a].rate_dph[k], flags[a] = log.axes[a].flags.empty() ? 0 : log.axes[a].flags[k];
    row({log.t_s[k], log.temp_degc[k], rate_dph.data(), flags.data()});
  }
}

static bool is_raw_log(const std::string& path) {
  LineReader in(path);
  while (in.next())
    if (!trimmed(in.line()).empty() && in.line()[0] != '#') break;
  for (const std::string& name : split(in.line()))
    if (ends_with(name, "_counts")) return true;
  return false;
}

void scan_log(const std::string& path, const std::function<void(const Log& header)>& header,
              const std::function<void(const LogRow&)>& row) {
  // Standard input cannot be read twice.
  if (path == "-" || is_raw_log(path)) return scan_decimated(path, header, row);
  std::vector<Column> columns;
  std::vector<double> rate_dph, to_internal;
  std::vector<int> flags;
  walk(
      path,
      [&](const Log& log, const std::vector<Column>& header_columns) {
        columns = header_columns;
        rate_dph.resize(log.axes.size());
        flags.assign(log.axes.size(), 0);
        for (const LogAxis& a : log.axes) to_internal.push_back(a.to_internal);
        header(log);
      },
      [&](const LineReader&, double t_s, double temp_degc, const std::vector<double>& values) {
        for (size_t c = 0; c < columns.size(); ++c)
          if (columns[c].kind == Column::kAxis)
            rate_dph[columns[c].index] = values[c] * to_internal[columns[c].index];
          else if (columns[c].kind == Column::kFlags)
            flags[columns[c].index] = std::isnan(values[c]) ? 0 : static_cast<int>(values[c]);
        row({t_s, temp_degc, rate_dph.data(), flags.data()});
      });
}

static void put_number(std::ostream& out, double value, double lsb) {
  if (std::isnan(value)) return;
  char text[40];
  // Shortest form that keeps the value to `lsb`.
  const double rounded = std::round(value / lsb) * lsb;
  const int n = std::snprintf(text, sizeof text, "%.10g", rounded == 0 ? 0.0 : rounded);
  out.write(text, n);
}

void write_log(const std::string& path, const Log& log) {
  write_stream(path, [&](std::ostream& out) {
    out << "# imucal-log = 1\n";
    for (const auto& [key, value] : log.metadata)
      if (key != "imucal-log") out << "# " << key << " = " << value << "\n";
    out << "t_s,temp_degc";
    for (const LogAxis& a : log.axes) {
      out << "," << a.name;
      if (!a.flags.empty()) out << "," << a.name.substr(0, a.name.rfind('_')) << "_flags";
    }
    for (const auto& item : log.auxiliary) out << "," << item.first;
    out << "\n";
    for (size_t k = 0; k < log.size(); ++k) {
      put_number(out, log.t_s[k], 1e-6);
      out << ",";
      put_number(out, log.temp_degc[k], 1e-6);
      for (const LogAxis& a : log.axes) {
        out << ",";
        put_number(out, a.rate_dph[k] / a.to_internal, 1e-6 / a.to_internal);
        if (!a.flags.empty()) out << "," << a.flags[k];
      }
      for (const auto& item : log.auxiliary) {
        out << ",";
        put_number(out, item.second[k], 1e-9);
      }
      out << "\n";
    }
  });
}

} // namespace imucal
