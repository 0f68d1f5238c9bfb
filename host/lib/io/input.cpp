// SPDX-License-Identifier: MIT
#include "io/input.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>
#include <vector>

#include "base/error.h"
#include "io/output.h"

namespace imucal {

// zlib's own reader takes what follows a gzip member and is none for nothing: half a log would pass for the whole.
struct Input::Handle {
  int fd = -1;
  size_t size = 0;
  bool is_known = false, is_packed = false; // known: the first bytes have been looked at
  bool is_in_member = false;
  z_stream inflating{};
  std::vector<unsigned char> bytes = std::vector<unsigned char>(size_t{1} << 16); // as they lie in the file
  size_t at = 0, filled = 0;

  ~Handle() {
    if (is_packed) inflateEnd(&inflating);
    if (fd >= 0) ::close(fd);
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
  handle_->fd = path == "-" ? ::dup(STDIN_FILENO) : ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (handle_->fd < 0) throw data_error(input_name(path) + ": cannot open: " + std::strerror(errno));
  protect_from_writing(path);
  if (input_name(path) != path)
    protect_from_writing(path.substr(0, path.rfind(".csv"))); // beside the imported log: its source
  if (path != "-" && S_ISREG(info.st_mode)) handle_->size = static_cast<size_t>(info.st_size);
}

size_t Input::size() const {
  return handle_->size;
}

Input::~Input() = default;

void Input::refuse(const std::string& problem) const {
  throw data_error(input_name(path_) + ": cannot be read: " + problem);
}

size_t Input::read_file(void* to, size_t size) {
  for (;;) {
    const ssize_t n = ::read(handle_->fd, to, size);
    if (n >= 0) return static_cast<size_t>(n);
    if (errno != EINTR) refuse(std::strerror(errno));
  }
}

void Input::look() {
  Handle& h = *handle_;
  h.is_known = true;
  while (h.filled < 2) {
    const size_t n = read_file(h.bytes.data() + h.filled, h.bytes.size() - h.filled);
    if (n == 0) return;
    h.filled += n;
  }
  if (h.bytes[0] != 0x1f || h.bytes[1] != 0x8b) return;
  constexpr int kGzip = 15 + 16; // the largest window, a gzip header
  if (inflateInit2(&h.inflating, kGzip) != Z_OK) throw std::bad_alloc();
  h.is_packed = true;
}

size_t Input::read(char* to, size_t size) {
  Handle& h = *handle_;
  if (!h.is_known) look();
  if (h.is_packed) return unpack(to, size);
  if (h.at == h.filled) return read_file(to, size);
  const size_t n = std::min(size, h.filled - h.at);
  std::memcpy(to, h.bytes.data() + h.at, n);
  h.at += n;
  return n;
}

size_t Input::unpack(char* to, size_t size) {
  Handle& h = *handle_;
  z_stream& z = h.inflating;
  z.next_out = reinterpret_cast<Bytef*>(to);
  z.avail_out = static_cast<uInt>(size);
  while (z.avail_out == size) {
    if (h.at == h.filled) h.at = 0, h.filled = read_file(h.bytes.data(), h.bytes.size());
    if (h.filled == 0 && h.is_in_member) refuse("the gzip data end too early");
    if (h.filled == 0) return 0;
    // Between members: zeros fill a block of a tape, anything else is a member.
    if (!h.is_in_member && h.bytes[h.at] == 0 && ++h.at > 0) continue;
    if (!h.is_in_member) inflateReset(&z);
    h.is_in_member = true;
    z.next_in = h.bytes.data() + h.at;
    z.avail_in = static_cast<uInt>(h.filled - h.at);
    const int code = inflate(&z, Z_NO_FLUSH);
    h.at = h.filled - z.avail_in;
    if (code == Z_STREAM_END) h.is_in_member = false;
    if (code != Z_OK && code != Z_STREAM_END && code != Z_BUF_ERROR)
      refuse(std::string("the gzip data are damaged: ") + (z.msg != nullptr ? z.msg : "no gzip"));
  }
  return size - z.avail_out;
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
