// SPDX-License-Identifier: MIT
// Bytes of an input file: plain or gzip (whatever its name), "-" is standard input.  No result is written over a file that was
// opened here (io/output.h).
#pragma once
#include <cstddef>
#include <memory>
#include <string>

namespace imucal {

class Input {
public:
  // data_error: cannot be opened (with the reason), is a folder.
  explicit Input(const std::string& path);
  ~Input();
  Input(const Input&) = delete;
  Input& operator=(const Input&) = delete;

  // Up to `size` bytes; 0 at the end.  data_error: read failure, gzip that is damaged, cut, or followed by something else.
  size_t read(char* to, size_t size);
  // Of the file as it lies there, packed or not; 0 where that is not known.
  size_t size() const;

private:
  struct Handle;
  void look();                             // plain or gzip?
  size_t read_file(void* to, size_t size); // as it lies there
  size_t unpack(char* to, size_t size);
  [[noreturn]] void refuse(const std::string& problem) const;
  std::string path_;
  std::unique_ptr<Handle> handle_;
};

// "standard input" for "-"; the user's file for the log that `imucal PROGRAM FILE` imported of it; else the path.
std::string input_name(const std::string& path);

// The whole file, without a UTF-8 byte-order mark.  data_error also for UTF-16.
std::string read_text(const std::string& path);

// Takes a UTF-8 byte-order mark off the first bytes; data_error for the mark of UTF-16.
void strip_byte_order_mark(const std::string& path, std::string* first);

} // namespace imucal
