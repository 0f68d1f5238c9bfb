// SPDX-License-Identifier: MIT
// Text by a pattern of printf.
#pragma once
#include <cstdio>
#include <string>

namespace imucal {

template <typename... Args> std::string format(const char* pattern, Args... args) {
  const int n = std::snprintf(nullptr, 0, pattern, args...);
  std::string text(static_cast<size_t>(n < 0 ? 0 : n) + 1, '\0'); // and the zero that snprintf writes
  std::snprintf(&text[0], text.size(), pattern, args...);
  text.pop_back();
  return text;
}

} // namespace imucal
