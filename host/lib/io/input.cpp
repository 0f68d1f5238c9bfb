// SPDX-License-Identifier: MIT
#include "io/input.h"

#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "base/error.h"
#include "io/output.h"

namespace imucal {

struct Input::Handle {
  gzFile file = nullptr;
  size_t size = 0;
  ~Handle() {
    if (file != nullptr) gzclose(file);
  }
};

// `imucal dp flight.ulg` runs dp on SCRATCH/0/flight.ulg.csv: people know their own file.
static std::string name_before_import(const std::string& path) {
  const char* scratch = std::getenv("IMUCAL_IMPORTED_IN");
  if (scratch == nullptr || *scratch == 0 || path.rfind(std::string(scratch) + "/", 0) != 0) return path;
  const std::string name = path.substr(path.rfind('/') + 1);
  return name.substr(0, name.rfind(".csv"));
}

std::string input_name(const std::string& path) {
  return path == "-" ? "standard input" : name_before_import(path);
}

Input::Input(const std::string& path) : path_(path), handle_(std::make_unique<Handle>()) {
  struct stat info {};
  if (path != "-" && ::stat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode))
    throw data_error(path + ": is a folder, not a file");
  errno = 0;
  const int copy = path == "-" ? ::dup(STDIN_FILENO) : -1;
  handle_->file = path == "-" ? (copy < 0 ? nullptr : gzdopen(copy, "rb")) : gzopen(path.c_str(), "rb");
  if (handle_->file == nullptr) throw data_error(input_name(path) + ": cannot open: " + std::strerror(errno));
  protect_from_writing(path);
  gzbuffer(handle_->file, 1U << 16); // reads of twice as much go past it
  if (path != "-" && S_ISREG(info.st_mode)) handle_->size = static_cast<size_t>(info.st_size);
}

size_t Input::size() const {
  return handle_->size;
}

Input::~Input() = default;

size_t Input::read(char* to, size_t size) {
  const int n = gzread(handle_->file, to, static_cast<unsigned>(size));
  int code = Z_OK;
  const char* text = gzerror(handle_->file, &code);
  if (n < 0 || code == Z_BUF_ERROR) {
    const std::string reason = code == Z_ERRNO       ? std::strerror(errno)
                               : code == Z_BUF_ERROR ? "the gzip data end too early"
                                                     : text;
    throw data_error(input_name(path_) + ": cannot be read: " + reason);
  }
  return static_cast<size_t>(n);
}

void strip_byte_order_mark(const std::string& path, std::string* first) {
  if (first->compare(0, 3, "\xEF\xBB\xBF") == 0) first->erase(0, 3);
  if (first->compare(0, 2, "\xFF\xFE") == 0 || first->compare(0, 2, "\xFE\xFF") == 0)
    throw data_error(input_name(path) + ":1: the file is UTF-16; save it as UTF-8");
}

std::string read_text(const std::string& path) {
  Input in(path);
  std::string text;
  char piece[1 << 14];
  for (size_t n = 0; (n = in.read(piece, sizeof piece)) > 0;) text.append(piece, n);
  strip_byte_order_mark(path, &text);
  return text;
}

} // namespace imucal
