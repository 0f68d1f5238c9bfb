// SPDX-License-Identifier: MIT
#include "io/log.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <ostream>
#include <unordered_map>

#include "base/axis_unit.h"
#include "base/error.h"
#include "base/format.h"
#include "base/median.h"
#include "base/suggest.h"
#include "base/units.h"
#include "io/input.h"
#include "io/notice.h"
#include "io/number.h"
#include "io/output.h"
#include "io/raw_log.h"

namespace imucal {

namespace {

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();
constexpr double kMaxJumpS = 7 * 86400.0;   // a longer step of the time is a clock that was set
constexpr double kMaxSpanS = 366 * 86400.0; // a year of seconds still fits into memory
constexpr double kMinTempDegc = -273.15, kMaxTempDegc = 2000;
constexpr size_t kStepProbe = 10;         // steps by which the usual one is known
constexpr double kMostOffSecond = 0.05;   // as diagnose and the replay have it
constexpr double kMaxValue = 1e12;        // of a rate or another column, and of what a count means
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

const UnitSuffix* unit_of(const std::string& name) {
  const auto* unit =
      std::find_if(std::begin(kUnits), std::end(kUnits), [&](const UnitSuffix& u) { return ends_with(name, u.text); });
  return unit == std::end(kUnits) ? nullptr : unit;
}

// gx_dps -> gx_dph, ax_ms2 -> ax_mg: rates are held in dph, accelerations in mg.  Other names stay.
std::string name_inside(const std::string& name) {
  const UnitSuffix* unit = unit_of(name);
  if (!unit) return name;
  return name.substr(0, name.size() - std::strlen(unit->text)) + (unit->is_gyro ? "_dph" : "_mg");
}

// What a column after t_s and temp_degc means.
struct Column {
  enum Kind { kAxis, kFlags, kAuxiliary, kCounts } kind = kAxis;
  size_t index = 0; // axis the column belongs to
  std::string name; // as in the file
  double to_internal = 1;
};

bool is_raw(const std::vector<Column>& columns) {
  return std::any_of(columns.begin(), columns.end(), [](const Column& c) { return c.kind == Column::kCounts; });
}

// Lines of a file with their numbers, out of a buffer that holds whole lines however long they are.
class LineReader {
public:
  explicit LineReader(const std::string& path) : path_(path), file_(path) {}

  bool next() {
    has_line_end_ = ready() != nullptr;
    if (!has_line_end_ && at_ == filled_) return false;
    const char* begin = buffer_.data() + at_;
    const size_t end = has_line_end_ ? at_ + index_of_line_end(begin, filled_ - at_) : filled_;
    line_.assign(begin, end - at_);
    at_ = end + has_line_end_;
    if (++number_ == 1) strip_byte_order_mark(path_, &line_);
    if (!line_.empty() && line_.back() == '\r') line_.pop_back();
    return true;
  }

  // The unread text where it begins with a whole line, else nullptr: the last line, without its end, or none is left.
  const char* ready() {
    if (at_ >= whole_) fill();
    return at_ < whole_ ? buffer_.data() + at_ : nullptr;
  }
  // A line read from ready() on, up to its end at `end`.
  void take(const char* end) {
    at_ = static_cast<size_t>(end - buffer_.data()) + 1;
    ++number_;
  }

  // Of the line that next() gave: false where the file ends in it, perhaps inside a number ("3354" of 33541).
  bool is_whole() const { return has_line_end_; }
  // About as many lines as are still to come; 0: unknown.
  size_t expected_lines() {
    const char* at = ready();
    if (at == nullptr || file_.size() == 0) return 0;
    const size_t n_bytes = std::min(whole_ - at_, kSample);
    const auto n = static_cast<size_t>(std::count(at, at + n_bytes, '\n'));
    return n == 0 ? 0 : std::min(file_.size() / (n_bytes / n) + 1, kMostExpected);
  }
  long number() const { return number_; }
  const std::string& line() const { return line_; }
  std::string place() const { return input_name(path_) + ":" + std::to_string(std::max(1L, number_)); }
  [[noreturn]] void fail(const std::string& problem) const { throw data_error(place() + ": " + problem); }

private:
  static constexpr size_t kMostExpected = size_t{1} << 24, kSample = size_t{1} << 15;

