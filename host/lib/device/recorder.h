// SPDX-License-Identifier: MIT
// Writes the seconds a device streams as logs (design 1.2), row by row, so that nothing but the last row is
// lost whatever happens.  The file gets its name when it is closed; until then it is NAME.part. A second with
// fewer than half of its samples, or one that was lost on the line, is a gap: it has no row.
#pragma once
#include <fstream>
#include <string>

#include "device/device.h"

namespace imucal {

class LogRecorder {
public:
  enum class What { kRaw, kCompensated };
  // path empty: records nothing.  data_error: the file cannot be written.
  LogRecorder(const std::string& path, const Device& device, What what);
  ~LogRecorder(); // keeps what was recorded
  LogRecorder(const LogRecorder&) = delete;
  LogRecorder& operator=(const LogRecorder&) = delete;

  void add(const SecondRecord& second);
  void close(); // gives the file its name; data_error: disk full
  size_t rows() const { return rows_; }

private:
  void write_scales(const Device& device);
  void rename();

  std::string path_;
  What what_;
  std::ofstream out_;
  uint32_t last_t_s_ = 0;
  size_t rows_ = 0;
};

} // namespace imucal
