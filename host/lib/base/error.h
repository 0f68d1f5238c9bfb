// SPDX-License-Identifier: MIT
// Errors of the host programs: what happened, where, what to do; and whose fault it is, as the exit status.
#pragma once
#include <stdexcept>
#include <string>

namespace imucal {

// Exit status of every program (host/README.md).  kInterrupted: Ctrl-C ended it; 128 + SIGINT, as a shell has it.
enum class Exit { kDone = 0, kNegative = 1, kUsage = 2, kData = 3, kDevice = 4, kInterrupted = 130 };

class Error : public std::runtime_error {
public:
  Error(Exit exit, const std::string& message) : std::runtime_error(message), exit_(exit) {}
  Exit exit() const { return exit_; }

private:
  Exit exit_;
};

// Text of unknown origin as it may be shown on a terminal: control characters (but newline and tab) and bytes that are no
// UTF-8 become \xNN.
std::string printable(const std::string& text);
// At most so many bytes, then "...".
std::string shortened(const std::string& text, size_t longest = 60);

inline Error usage_error(const std::string& message) {
  return {Exit::kUsage, message};
}
inline Error data_error(const std::string& message) {
  return {Exit::kData, message};
}
inline Error device_error(const std::string& message) {
  return {Exit::kDevice, message};
}

} // namespace imucal
