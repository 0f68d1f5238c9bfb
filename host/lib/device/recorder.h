// SPDX-License-Identifier: MIT
// Writes the seconds a device streams as logs (host/formats.md, Log), row by row: every row is handed to the system at once, so that
// a killed program loses none that it had taken.  The file gets its name when it is closed; until then it is NAME.part,
// which recover_log takes up. A second with
// fewer than half of its samples, or one that was lost on the line, is a gap: it has no row; nor has one of another number
// of channels.  A value that is no number is an empty field.
#pragma once
#include <fstream>
#include <string>

#include "device/device.h"

namespace imucal {

class LogRecorder {
public:
  enum class What { kRaw, kCompensated };
  // path empty: records nothing.  data_error: the file cannot be written, or there is less than 1 MB of room; it, or a .part
  // of it, is there and may_overwrite is false.
  LogRecorder(const std::string& path, const Device& device, What what, bool may_overwrite = false);
  ~LogRecorder(); // keeps what was recorded; of no row no file
  LogRecorder(const LogRecorder&) = delete;
  LogRecorder& operator=(const LogRecorder&) = delete;

  void add(const SecondRecord& second);
  bool has_failed() const { return has_failed_; } // the disk is full: nothing more is written
  void close(); // gives the file its name; data_error: disk full, no renaming (then the .part stays)
  size_t rows() const { return rows_; }

private:
  void write_scales(const Device& device);
  bool rename();

  std::string path_;
  What what_;
  size_t n_channels_;
  std::ofstream out_;
  uint32_t last_t_s_ = 0;
  size_t rows_ = 0;
  bool has_failed_ = false;
};

// Before work of hours begins: can a result be written there in the end?  data_error: no such folder, a folder itself, no
// room.  Empty, "-" and what is no regular file (a device, a pipe) are not tried.
void require_writable(const std::string& path);

// A recording that was cut off (NAME.part) as a log: the whole rows of it, under `output`.  Returns how many; data_error:
// no .part, not one whole row, rows that are no log, `output` is the .part itself, or is there and may_overwrite is false.  The
// .part is removed when all is written to a file.
size_t recover_log(const std::string& part_path, const std::string& output, bool may_overwrite);

} // namespace imucal