  static size_t index_of_line_end(const char* from, size_t size) {
    return static_cast<size_t>(static_cast<const char*>(std::memchr(from, '\n', size)) - from);
  }

  // Moves what is unread to the front and reads on until a line end is there or the file is at its end.
  void fill() {
    std::memmove(buffer_.data(), buffer_.data() + at_, filled_ - at_);
    filled_ -= at_;
    at_ = whole_ = 0;
    while (whole_ == 0) {
      if (filled_ == buffer_.size() - kNumberPadding) buffer_.resize(2 * buffer_.size());
      const size_t n = file_.read(buffer_.data() + filled_, buffer_.size() - kNumberPadding - filled_);
      if (n == 0) return;
      const void* last = memrchr(buffer_.data() + filled_, '\n', n);
      if (last) whole_ = static_cast<size_t>(static_cast<const char*>(last) - buffer_.data()) + 1;
      filled_ += n;
    }
  }

  std::string path_;
  Input file_;
  std::vector<char> buffer_ = std::vector<char>((size_t{1} << 18) + kNumberPadding);
  size_t at_ = 0, whole_ = 0, filled_ = 0; // unread text from at_, whole lines up to whole_
  std::string line_;
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
void read_metadata(const LineReader& in, std::map<std::string, std::string>* metadata) {
  std::string rest = trimmed(in.line().substr(1));
  while (!rest.empty()) {
    const size_t equals = rest.find('=');
    if (equals == std::string::npos) return; // a plain comment
    const std::string key = trimmed(rest.substr(0, equals));
    std::string value = rest.substr(equals + 1);
    const size_t start = value.find_first_not_of(' ');
    value = start == std::string::npos ? "" : value.substr(start);
    const size_t gap = value.find("  ");
    const bool more = gap != std::string::npos && value.find('=', gap) != std::string::npos;
    const std::string text = printable(trimmed(more ? value.substr(0, gap) : value));
    const std::string& first = metadata->emplace(printable(key), text).first->second;
    if (text != first)
      in.fail("# " + printable(key) + " = " + shortened(text) + ": a line before says " + shortened(first) +
              "; leave the one that is right");
    rest = more ? trimmed(value.substr(gap)) : "";
  }
}

// What the metadata say of a column of counts.  unit null: nothing.
struct CountScale {
  const UnitSuffix* unit = nullptr;
  std::string key;
  double to_internal = 0; // dph or mg of one count
};

// `refuse` throws what it is told.  wants_gyro: only units of gyros (false: of accelerometers); empty: any.
template <class Refuse>
CountScale scale_of_counts(const std::string& column, const std::map<std::string, std::string>& metadata,
                           std::optional<bool> wants_gyro, const Refuse& refuse) {
  CountScale scale;
  for (const UnitSuffix& unit : kUnits) {
    const auto stated = metadata.find(column + "_scale" + unit.text);
    if (stated == metadata.end() || wants_gyro.value_or(unit.is_gyro) != unit.is_gyro) continue;
    const auto& [key, text] = *stated;
    if (scale.unit) refuse("# " + scale.key + " and # " + key + " stand for one column: leave the one that is right");
    const char* last = text.data() + text.size();
    double per_count = 0;
    const auto result = std::from_chars(text.data(), last, per_count);
    if (result.ec != std::errc() || result.ptr != last || !(per_count > 0) || !std::isfinite(per_count))
      refuse("# " + key + ": expected a positive number, found \"" + text + "\"");
    scale = {&unit, key, per_count * unit.to_internal};
    if (scale.to_internal > kMaxValue || scale.to_internal < 1 / kMaxValue)
      refuse("# " + key + ": " + text + " is no scale of a sensor's count");
  }
  return scale;
}

// The axis that a column of counts becomes; its scale is in the metadata before the header.
LogAxis raw_axis(const LineReader& in, const std::string& name, const std::map<std::string, std::string>& metadata) {
  const CountScale scale =
      scale_of_counts(name, metadata, std::nullopt, [&](const std::string& problem) { in.fail(problem); });
  if (!scale.unit)
    in.fail("column \"" + name + "\" needs its scale before the header, for example \"# " + name + "_scale_dph = 18\"");
  LogAxis axis;
  axis.name = name.substr(0, name.size() - std::strlen("_counts")) + (scale.unit->is_gyro ? "_dph" : "_mg");
  axis.is_gyro = scale.unit->is_gyro;
  axis.to_internal = scale.to_internal;
  return axis;
}

// Beside a column of the name that it would have inside, a column keeps its own.
LogAxis axis_of(const std::string& column, const UnitSuffix& unit, const std::vector<std::string>& columns) {
  LogAxis axis;
  axis.is_gyro = unit.is_gyro;
  const auto is_twin = [&](const std::string& other) {
    return other != column && unit_of(other) && name_inside(other) == name_inside(column);
  };
  const bool has_twin = std::any_of(columns.begin(), columns.end(), is_twin);
  axis.name = has_twin ? column : name_inside(column);
  axis.to_internal = has_twin ? unit.to_internal : 1;
  return axis;
}

// The axis of gx_flags is gx_dph (or gx_dps, …).
size_t axis_of_flags(const LineReader& in, const std::string& column, const std::vector<LogAxis>& axes) {
  const std::string stem = column.substr(0, column.size() - std::strlen("_flags"));
  size_t found = axes.size();
  for (size_t a = 0; a < axes.size(); ++a) {
    const std::string& name = axes[a].name;
    if (axis_stem(name) != stem) continue;
    if (found < a)
      in.fail("column \"" + column + "\" belongs to " + axes[found].name + " and to " + name +
              ": give each of the two a name of its own");
    found = a;
  }
  if (found == axes.size()) in.fail("column \"" + column + "\" belongs to no axis");
  return found;
}

std::vector<Column> columns_of(const LineReader& in, Log* log) {
  const std::vector<std::string> names = split(in.line());
  if (names.size() < 3 || names[0] != "t_s" || names[1] != "temp_degc")
    in.fail("the header must be t_s,temp_degc,<axis>_dph,… ; found \"" + shortened(in.line()) +
            "\"; other formats are read by imucal import FILE -o LOG.csv");
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
    const UnitSuffix* unit = unit_of(name);
    if (!unit) {
      columns.push_back({Column::kAuxiliary, 0, name});
      continue;
    }
    columns.push_back({Column::kAxis, log->axes.size(), name, unit->to_internal});
    log->axes.push_back(axis_of(name, *unit, names));
  }
  for (Column& column : columns)
    if (column.kind == Column::kFlags) column.index = axis_of_flags(in, column.name, log->axes);
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
  if (std::abs(value) > kMaxValue)
    in.fail("column " + column.name + ": is beyond +-1e12, as no rate is: mend the number, or leave it empty");
  if (column.kind != Column::kFlags) return;
  const bool is_bits = std::isnan(value) || (value >= 0 && value <= 255 && value == std::floor(value));
  if (!is_bits) in.fail("column " + column.name + ": expected whole bits 0..255");
}

// The rows of a log after its header, each checked.
class RowReader {
public:
  explicit RowReader(const std::string& path) : in_(path) { header_.path = path == "-" ? path : input_name(path); }

