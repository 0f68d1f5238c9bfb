// SPDX-License-Identifier: MIT
#include "calibrate/recorder.h"

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "base/error.h"

namespace imucal {

LogRecorder::LogRecorder(const std::string& path, const Device& device, What what)
    : path_(path), what_(what) {
  if (path_.empty()) return;
  out_.open(path_ + ".part", std::ios::trunc);
  if (!out_) throw data_error(path_ + ": cannot be written: " + std::strerror(errno));
  out_ << "# imucal-log = 1\n# device = " << fixed_text(device.hello().device)
       << "\n# serial = " << device.serial()
       << "\n# content = " << (what_ == What::kRaw ? "raw" : "compensated") << "\nt_s,temp_degc";
  for (size_t i = 0; i < device.channels().size(); ++i) out_ << "," << device.channel_name(i);
  for (size_t i = 0; i < device.channels().size(); ++i) {
    const std::string name = device.channel_name(i);
    out_ << "," << name.substr(0, name.rfind('_')) << "_flags";
  }
  out_ << "\n";
}

LogRecorder::~LogRecorder() {
  if (!out_.is_open()) return;
  out_.close();
  rename();
}

void LogRecorder::add(const SecondRecord& second) {
  if (!out_.is_open() || second.is_gap) return;
  if (rows_ > 0 && second.t_s <= last_t_s_) return; // the device started its clock anew: a log has one clock
  last_t_s_ = second.t_s;
  ++rows_;
  const float* values = what_ == What::kRaw ? second.raw : second.out;
  char text[64];
  out_ << second.t_s;
  std::snprintf(text, sizeof text, ",%.9g", static_cast<double>(second.temp_degc));
  out_ << text;
  for (size_t i = 0; i < second.n_channels; ++i) {
    std::snprintf(text, sizeof text, ",%.9g", static_cast<double>(values[i]));
    out_ << text;
  }
  for (size_t i = 0; i < second.n_channels; ++i) out_ << "," << static_cast<int>(second.flags[i]);
  out_ << "\n";
}

void LogRecorder::rename() {
  std::rename((path_ + ".part").c_str(), path_.c_str());
}

void LogRecorder::close() {
  if (!out_.is_open()) return;
  out_.flush();
  const bool is_whole = out_.good();
  out_.close();
  rename();
  if (!is_whole) throw data_error(path_ + ": not everything could be written; is the disk full?");
}

} // namespace imucal
