// SPDX-License-Identifier: MIT
#include "io/output.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <mutex>
#include <set>
#include <tuple>

#include "base/error.h"

namespace imucal {

namespace {

// A file by device, number and when it was written last: a number is given again once its file is gone.
using FileMark = std::tuple<dev_t, ino_t, time_t, long>;
FileMark mark_of(const struct stat& file) {
  return {file.st_dev, file.st_ino, file.st_mtim.tv_sec, file.st_mtim.tv_nsec};
}
struct ProtectedFiles {
  std::mutex mutex;
  std::set<FileMark> marks;
};
ProtectedFiles& protected_files() {
  static ProtectedFiles files;
  return files;
}
bool is_protected(const struct stat& file) {
  ProtectedFiles& files = protected_files();
  const std::lock_guard<std::mutex> lock(files.mutex);
  return files.marks.count(mark_of(file)) > 0;
}

[[noreturn]] void cannot_write(const std::string& path, const std::string& reason) {
  throw data_error(path + ": cannot write: " + reason);
}

void write_to_standard_output(const std::function<void(std::ostream&)>& write) {
  errno = 0;
  write(std::cout);
  std::cout.flush();
  if (!std::cout) cannot_write("standard output", errno != 0 ? std::strerror(errno) : "the stream failed");
}

// A device or pipe cannot be renamed onto.
void write_in_place(const std::string& path, const std::function<void(std::ostream&)>& write) {
  errno = 0;
  std::ofstream out(path, std::ios::binary);
  if (out) write(out);
  out.close();
  if (!out) cannot_write(path, errno != 0 ? std::strerror(errno) : "the device failed");
}

void write_aside(const std::string& path, const std::function<void(std::ostream&)>& write) {
  const std::string part = path + ".part" + std::to_string(::getpid());
  errno = 0;
  std::ofstream out(part, std::ios::binary);
  if (!out) cannot_write(path, std::string(std::strerror(errno)) + "; does the folder exist?");
  try {
    write(out);
  } catch (...) {
    out.close();
    std::remove(part.c_str());
    throw;
  }
  out.close();
  if (out && std::rename(part.c_str(), path.c_str()) == 0) return;
  const std::string reason = errno != 0 ? std::strerror(errno) : "the file system failed";
  std::remove(part.c_str());
  cannot_write(path, reason);
}

} // namespace

void write_stream(const std::string& path, const std::function<void(std::ostream&)>& write) {
  if (path == "-") return write_to_standard_output(write);
  struct stat existing {};
  if (::stat(path.c_str(), &existing) != 0) return write_aside(path, write);
  if (S_ISDIR(existing.st_mode)) cannot_write(path, "it is a folder");
  if (!S_ISREG(existing.st_mode)) return write_in_place(path, write);
  refuse_protected(path);
  std::error_code unresolved;
  const std::filesystem::path target = std::filesystem::canonical(path, unresolved);
  write_aside(unresolved ? path : target.string(), write);
}

void refuse_protected(const std::string& path) {
  struct stat existing {};
  if (path != "-" && ::stat(path.c_str(), &existing) == 0 && is_protected(existing))
    cannot_write(path, "it is a file that was read; give another name");
}

bool is_same_file(const std::string& a, const std::string& b) {
  if (a == "-" || b == "-") return false;
  struct stat left {
  }, right{};
  const bool has_left = ::stat(a.c_str(), &left) == 0, has_right = ::stat(b.c_str(), &right) == 0;
  if (has_left != has_right) return false;
  if (has_left) return S_ISREG(left.st_mode) && left.st_dev == right.st_dev && left.st_ino == right.st_ino;
  std::error_code unknown;
  const auto whole = [&unknown](const std::string& path) {
    return std::filesystem::weakly_canonical(std::filesystem::absolute(path, unknown), unknown);
  };
  return whole(a) == whole(b);
}

void protect_from_writing(const std::string& path) {
  struct stat file {};
  if (path == "-" || ::stat(path.c_str(), &file) != 0 || !S_ISREG(file.st_mode)) return;
  ProtectedFiles& files = protected_files();
  const std::lock_guard<std::mutex> lock(files.mutex);
  files.marks.insert(mark_of(file));
}

void write_text(const std::string& path, const std::string& text) {
  write_stream(path, [&](std::ostream& out) { out << text; });
}

} // namespace imucal