  // Reads up to the header line and with it.
  void read_header() {
    while (in_.next()) {
      if (is_no_row()) continue;
      const auto version = header_.metadata.find("imucal-log");
      if (version != header_.metadata.end() && version->second != "1")
        in_.fail("log version " + version->second + " is not known to this program (it knows 1)");
      columns_ = columns_of(in_, &header_);
      fields_.resize(columns_.size() + 2);
      has_flags_ =
          std::any_of(columns_.begin(), columns_.end(), [](const Column& c) { return c.kind == Column::kFlags; });
      header_.expected_rows = in_.expected_lines();
      return;
    }
    in_.fail("empty log: no header line (t_s,temp_degc,…)");
  }

  bool next() {
    const char* at = in_.ready();
    if ((at == nullptr || !read_plain(at)) && !read_text()) {
      if (n_rows_ == 0) in_.fail("empty log: a header and no whole row");
      return false;
    }
    check_time_and_temperature();
    if (!is_small_ || has_flags_)
      for (size_t c = 0; c < columns_.size(); ++c) check_value(in_, columns_[c], fields_[c + 2]);
    ++n_rows_;
    return true;
  }

  const LineReader& in() const { return in_; }
  const Log& header() const { return header_; }
  const std::vector<Column>& columns() const { return columns_; }
  double t_s() const { return fields_[0]; }
  double temp_degc() const { return fields_[1]; }
  const double* values() const { return &fields_[2]; } // one per column after t_s and temp_degc

private:
  // A blank line or a comment.
  bool is_no_row() {
    if (trimmed(in_.line()).empty()) return true;
    if (in_.line()[0] != '#') return false;
    if (in_.is_whole()) read_metadata(in_, &header_.metadata);
    return true;
  }

