// SPDX-License-Identifier: MIT
// A line of text by a pattern of printf; what is longer than a line of text is cut.
#pragma once
#include <cstdio>
#include <string>

namespace imucal {

template <typename... Args> std::string format(const char* pattern, Args... args) {
  char line[600];
  std::snprintf(line, sizeof line, pattern, args...);
  return line;
}

} // namespace imucal
