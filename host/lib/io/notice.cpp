// SPDX-License-Identifier: MIT
#include "io/notice.h"

#include <cstdio>
#include <mutex>
#include <set>

#include "base/error.h"

namespace imucal {

namespace {

struct Notices {
  std::mutex mutex;
  std::set<std::string> said;
  std::function<void(const std::string&)> sink = [](const std::string& message) {
    std::fprintf(stderr, "note: %s\n", printable(message).c_str());
  };
};

Notices& notices() {
  static Notices the;
  return the;
}

} // namespace

void notice(const std::string& message) {
  Notices& the = notices();
  const std::lock_guard<std::mutex> lock(the.mutex);
  if (the.said.insert(message).second) the.sink(message);
}

void set_notice_sink(const std::function<void(const std::string&)>& sink) {
  Notices& the = notices();
  const std::lock_guard<std::mutex> lock(the.mutex);
  the.sink = sink;
}

} // namespace imucal