  // A whole line of numbers and nothing else; false, nothing taken, where it holds something else.
  bool read_plain(const char* at) {
    const size_t n_fields = fields_.size();
    Field field{};
    ends_.begin_line(at);
    is_small_ = true;
    for (size_t f = 0; f < n_fields; ++f) {
      const bool is_last = f + 1 == n_fields;
      if (!ends_.find(at, &field) || *field.end != (is_last ? '\n' : ',')) return false;
      at = field.end + 1;
      if (is_last) leave_carriage_return_out(&field);
      if (plain_number(field, &fields_[f])) continue;
      if (!any_number(field, &fields_[f])) return false;
      is_small_ = false;
    }
    in_.take(at - 1);
    return true;
  }

  static bool any_number(const Field& field, double* value) {
    const auto result = std::from_chars(field.begin, field.end, *value);
    return result.ec == std::errc() && result.ptr == field.end && std::isfinite(*value);
  }

  // A row without line end may be cut off inside its last number, which then is another one: nobody can see it.
  bool leave_out_cut_row() {
    notice(in_.place() + ": the last row has no line end, as where writing was cut off, and is left out; end it with a "
                         "line end if it is whole");
    return false;
  }

  [[noreturn]] void fail_of_fields(size_t found) const {
    in_.fail("expected " + std::to_string(fields_.size()) + " fields, found " + std::to_string(found) +
             ": one for each column of the header; mend the row, or delete it");
  }

  // The next row whatever its numbers look like; false at the end of the file.
  bool read_text() {
    do {
      if (!in_.next()) return false;
    } while (is_no_row());
    if (!in_.is_whole()) return leave_out_cut_row();
    is_small_ = false;
    const char* at = in_.line().data();
    const char* const end = at + in_.line().size();
    for (size_t f = 0; f < fields_.size(); ++f) {
      const bool is_last = f + 1 == fields_.size();
      const char* comma = is_last ? end : static_cast<const char*>(std::memchr(at, ',', static_cast<size_t>(end - at)));
      if (!comma) fail_of_fields(f + 1);
      if (is_last && std::memchr(at, ',', static_cast<size_t>(end - at)))
        fail_of_fields(fields_.size() + static_cast<size_t>(std::count(at, end, ',')));
      fields_[f] = parse_number(in_, at, comma, f == 0 ? kTime : f == 1 ? kTemp : columns_[f - 2].name);
      at = comma + 1;
    }
    return true;
  }

  void check_time_and_temperature() {
    const double t_s = fields_[0];
    if (std::isnan(t_s)) in_.fail("t_s is empty");
    if (fields_[1] < kMinTempDegc || fields_[1] > kMaxTempDegc)
      in_.fail("temp_degc is no temperature in degrees Celsius");
    if (n_rows_ == 0) first_t_s_ = t_s;
    if (n_rows_ > 0 && t_s - last_t_s_ > kMaxJumpS)
      in_.fail("t_s jumps by " + std::to_string((t_s - last_t_s_) / 86400) +
               " days; cut the log where its clock was set, or bring its times to seconds");
    if (n_rows_ > 0 && t_s <= last_t_s_)
      in_.fail("t_s does not increase; sort the log or cut it where the clock was set back");
    if (n_rows_ > 0 && n_rows_ <= kStepProbe) note_step(t_s - last_t_s_);
    if (t_s - first_t_s_ > kMaxSpanS) in_.fail("the log spans more than 366 days; cut it");
    last_t_s_ = t_s;
  }

