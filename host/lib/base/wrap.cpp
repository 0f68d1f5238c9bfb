// SPDX-License-Identifier: MIT
#include "base/wrap.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>

namespace imucal {

namespace {

constexpr int kUsual_columns = 80, kLeast_columns = 40;
constexpr size_t kWidestLabel = 20; // characters; text that begins further right is no text behind a label
constexpr size_t kRunsOfRow = 3;    // of blanks: a row of a table has so many

// Bytes that begin a character of UTF-8.
size_t characters(const std::string& text) {
  return static_cast<size_t>(std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

size_t runs_of_blanks(const std::string& line, size_t from) {
  size_t n = 0;
  for (size_t i = line.find("  ", from); i != std::string::npos; i = line.find("  ", i)) {
    i = line.find_first_not_of(' ', i);
    if (i == std::string::npos) break;
    ++n;
  }
  return n;
}

// Where the lines that follow begin.
size_t indent_of(const std::string& line, size_t start) {
  const size_t gap = line.find("  ", start);
  const size_t text = gap == std::string::npos ? gap : line.find_first_not_of(' ', gap);
  return text != std::string::npos && text <= kWidestLabel ? text : start + 2;
}

std::string wrapped_line(const std::string& line, size_t columns) {
  const size_t start = std::min(line.find_first_not_of(' '), line.size());
  if (characters(line) <= columns || runs_of_blanks(line, start) >= kRunsOfRow) return line;
  const size_t indent = indent_of(line, start);
  const size_t label = indent > start + 2 ? indent : start; // up to here the line is kept as it is
  std::string out, row = line.substr(0, label);
  size_t at = label;
  bool is_begun = false; // the row has a word
  while (at < line.size()) {
    const size_t end = std::min(line.find(' ', at), line.size());
    const std::string word = line.substr(at, end - at);
    if (is_begun && characters(row) + 1 + characters(word) > columns) {
      out += row + "\n";
      row = std::string(indent, ' '), is_begun = false;
    }
    row += (is_begun ? " " : "") + word;
    is_begun = true;
    at = end + 1;
  }
  return out + row;
}

} // namespace

std::string wrapped(const std::string& text, int columns) {
  if (columns <= 0) return text;
  std::string out;
  size_t at = 0;
  while (at < text.size()) {
    const size_t end = std::min(text.find('\n', at), text.size());
    out += wrapped_line(text.substr(at, end - at), static_cast<size_t>(std::max(columns, kLeast_columns)));
    if (end < text.size()) out += '\n';
    at = end + 1;
  }
  return out;
}

int terminal_columns(int fd) {
  if (!::isatty(fd)) return 0;
  winsize size = {};
  return ::ioctl(fd, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : kUsual_columns;
}

} // namespace imucal
