// SPDX-License-Identifier: MIT
#include "base/parallel.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace imucal {
namespace {

constexpr auto kWatchEvery = std::chrono::milliseconds(50);

class Loop {
public:
  Loop(long n, const std::function<void(long)>& f) : n_(n), f_(f) {}

  void work() {
    for (long i = next_++; i < n_; i = next_++) run([&] { f_(i); });
  }
  void work_watched() {
    work();
    const std::lock_guard<std::mutex> hold(mutex_);
    ++finished_;
    changed_.notify_one();
  }
  void watch(int workers, const std::function<void()>& watch) {
    std::unique_lock<std::mutex> hold(mutex_);
    while (!changed_.wait_for(hold, kWatchEvery, [&] { return finished_ == workers; })) {
      hold.unlock();
      run(watch);
      hold.lock();
    }
  }
  void rethrow() const {
    if (problem_) std::rethrow_exception(problem_);
  }

private:
  template <class Task> void run(const Task& task) {
    try {
      task();
    } catch (...) {
      const std::lock_guard<std::mutex> hold(mutex_);
      if (!problem_) problem_ = std::current_exception();
      next_ = n_;
    }
  }

  const long n_;
  const std::function<void(long)>& f_;
  std::atomic<long> next_{0};
  std::mutex mutex_;
  std::condition_variable changed_;
  int finished_ = 0;
  std::exception_ptr problem_;
};

// Joins also when a thread cannot be started.
class Pool {
public:
  ~Pool() {
    for (std::thread& t : threads_) t.join();
  }
  template <class Task> void add(const Task& task) { threads_.emplace_back(task); }

private:
  std::vector<std::thread> threads_;
};

} // namespace

void parallel_for(long n, int threads, const std::function<void(long)>& f) {
  Loop loop(n, f);
  {
    Pool pool;
    for (long k = 1; k < std::min<long>(threads, n); ++k) pool.add([&loop] { loop.work(); });
    loop.work();
  }
  loop.rethrow();
}

void parallel_for(long n, int threads, const std::function<void(long)>& f, const std::function<void()>& watch) {
  Loop loop(n, f);
  const int workers = static_cast<int>(std::max(1L, std::min<long>(threads, n)));
  {
    Pool pool;
    for (int k = 0; k < workers; ++k) pool.add([&loop] { loop.work_watched(); });
    loop.watch(workers, watch);
  }
  loop.rethrow();
}

} // namespace imucal