  // Every program takes a row as the mean over the usual step; a log has one a second.
  void note_step(double step_s) {
    first_steps_s_.push_back(step_s);
    if (first_steps_s_.size() < kStepProbe || is_raw(columns_)) return;
    const double usual_s = median(first_steps_s_);
    if (std::abs(usual_s / 1000 - 1) < 0.01)
      notice(header_.path + ": rows are 1000 s apart: are these milliseconds? t_s is in seconds");
    if (std::abs(usual_s / 1000 - 1) < 0.01 || std::abs(usual_s - 1) <= kMostOffSecond) return;
    const std::string text = format(
        ": rows are %.6g s apart, not 1 s: each is taken as the mean over %.6g s. %s", usual_s, usual_s,
        usual_s > 1 ? "If seconds were left out, noise and errors come out too large: give every second, or means"
                    : "If they are readings and no means, average them to seconds");
    notice(header_.path + text);
  }

  const std::string kTime = "t_s", kTemp = "temp_degc";
  LineReader in_;
  Log header_;
  std::vector<Column> columns_;
  bool has_flags_ = false;
  std::vector<double> fields_;
  bool is_small_ = false; // all numbers of the row are plain ones, which are far below the largest allowed
  FieldEnds ends_{','};
  double first_t_s_ = 0, last_t_s_ = 0;
  std::vector<double> first_steps_s_;
  size_t n_rows_ = 0;
};

} // namespace

bool Log::has_temperature() const {
  return std::any_of(temp_degc.begin(), temp_degc.end(), [](double t) { return std::isfinite(t); });
}

std::optional<double> count_scale(const std::string& path, const std::map<std::string, std::string>& metadata,
                                  const std::string& axis, bool is_gyro) {
  const CountScale scale =
      scale_of_counts(axis_stem(axis) + "_counts", metadata, is_gyro,
                      [&](const std::string& problem) { throw data_error(path + ": " + problem); });
  if (scale.unit) return scale.to_internal;
  return std::nullopt;
}

const LogAxis& Log::axis(const std::string& name) const {
  std::string list;
  std::vector<std::string> names;
  for (const LogAxis& a : axes) {
    if (a.name == name) return a;
    list += (list.empty() ? "" : ", ") + a.name;
    names.push_back(a.name);
  }
  for (const LogAxis& a : axes)
    if (a.name == name_inside(name)) return a;
  throw data_error(path + ": no axis \"" + name + "\"" + did_you_mean(name, names) + " (there are: " + list + ")");
}

namespace {

constexpr size_t kStretch = 64;       // rows
constexpr size_t kFewestChanges = 48; // in a stretch
constexpr double kSameNoise = 0.2;    // of its standard deviation: rates that differ by less are one record

// What the noise does from row to row: a bias that follows a ramp has none of it, and rises in all logs alike.
double bend_of(const double* x) {
  return x[0] - 2 * x[1] + x[2];
}
// Per row, for the stretch that begins there: one bit for each bend, set where it is positive.  0: a rate is missing there, or it
// changes seldom.
std::vector<uint64_t> bends_of(const std::vector<double>& x) {
  std::vector<uint64_t> out(x.size(), 0);
  uint64_t bends = 0;
  size_t n_changes = 0, n_missing = kStretch; // among the last rows
  std::vector<char> changes(x.size() + 1, 0);
  for (size_t i = 0; i + 2 < x.size(); ++i) {
    const double bend = bend_of(&x[i]);
    bends = bends << 1 | (bend > 0 ? 1 : 0);
    changes[i] = x[i + 1] != x[i];
    n_changes += changes[i];
    n_missing = std::isfinite(bend) ? n_missing - (n_missing > 0) : kStretch;
    if (i >= kStretch) n_changes -= changes[i - kStretch];
    if (n_missing == 0 && n_changes >= kFewestChanges) out[i + 1 - kStretch] = bends;
  }
  return out;
}
bool is_same_noise(const double* x, const double* y) {
  constexpr double kN = static_cast<double>(kStretch);
  double mean_apart = 0, square = 0, furthest = 0;
  for (size_t i = 0; i < kStretch; ++i) mean_apart += (x[i] - y[i]) / kN;
  for (size_t i = 0; i < kStretch; ++i) {
    square += std::pow(bend_of(x + i), 2) / (6 * kN); // of white noise: its variance
    furthest = std::max(furthest, std::fabs(x[i] - y[i] - mean_apart));
  }
  return furthest < kSameNoise * std::sqrt(square);
}

} // namespace

std::optional<std::pair<size_t, size_t>> shared_rows(const Log& a, const Log& b) {
  if (a.axes.empty() || b.axes.empty()) return std::nullopt;
  const std::vector<double>&x = a.axes[0].rate_dph, &y = b.axes[0].rate_dph;
  const std::vector<uint64_t> of_a = bends_of(x), of_b = bends_of(y);
  std::unordered_multimap<uint64_t, size_t> places;
  for (size_t i = 0; i < of_a.size(); i += kStretch)
    if (of_a[i]) places.emplace(of_a[i], i);
  for (size_t k = 0; k < of_b.size(); ++k) {
    const auto [first, end] = places.equal_range(of_b[k]);
    for (auto it = first; it != end; ++it)
      if (is_same_noise(&x[it->second], &y[k])) return std::pair{it->second, k};
  }
  return std::nullopt;
}

std::string shared_rows_text(const Log& a, const Log& b) {
  const auto shared = shared_rows(a, b);
  if (!shared) return "";
  return format(
      "%s: its rates from %.9g s on are those of %s from %.9g s on: both hold a part of one record, which must not "
      "count twice; cut it off one of them",
      b.path.c_str(), b.t_s[shared->second], a.path.c_str(), a.t_s[shared->first]);
}

// The same value, or a missing one, in every row; sets *moves where they are not one and the same all along.
static bool are_equal(const std::vector<double>& a, const std::vector<double>& b, bool* moves) {
  if (a.size() != b.size()) return false;
  double first = std::nan("");
  for (size_t i = 0; i < a.size(); ++i) {
    if (a[i] != b[i] && !(std::isnan(a[i]) && std::isnan(b[i]))) return false;
    if (std::isnan(first)) first = a[i];
    *moves = *moves || (std::isfinite(a[i]) && a[i] != first);
  }
  return true;
}

bool same_values(const std::vector<double>& a, const std::vector<double>& b) {
  bool moves = false;
  return are_equal(a, b, &moves) && moves;
}

std::string twin_axes_text(const std::string& path, const std::string& axis, const std::string& twin) {
  return path + ": axes " + axis + " and " + twin +
         " are the same in every row: is one register or column read twice? Mend the recorder, or take one of them "
         "alone (--axis " +
         axis + ")";
}

bool same_rows(const Log& a, const Log& b) {
  const size_t n_axes = std::min(a.axes.size(), b.axes.size());
  bool moves = false; // two logs of a stuck sensor are alike, too
  for (size_t j = 0; j < n_axes; ++j)
    if (!are_equal(a.axes[j].rate_dph, b.axes[j].rate_dph, &moves)) return false;
  return moves;
}

std::string Log::place(size_t row) const {
  if (row < line.size()) return path + ":" + std::to_string(line[row]);
  return path + ": row at t_s = " + std::to_string(t_s[row]);
}

// Means over it would have rows enough in each: two of the usual steps and more, in whole seconds as people count them.
static long even_step_s(double usual_s) {
  for (const long s : {1, 2, 5, 10, 20, 30, 60, 120, 300, 600})
    if (static_cast<double>(s) >= 2 * usual_s) return s;
  return 3600;
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
                   " s; average the log to even steps, of " + std::to_string(even_step_s(dt_s)) + " s for instance");
}

