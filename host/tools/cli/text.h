// SPDX-License-Identifier: MIT
// Sentences for people, on whatever they read: lines are broken on a terminal alone, so that a file, a pipe and grep have each
// statement on a line of its own.
#pragma once
#include <cstdio>
#include <string>

namespace imucal {

// `text` to stdout or stderr.
void say(std::FILE* stream, const std::string& text);

// By a pattern of printf, however long.
template <typename... Args> void say_by(std::FILE* stream, const char* pattern, Args... args) {
  const int n = std::snprintf(nullptr, 0, pattern, args...);
  if (n < 0) return;
  std::string text(static_cast<size_t>(n) + 1, '\0'); // and the zero that snprintf writes
  std::snprintf(&text[0], text.size(), pattern, args...);
  text.pop_back();
  say(stream, text);
}
template <typename... Args> void tell(const char* pattern, Args... args) {
  say_by(stdout, pattern, args...);
}
template <typename... Args> void warn(const char* pattern, Args... args) {
  say_by(stderr, pattern, args...);
}

} // namespace imucal
