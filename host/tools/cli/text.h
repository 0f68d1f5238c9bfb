// SPDX-License-Identifier: MIT
// Sentences for people, on whatever they read: lines are broken on a terminal alone, so that a file, a pipe and grep have each
// statement on a line of its own.
#pragma once
#include <cstdio>
#include <string>

#include "base/format.h"

namespace imucal {

// `text` to stdout or stderr.
void say(std::FILE* stream, const std::string& text);

// By a pattern of printf, to stdout and to stderr.
template <typename... Args> void tell(const char* pattern, Args... args) {
  say(stdout, format(pattern, args...));
}
template <typename... Args> void warn(const char* pattern, Args... args) {
  say(stderr, format(pattern, args...));
}

} // namespace imucal