double Log::dt_s() const {
  if (t_s.size() < 2) return 1.0;
  std::vector<double> steps(t_s.size() - 1);
  for (size_t i = 0; i + 1 < t_s.size(); ++i) steps[i] = t_s[i + 1] - t_s[i];
  std::nth_element(steps.begin(), steps.begin() + static_cast<long>(steps.size() / 2), steps.end());
  return steps[steps.size() / 2];
}

// The 1-s means of a log of samples.
static Log read_samples(RowReader* rows) {
  RawDecimator decimator(rows->header());
  while (rows->next()) {
    decimator.begin(rows->t_s(), rows->temp_degc(), rows->in().number());
    for (size_t c = 0; c < rows->columns().size(); ++c) {
      const Column& column = rows->columns()[c];
      const double value = rows->values()[c];
      if (column.kind == Column::kCounts) decimator.counts(column.index, value);
      if (column.kind == Column::kFlags) decimator.flags(column.index, std::isnan(value) ? 0 : static_cast<int>(value));
    }
    decimator.end();
  }
  return decimator.finish();
}

// Where the values of a column go.
struct Place {
  std::vector<double>* values = nullptr;
  std::vector<int>* flags = nullptr;
  double to_internal = 1;
};

static std::vector<Place> places_for(const std::vector<Column>& columns, Log* log) {
  std::vector<Place> places(columns.size());
  for (size_t c = 0; c < columns.size(); ++c) {
    Place& place = places[c];
    LogAxis& axis = log->axes[columns[c].index];
    if (columns[c].kind == Column::kAuxiliary) place.values = &log->auxiliary[columns[c].name];
    if (columns[c].kind == Column::kAxis) place.values = &axis.rate_dph, place.to_internal = columns[c].to_internal;
    if (columns[c].kind == Column::kFlags) place.flags = &axis.flags;
    if (place.values) place.values->reserve(log->expected_rows);
    if (place.flags) place.flags->reserve(log->expected_rows);
  }
  return places;
}

