// SPDX-License-Identifier: MIT
// Logs (host/formats.md, Log): one row per second, rates are means over the second that ends at t_s.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace imucal {

// Bits of a *_flags column.
enum LogFlag : int { kSaturated = 1, kSamplesMissing = 2, kSensorFault = 4 };

struct LogAxis {
  std::string name; // of a log that was read in the units inside: "gx_dph" of a column gx_dps, "ax_mg" of ax_ms2
  double to_internal = 1.0; // unit of `name` -> dph (gyros) or mg (accelerometers)
  bool is_gyro = true;
  std::vector<double> rate_dph;        // one per row; NaN where missing.  mg for accelerometers.
  std::vector<int> flags;              // one per row; empty where the log has no such column
  std::vector<float> noise_ratio = {}; // one per row of a decimated raw log: imucal_sum_noise_ratio; else empty: 1
};

// A whole log in memory.  Rows keep the file's order; t_s is strictly increasing; a missing row is a gap
// (t_s jumps), never filled in.
struct Log {
  std::string path;
  std::map<std::string, std::string> metadata; // "# key = value" lines
  std::vector<double> t_s;
  std::vector<uint32_t> line;    // of the file, one per row; empty for logs that were not read
  std::vector<double> temp_degc; // NaN where empty
  std::vector<LogAxis> axes;
  std::map<std::string, std::vector<double>> auxiliary; // columns of other units (supply_v, …)
  size_t expected_rows = 0;                             // of the header that scan_log gives: a guess; 0: unknown

  size_t size() const { return t_s.size(); }
  bool has_temperature() const;                       // at least one finite temperature
  const LogAxis& axis(const std::string& name) const; // "gx_dps" too is gx_dph; data_error lists the axes there are
  double dt_s() const;                                // median step
  std::string place(size_t row) const;                // "log.csv:17" for messages
};

// What one count of an axis is, in dph (mg where it is no gyro), as metadata state it for columns of counts and recorders beside
// means: gx_counts_scale_dph, or in another unit of a column; empty: not stated.  data_error, which names `path`: stated twice,
// or no scale.
std::optional<double> count_scale(const std::string& path, const std::map<std::string, std::string>& metadata,
                                  const std::string& axis, bool is_gyro);

// A log whose lowest temperature is above it is in kelvin, most likely.
constexpr double kWarmerThanAnySensor_degc = 200;

// The same value, or a missing one, in every row, and not one and the same all along: one column given twice.
bool same_values(const std::vector<double>& a, const std::vector<double>& b);
// What is to be said of two axes of a log whose values are the same.
std::string twin_axes_text(const std::string& path, const std::string& axis, const std::string& twin);

// The same rates, one by one, of all axes that stand at the same place in both, and not one and the same rate in every row:
// one record given twice.
bool same_rows(const Log& a, const Log& b);
// The first rows, in a and in b, of 64 whose rates of the first axis are one record: two exports that overlap, perhaps printed
// with other digits or about another mean.  Rates that hardly change from row to row, as those of a coarse converter, are not
// compared.
std::optional<std::pair<size_t, size_t>> shared_rows(const Log& a, const Log& b);
// What is to be said of b where they share rows; "" where they do not.
std::string shared_rows_text(const Log& a, const Log& b);

// path "-": standard input.  gzip is unpacked, a UTF-8 byte-order mark and CR LF are read.
// A last row without line end is left out, with a notice (io/notice.h): it may be cut off inside a number.
// data_error names file and line: no header, text where a number belongs, NaN/inf, a rate or temperature that none can be,
// too few or too many fields, time that does not increase or jumps by more than a week, steps that are no multiples of the
// usual one in more than a tenth of the rows, no rows.
Log read_log(const std::string& path);

// The same row by row in bounded memory: `header` once (axes without data), then `row` for every line with
// t_s, temp_degc and one value per axis (dph or mg; NaN: missing).
struct LogRow {
  double t_s, temp_degc;
  const double* rate_dph;     // header.axes.size() values
  const int* flags = nullptr; // as many; 0 where the log has no flags column for the axis
};
void scan_log(const std::string& path, const std::function<void(const Log& header)>& header,
              const std::function<void(const LogRow&)>& row);

// Writes metadata, header and rows; rates with enough digits to read back within 1e-6 dph.
void write_log(const std::string& path, const Log& log);

} // namespace imucal
