// SPDX-License-Identifier: MIT
// Any bytes as a file of each format that the host programs read.  The first byte chooses the door (kDoors), the rest is
// the file.  A file is refused with a data error, or what was read holds together and survives being
// written and read again.  Anything else - another exception, a failed check, a sanitizer's finding - is a finding.
#pragma once
#include <sys/mman.h>
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "analysis/fit/fit.h"
#include "base/error.h"
#include "io/json_file.h"
#include "io/log.h"
#include "io/model.h"
#include "io/profile.h"
#include "io/table_json.h"
#include "physics/effects/effect.h"
#include "physics/effects/parameters.h"

namespace fuzz_files {

using namespace imucal;

inline constexpr char kDoors[] = "LMPTBEF"; // log, model, profile, table, binary table, effects, log that is fitted
inline constexpr double kFitSpanS = 2e5;    // a longer log is read, not fitted: the filter walks over every second

inline char last_refusal[400] = ""; // the message of the last file that was refused

inline void check(bool holds, int line, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "%s:%d: %s; last refusal: %s\n", __FILE__, line, what, last_refusal);
  std::abort();
}
#define FUZZ_CHECK(condition) check((condition), __LINE__, #condition)

// A file in memory; its name can be opened as often as one likes.
class MemoryFile {
public:
  MemoryFile() : fd_(memfd_create("fuzz", 0)), name_("/proc/self/fd/" + std::to_string(fd_)) { FUZZ_CHECK(fd_ >= 0); }
  ~MemoryFile() { ::close(fd_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  const std::string& holds(const void* bytes, size_t size) const {
    FUZZ_CHECK(::ftruncate(fd_, 0) == 0 && ::pwrite(fd_, bytes, size, 0) == static_cast<ssize_t>(size));
    return name_;
  }
  const std::string& holds(const std::string& text) const { return holds(text.data(), text.size()); }

private:
  int fd_;
  std::string name_;
};

inline JsonField again(const MemoryFile& file, const Json& json) {
  return read_json(file.holds(json.dump()));
}

// ---- logs ----

inline bool is_number_or_missing(double value) {
  return std::isnan(value) || std::abs(value) <= 1e30;
}

inline void check_log(const Log& log) {
  FUZZ_CHECK(log.size() > 0 && !log.axes.empty());
  FUZZ_CHECK(log.temp_degc.size() == log.size() && log.line.size() == log.size());
  for (size_t i = 1; i < log.size(); ++i) FUZZ_CHECK(log.t_s[i] > log.t_s[i - 1]);
  FUZZ_CHECK(log.t_s.back() - log.t_s.front() <= 367 * 86400.0);
  for (const LogAxis& axis : log.axes) {
    FUZZ_CHECK(axis.rate_dph.size() == log.size() && !axis.name.empty() && printable(axis.name) == axis.name);
    FUZZ_CHECK(axis.flags.empty() || axis.flags.size() == log.size());
    for (const double rate : axis.rate_dph) FUZZ_CHECK(is_number_or_missing(rate));
  }
  for (const auto& [name, values] : log.auxiliary) FUZZ_CHECK(values.size() == log.size());
  for (const auto& [key, value] : log.metadata) FUZZ_CHECK(printable(key) == key && printable(value) == value);
}

inline bool is_near(double a, double b, double step) {
  return (std::isnan(a) && std::isnan(b)) || std::abs(a - b) <= step + 1e-9 * std::abs(a);
}

inline void log_door(const std::string& path) {
  const Log log = read_log(path);
  check_log(log);
  size_t n_rows = 0;
  scan_log(
      path, [](const Log&) {}, [&](const LogRow&) { ++n_rows; });
  FUZZ_CHECK(n_rows == log.size());
  static const std::string name = "/tmp/imucal_fuzz_" + std::to_string(::getpid()) + ".csv";
  write_log(name, log);
  const Log back = read_log(name);
  ::unlink(name.c_str());
  FUZZ_CHECK(back.size() == log.size() && back.axes.size() == log.axes.size());
  for (size_t a = 0; a < log.axes.size(); ++a)
    for (size_t i = 0; i < log.size(); ++i)
      FUZZ_CHECK(is_near(log.axes[a].rate_dph[i], back.axes[a].rate_dph[i], 1e-5));
}

inline void fit_door(const std::string& path) {
  const Log log = read_log(path);
  if (log.t_s.back() - log.t_s.front() > kFitSpanS) return;
  ErrorModel model;
  model.arw_deg_rt_h = 0.6;
  model.markov = {{20, 100}};
  for (const auto method : {FitOptions::Method::kPolynomial, FitOptions::Method::kKalman}) {
    FitOptions options;
    options.method = method;
    options.order = 1;
    options.model = model;
    const FitResult result = fit_logs({log}, options);
    FUZZ_CHECK(!result.axes.empty());
    for (const FitAxis& axis : result.axes)
      for (const double b : axis.coeff_dph) FUZZ_CHECK(std::isfinite(b));
    if (!result.is_accepted()) continue;
    const imucal_table_t table = make_table(result, {"FUZZ", 1, {}, {}, {}, {}});
    FUZZ_CHECK(imucal_table_validate(&table, nullptr) == IMUCAL_OK);
  }
}

// ---- JSON ----

inline void model_door(const std::string& path, const MemoryFile& file) {
  const Json once = to_json(read_model(path));
  FUZZ_CHECK(to_json(model_from_json(again(file, once))) == once);
}

inline void profile_door(const std::string& path, const MemoryFile& file) {
  const Profile profile = read_profile(path);
  const double duration_s = profile.duration_s(), lo = profile.min_degc(), hi = profile.max_degc();
  FUZZ_CHECK(duration_s >= 1 && duration_s <= 366 * 86400.0 && lo <= hi);
  for (int i = 0; i <= 16; ++i) {
    const double degc = profile.at(duration_s * i / 16);
    FUZZ_CHECK(degc >= lo - 1e-6 && degc <= hi + 1e-6);
  }
  if (duration_s < 1e5) FUZZ_CHECK(std::abs(static_cast<double>(profile.temperatures().size()) - duration_s) <= 1);
  const Json once = to_json(profile);
  FUZZ_CHECK(to_json(profile_from_json(again(file, once))) == once);
}

inline void check_table(const imucal_table_t& table, const MemoryFile& file) {
  const std::vector<uint8_t> bytes = table_bytes(table, "table");
  FUZZ_CHECK(table_bytes(table_from_bytes(bytes, "table"), "table") == bytes);
  FUZZ_CHECK(table_differences(table, table_from_json(again(file, to_json(table)))).empty());
}

inline void effects_door(const std::string& path) {
  for (const EffectSpec& spec : read_effects(path)) {
    const Effect& effect = find_effect(spec.name);
    const Parameters parameters = read_parameters(effect, spec.parameters);
    FUZZ_CHECK(parameters_json(read_parameters(effect, parameters_json(parameters))) == parameters_json(parameters));
  }
}

// ---- all of them ----

inline void through(char door, const uint8_t* bytes, size_t size) {
  static const MemoryFile file, other;
  if (door == 'B') return check_table(table_from_bytes({bytes, bytes + size}, "table.bin"), file);
  const std::string& path = file.holds(bytes, size);
  switch (door) {
  case 'L':
    return log_door(path);
  case 'M':
    return model_door(path, other);
  case 'P':
    return profile_door(path, other);
  case 'T':
    return check_table(read_table(path), other);
  case 'E':
    return effects_door(path);
  case 'F':
    return fit_door(path);
  default:
    return;
  }
}

// True where the file was read, false where it was refused as it should be.
inline bool one(const uint8_t* data, size_t size) {
  if (size == 0) return false;
  try {
    through(static_cast<char>(data[0]), data + 1, size - 1);
    return true;
  } catch (const Error& error) {
    const std::string text = error.what();
    std::snprintf(last_refusal, sizeof last_refusal, "%s", text.c_str());
    FUZZ_CHECK(error.exit() == Exit::kData && !text.empty()); /* cli makes it printable */
    return false;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "not a data error: %s\n", error.what());
    std::abort();
  }
}

} // namespace fuzz_files
