// SPDX-License-Identifier: MIT
#include "cli/program.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <iostream>
#include <thread>

namespace imucal {

static double now_s() {
  using namespace std::chrono;
  return duration<double>(steady_clock::now().time_since_epoch()).count();
}

int CommonOptions::thread_count() const {
  if (threads > 0) return threads;
  const unsigned cores = std::thread::hardware_concurrency();
  return cores ? static_cast<int>(cores) : 1;
}

void add_common_options(CLI::App* app, CommonOptions* options, unsigned flags) {
  app->add_option("--json", options->json_path, "write the result as JSON to FILE (- for standard output)")
      ->type_name("FILE");
  app->add_flag("--quiet,-q", options->quiet, "no text but errors");
  if (flags & kWithSeed)
    app->add_option("--seed", options->seed, "seed of the random numbers (reported in the result)")
        ->capture_default_str();
  if (flags & kWithThreads)
    app->add_option("--threads", options->threads, "threads to use (0: one per core)")->check(CLI::Range(0, 1024));
}

int run_program(CLI::App* app, int argc, char** argv, const std::function<Exit()>& run) {
  const std::string name = app->get_name();
  app->set_version_flag("--version", name + " (imucal) " IMUCAL_VERSION);
  try {
    app->parse(argc, argv);
    return static_cast<int>(run());
  } catch (const CLI::CallForHelp& e) {
    return app->exit(e);
  } catch (const CLI::CallForAllHelp& e) {
    return app->exit(e);
  } catch (const CLI::CallForVersion& e) {
    return app->exit(e);
  } catch (const CLI::ParseError& e) {
    std::cerr << name << ": " << e.what() << " (try " << name << " --help)\n";
    return static_cast<int>(Exit::kUsage);
  } catch (const Error& e) {
    std::cerr << name << ": " << e.what() << "\n";
    return static_cast<int>(e.exit());
  } catch (const std::bad_alloc&) {
    std::cerr << name << ": out of memory\n";
    return static_cast<int>(Exit::kData);
  } catch (const std::exception& e) {
    std::cerr << name << ": internal error: " << e.what() << "\n";
    return static_cast<int>(Exit::kData);
  }
}

Progress::Progress(std::string what, double total, bool quiet)
    : what_(std::move(what)), total_(total), shown_(!quiet && ::isatty(STDERR_FILENO)), start_s_(now_s()) {}

Progress::~Progress() { finish(); }

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
  else  // nobody knows how much there is to do
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

}  // namespace imucal
