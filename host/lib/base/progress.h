// SPDX-License-Identifier: MIT
// Long work: progress on a terminal, and an end in order on Ctrl-C.
#pragma once
#include <string>

namespace imucal {

// Progress on standard error, on a terminal only and at most ten times a second.
class Progress {
public:
  Progress(std::string what, double total, bool quiet);
  ~Progress();
  void update(double done, const std::string& note = "");
  void finish();

private:
  std::string what_;
  double total_;
  bool shown_;
  bool dirty_ = false;
  double start_s_, last_s_ = 0;
};

// True once Ctrl-C (or SIGTERM) was seen; the first call installs the handler.  A second Ctrl-C kills.
bool interrupted();

} // namespace imucal
