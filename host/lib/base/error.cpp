// SPDX-License-Identifier: MIT
#include "base/error.h"

#include <cstdio>

namespace imucal {

namespace {

// Bytes of the UTF-8 character at `at`; 0 where there is none, or a control character of Unicode (U+0080 .. U+009F).
size_t character_bytes(const std::string& text, size_t at) {
  const auto byte = [&](size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U; };
  const unsigned first = byte(at);
  const size_t n = first < 0x80                    ? 1
                   : first >= 0xC2 && first < 0xE0 ? 2
                   : first >= 0xE0 && first < 0xF0 ? 3
                   : first >= 0xF0 && first < 0xF5 ? 4
                                                   : 0;
  for (size_t i = 1; i < n; ++i)
    if ((byte(at + i) & 0xC0U) != 0x80U) return 0;
  const bool is_control = (n == 1 && (first < 0x20 || first == 0x7F) && first != '\n' && first != '\t') ||
                          (first == 0xC2 && byte(at + 1) < 0xA0);
  return is_control ? 0 : n;
}

} // namespace

std::string printable(const std::string& text) {
  std::string out;
  for (size_t at = 0; at < text.size();) {
    const size_t n = character_bytes(text, at);
    if (n > 0) {
      out.append(text, at, n);
      at += n;
      continue;
    }
    char escaped[8];
    std::snprintf(escaped, sizeof escaped, "\\x%02x", static_cast<unsigned>(static_cast<unsigned char>(text[at++])));
    out += escaped;
  }
  return out;
}

std::string shortened(const std::string& text, size_t longest) {
  return text.size() <= longest ? text : text.substr(0, longest) + "...";
}

} // namespace imucal
