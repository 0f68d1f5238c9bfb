// SPDX-License-Identifier: MIT
#include "io/output.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
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
  std::map<FileMark, std::string> to_be_written; // their names
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

constexpr char kWasRead[] = "it is a file that was read; give another name";

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

// Takes the file that is being written away where a signal ends the program meanwhile.  A signal that somebody waits for, or that
// is ignored, is left to them.
class RemovedBySignal {
public:
  explicit RemovedBySignal(const std::string& part) {
    mutex_.lock();
    const size_t n = std::min(part.size(), name_.size() - 1);
    std::copy_n(part.begin(), n, name_.begin());
    name_[n] = 0;
    struct sigaction action {};
    action.sa_handler = [](int signal) {
      ::unlink(name_.data());
      (void)std::raise(signal); // as before the guard: SA_RESETHAND
    };
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    for (size_t i = 0; i < kSignals.size(); ++i) {
      is_taken_[i] = ::sigaction(kSignals[i], nullptr, &before_[i]) == 0 && before_[i].sa_handler == SIG_DFL;
      if (is_taken_[i]) ::sigaction(kSignals[i], &action, nullptr);
    }
  }
  ~RemovedBySignal() {
    for (size_t i = 0; i < kSignals.size(); ++i)
      if (is_taken_[i]) ::sigaction(kSignals[i], &before_[i], nullptr);
    mutex_.unlock();
  }
  RemovedBySignal(const RemovedBySignal&) = delete;
  RemovedBySignal& operator=(const RemovedBySignal&) = delete;

private:
  static constexpr std::array<int, 4> kSignals = {SIGINT, SIGTERM, SIGHUP, SIGQUIT};
  static inline std::mutex mutex_;
  static inline std::array<char, 8192> name_; // longer than any path
  std::array<struct sigaction, kSignals.size()> before_{};
  std::array<bool, kSignals.size()> is_taken_{};
};

// In the same folder; a long name is cut, so that what is put behind it fits.
std::string name_aside(const std::string& path) {
  constexpr size_t kLongestName = 230; // of the 255 bytes of most file systems
  const size_t slash = path.rfind('/'), name_at = slash == std::string::npos ? 0 : slash + 1;
  return path.substr(0, name_at) + path.substr(name_at, kLongestName) + ".part" + std::to_string(::getpid());
}

void write_aside(const std::string& path, const std::function<void(std::ostream&)>& write) {
  const std::string part = name_aside(path);
  const RemovedBySignal guard(part);
  errno = 0;
  std::ofstream out(part, std::ios::binary);
  if (!out) cannot_write(path, std::string(std::strerror(errno)) + (errno == ENOENT ? "; does the folder exist?" : ""));
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
  if (path != "-" && ::stat(path.c_str(), &existing) == 0 && is_protected(existing)) cannot_write(path, kWasRead);
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
  const auto result = files.to_be_written.find(mark_of(file));
  if (result != files.to_be_written.end()) cannot_write(result->second, kWasRead);
  files.marks.insert(mark_of(file));
}

void announce_result(const std::string& path) {
  struct stat file {};
  if (path == "-" || ::stat(path.c_str(), &file) != 0 || !S_ISREG(file.st_mode)) return;
  ProtectedFiles& files = protected_files();
  const std::lock_guard<std::mutex> lock(files.mutex);
  files.to_be_written.emplace(mark_of(file), path);
}

void write_text(const std::string& path, const std::string& text) {
  write_stream(path, [&](std::ostream& out) { out << text; });
}

} // namespace imucal