static Log read_means(RowReader* rows) {
  Log log = rows->header();
  log.t_s.reserve(log.expected_rows), log.line.reserve(log.expected_rows), log.temp_degc.reserve(log.expected_rows);
  const std::vector<Place> places = places_for(rows->columns(), &log);
  while (rows->next()) {
    log.t_s.push_back(rows->t_s());
    log.line.push_back(static_cast<uint32_t>(rows->in().number()));
    log.temp_degc.push_back(rows->temp_degc());
    const double* value = rows->values();
    for (const Place& place : places) {
      if (place.values) place.values->push_back(*value * place.to_internal);
      if (place.flags) place.flags->push_back(std::isnan(*value) ? 0 : static_cast<int>(*value));
      ++value;
    }
  }
  return log;
}

Log read_log(const std::string& path) {
  RowReader rows(path);
  rows.read_header();
  Log log = is_raw(rows.columns()) ? read_samples(&rows) : read_means(&rows);
  check_steps(log);
  return log;
}

// A raw log has too few seconds to need bounded memory: a hundredth of its rows.
static void scan_decimated(const Log& log, const std::function<void(const Log& header)>& header,
                           const std::function<void(const LogRow&)>& row) {
  check_steps(log);
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

void scan_log(const std::string& path, const std::function<void(const Log& header)>& header,
              const std::function<void(const LogRow&)>& row) {
  RowReader rows(path);
  rows.read_header();
  if (is_raw(rows.columns())) return scan_decimated(read_samples(&rows), header, row);
  std::vector<double> rate_dph(rows.header().axes.size());
  std::vector<int> flags(rate_dph.size(), 0);
  std::vector<Column> columns = rows.columns();
  header(rows.header());
  while (rows.next()) {
    const double* value = rows.values();
    for (const Column& column : columns) {
      if (column.kind == Column::kAxis) rate_dph[column.index] = *value * column.to_internal;
      if (column.kind == Column::kFlags) flags[column.index] = std::isnan(*value) ? 0 : static_cast<int>(*value);
      ++value;
    }
    row({rows.t_s(), rows.temp_degc(), rate_dph.data(), flags.data()});
  }
}

static void put_number(std::ostream& out, double value, double lsb) {
  if (std::isnan(value)) return;
  if (std::isinf(value)) throw data_error("a value of the log to write is infinite, and no program would read it");
  char text[40];
  // Shortest form that keeps the value to `lsb`, as far as a double has digits.
  const double rounded = std::round(value / lsb) * lsb;
  const int digits = std::clamp(2 + static_cast<int>(std::log10(std::abs(value) / lsb + 1)), 10, 16);
  const int n = std::snprintf(text, sizeof text, "%.*g", digits, rounded == 0 ? 0.0 : rounded);
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
      if (!a.flags.empty()) out << "," << axis_stem(a.name) << "_flags";
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
