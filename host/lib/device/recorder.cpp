// SPDX-License-Identifier: MIT
#include "device/recorder.h"

#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "base/axis_unit.h"
#include "base/error.h"
#include "io/input.h"
#include "io/log.h"
#include "io/output.h"
#include "io/table_json.h"

namespace imucal {

namespace {

bool is_there(const std::string& path) {
  struct stat info {};
  return ::stat(path.c_str(), &info) == 0;
}

// A recording is hours of work: nothing is written over it unasked.
void refuse_existing(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return;
  if (S_ISDIR(info.st_mode)) throw data_error(path + ": is a folder");
  throw data_error(path + ": is there already; choose another name, or --force to write over it");
}

std::string folder_of(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "." : slash == 0 ? "/" : path.substr(0, slash);
}

// What a device calls itself, in one line of a log.
std::string one_line(std::string text) {
  for (char& c : text)
    if (static_cast<unsigned char>(c) < ' ' || c == '\x7F') c = '?';
  return text;
}

// A field of a row; what is no number is a missing value.
void write_field(std::ostream& out, float value) {
  char text[64] = "";
  if (std::isfinite(value)) std::snprintf(text, sizeof text, "%.9g", static_cast<double>(value));
  out << "," << text;
}

constexpr double kLeastRoom_bytes = 1e6;

double free_bytes(const std::string& path) {
  struct statvfs info {};
  if (::statvfs(folder_of(path).c_str(), &info) != 0) return kLeastRoom_bytes; // it does not say
  return static_cast<double>(info.f_bavail) * static_cast<double>(info.f_frsize);
}

} // namespace

void require_writable(const std::string& path) {
  if (path.empty() || path == "-") return;
  refuse_protected(path);
  struct stat info {};
  const bool exists = ::stat(path.c_str(), &info) == 0;
  if (exists && S_ISDIR(info.st_mode)) throw data_error(path + ": is a folder; name a file");
  if (exists && !S_ISREG(info.st_mode)) return;
  std::string trial = path + ".XXXXXX";
  const int fd = ::mkstemp(trial.data());
  const std::string room(16384, ' '); // a table is a third of that
  const bool is_written = fd >= 0 && ::write(fd, room.data(), room.size()) == static_cast<ssize_t>(room.size());
  const int error = errno;
  if (fd >= 0) {
    ::close(fd);
    ::unlink(trial.c_str());
  }
  if (!is_written) throw data_error(path + ": cannot be written: " + std::strerror(error) + "; choose another place");
}

LogRecorder::LogRecorder(const std::string& path, const Device& device, What what, bool may_overwrite)
    : path_(path), what_(what), n_channels_(device.channels().size()) {
  if (path_.empty()) return;
  for (const std::string& name : {path_, path_ + ".part"}) refuse_protected(name);
  if (!may_overwrite) {
    refuse_existing(path_);
    if (is_there(path_ + ".part"))
      throw data_error(path_ + ".part: a recording was cut off; \"calibrate recover " + path_ +
                       ".part\" keeps it, --force writes over it");
  }
  out_.open(path_ + ".part", std::ios::trunc);
  if (!out_) throw data_error(path_ + ": cannot be written: " + std::strerror(errno));
  out_.precision(9); // every float32
  out_ << "# imucal-log = 1\n# device = " << one_line(fixed_text(device.hello().device))
       << "\n# serial = " << one_line(device.serial())
       << "\n# content = " << (what_ == What::kRaw ? "raw" : "compensated") << "\n";
  write_scales(device);
  out_ << "t_s,temp_degc";
  for (size_t i = 0; i < device.channels().size(); ++i) out_ << "," << device.channel_name(i);
  for (size_t i = 0; i < device.channels().size(); ++i) out_ << "," << axis_stem(device.channel_name(i)) << "_flags";
  out_ << "\n";
  out_.flush();
  if (!out_ || free_bytes(path_) < kLeastRoom_bytes) {
    out_.close();
    std::remove((path_ + ".part").c_str());
    throw data_error(path_ + ": no room to record there: the disk is full (at least 1 MB is needed)");
  }
}

// What a count means on this device: `calibrate fit` makes a table of the log that fits the device.
void LogRecorder::write_scales(const Device& device) {
  for (size_t i = 0; i < device.channels().size(); ++i) {
    const imucal_link_channel_info_reply_t& channel = device.channels()[i];
    const std::string name = device.channel_name(i), stem = axis_stem(name);
    if (i == 0)
      out_ << "# temp_counts_scale_degc = " << shortest(channel.degc_per_count)
           << "\n# temp_counts_offset_degc = " << shortest(channel.degc_at_zero) << "\n";
    out_ << "# " << stem << "_counts_scale" << name.substr(stem.size()) << " = " << shortest(channel.unit_per_count)
         << "\n# " << stem << "_full_scale_counts = " << channel.full_scale_counts << "\n";
  }
}

LogRecorder::~LogRecorder() {
  if (!out_.is_open()) return;
  out_.close();
  if (rows_ == 0)
    std::remove((path_ + ".part").c_str()); // it never began, and a log that is there is worth more
  else
    (void)rename(); // where it fails the .part stays
}

void LogRecorder::add(const SecondRecord& second) {
  if (!out_.is_open() || second.is_gap || has_failed_) return;
  if (second.n_channels != n_channels_) return;     // its values belong to nobody knows which channels
  if (rows_ > 0 && second.t_s <= last_t_s_) return; // the device started its clock anew: a log has one clock
  last_t_s_ = second.t_s;
  ++rows_;
  const float* values = what_ == What::kRaw ? second.raw : second.out;
  out_ << second.t_s;
  write_field(out_, second.temp_degc);
  for (size_t i = 0; i < second.n_channels; ++i) write_field(out_, values[i]);
  for (size_t i = 0; i < second.n_channels; ++i) out_ << "," << static_cast<int>(second.flags[i]);
  out_ << "\n";
  out_.flush();
  has_failed_ = !out_;
}

bool LogRecorder::rename() {
  if (std::rename((path_ + ".part").c_str(), path_.c_str()) != 0) return false;
  protect_from_writing(path_); // from the results of the same command
  return true;
}

void LogRecorder::close() {
  if (!out_.is_open()) return;
  out_.flush();
  const bool is_whole = out_.good() && !has_failed_;
  out_.close();
  errno = 0;
  if (!rename())
    throw data_error(path_ + ": cannot write: " + std::strerror(errno) + "; what was recorded is in " + path_ +
                     ".part");
  if (!is_whole) throw data_error(path_ + ": not everything could be written; is the disk full?");
}

size_t recover_log(const std::string& part_path, const std::string& output, bool may_overwrite) {
  if (!is_there(part_path)) throw data_error(part_path + ": cannot open: " + std::strerror(errno));
  if (!may_overwrite) refuse_existing(output);
  std::string text = read_text(part_path);
  const size_t last = text.rfind('\n');
  text.erase(last == std::string::npos ? 0 : last + 1); // a row cut off in the middle
  const size_t header = text.find("t_s,");
  const size_t rows_at = header == std::string::npos ? header : text.find('\n', header);
  if (rows_at == std::string::npos || rows_at + 1 == text.size())
    throw data_error(part_path + ": holds no whole row: nothing to recover");
  const size_t rows = read_log(part_path).size(); // before a log that is there is given up for it
  write_text(output, text);
  protect_from_writing(output);
  struct stat written {};
  if (::stat(output.c_str(), &written) == 0 && S_ISREG(written.st_mode)) std::remove(part_path.c_str());
  return rows;
}

} // namespace imucal
