// SPDX-License-Identifier: MIT
#include "imucal/foreign.h"

#include <sys/stat.h>

#include <cstring>
#include <fstream>

namespace imucal {

namespace {
struct Magic {
  const char* format;
  const char* bytes;
  size_t n;
};
// Sources: PX4 user guide "ULog file format"; ArduPilot AP_Logger (0xA3 0x95, FMT = 0x80); ROS wiki
// "Bags/Format/2.0"; sqlite.org/fileformat; mcap.dev/spec; MAT-File Format (level 5); HDF5 file format;
// Apache Parquet.
constexpr Magic kMagics[] = {{"px4-ulog", "ULog\x01\x12\x35", 7}, {"ardupilot", "\xa3\x95\x80", 3},
                             {"rosbag1", "#ROSBAG V", 9},         {"rosbag2", "SQLite format 3", 15},
                             {"rosbag2", "\x89MCAP0\r\n", 8},     {"matlab", "MATLAB ", 7},
                             {"matlab", "\x89HDF\r\n\x1a\n", 8},  {"parquet", "PAR1", 4}};
} // namespace

std::string foreign_format(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return "";
  if (S_ISDIR(info.st_mode)) return std::ifstream(path + "/metadata.yaml") ? "rosbag2" : "";
  if (!S_ISREG(info.st_mode)) return "";
  char head[16] = {};
  std::ifstream(path, std::ios::binary).read(head, sizeof head);
  for (const Magic& magic : kMagics)
    if (std::memcmp(head, magic.bytes, magic.n) == 0) return magic.format;
  return "";
}

} // namespace imucal
