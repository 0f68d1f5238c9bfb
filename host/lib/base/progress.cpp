// SPDX-License-Identifier: MIT
#include "base/progress.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>

#include "base/clock.h"

namespace imucal {

Progress::Progress(std::string what, double total, bool quiet)
    : what_(std::move(what)), total_(total), shown_(!quiet && ::isatty(STDERR_FILENO)), start_s_(now_s()) {}

Progress::~Progress() {
  finish();
}

void Progress::update(double done, const std::string& note) {
  if (!shown_) return;
  const double t = now_s();
  if (t - last_s_ < 0.1) return;
  last_s_ = t;
  dirty_ = true;
  const double fraction = total_ > 0 ? std::min(1.0, done / total_) : 0.0;
  const double left_s = fraction > 0.001 ? (t - start_s_) * (1 - fraction) / fraction : 0.0;
  if (total_ > 0)
    std::fprintf(stderr, "\r\033[K%s %3.0f %%  %s  %.0f s left", what_.c_str(), 100 * fraction, note.c_str(), left_s);
  else // nobody knows how much there is to do
    std::fprintf(stderr, "\r\033[K%s  %s", what_.c_str(), note.c_str());
  std::fflush(stderr);
}

void Progress::finish() {
  if (dirty_) std::fprintf(stderr, "\r\033[K");
  dirty_ = false;
}

static std::atomic<bool> was_interrupted{false};

bool interrupted() {
  static const bool installed = [] {
    struct sigaction action {};
    action.sa_handler = [](int) { was_interrupted = true; };
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    sigaction(SIGINT, &action, nullptr);
    sigaction(SIGTERM, &action, nullptr);
    return true;
  }();
  (void)installed;
  return was_interrupted;
}

} // namespace imucal
