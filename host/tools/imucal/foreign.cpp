// SPDX-License-Identifier: MIT
#include "imucal/foreign.h"

#include <sys/stat.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <fstream>
#include <sstream>
#include <vector>

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

constexpr size_t kHead = 8192; // bytes in which two lines must end

bool is_digit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

// The first lines that say something: no blanks only, no "# key = value".
std::vector<std::string> telling_lines(const std::string& head) {
  std::vector<std::string> lines;
  std::istringstream in(head);
  for (std::string line; lines.size() < 2 && std::getline(in, line);) {
    line.erase(std::remove_if(line.begin(), line.end(), [](char c) { return c == '\r' || c == ' '; }), line.end());
    if (!line.empty() && line[0] != '#') lines.push_back(line);
  }
  return lines;
}

// Eight words of eight hex digits (Sony CXD5602PWBIMU).
bool is_hex_text(const std::string& line) {
  if (line.size() != 8 * 9 - 1) return false;
  for (size_t i = 0; i < line.size(); ++i)
    if (i % 9 == 8 ? line[i] != ',' : std::isxdigit(static_cast<unsigned char>(line[i])) == 0) return false;
  return true;
}

// A line of names over a line of numbers, and not the names of ours.
bool is_other_table(const std::vector<std::string>& lines) {
  const std::string& names = lines[0];
  if (lines.size() < 2 || names[0] == '{' || names[0] == '[' || names.rfind("t_s,temp_degc", 0) == 0) return false;
  const bool has_letter =
      std::any_of(names.begin(), names.end(), [](char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; });
  const char first = lines[1][0];
  if (!has_letter || is_digit(names[0]) || !(is_digit(first) || first == '-' || first == '.' || first == '"'))
    return false;
  for (const char separator : {',', ';', '\t'}) {
    const auto n = std::count(names.begin(), names.end(), separator);
    if (n >= 2 && n == std::count(lines[1].begin(), lines[1].end(), separator)) return true;
  }
  return false;
}

std::string text_format(std::string head) {
  if (head.rfind("\xef\xbb\xbf", 0) == 0) head.erase(0, 3);
  if (head.find('\0') != std::string::npos) return "";
  const std::vector<std::string> lines = telling_lines(head);
  if (lines.empty()) return "";
  if (is_hex_text(lines[0])) return "cxd5602-hex";
  return is_other_table(lines) ? "csv" : "";
}
} // namespace

std::string foreign_format(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return "";
  if (S_ISDIR(info.st_mode)) return std::ifstream(path + "/metadata.yaml") ? "rosbag2" : "";
  if (!S_ISREG(info.st_mode)) return "";
  std::string head(kHead, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), static_cast<std::streamsize>(kHead));
  head.resize(static_cast<size_t>(file.gcount()));
  for (const Magic& magic : kMagics)
    if (head.compare(0, magic.n, magic.bytes, magic.n) == 0) return magic.format;
  return text_format(head);
}

} // namespace imucal
