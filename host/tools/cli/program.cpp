// SPDX-License-Identifier: MIT
#include "cli/program.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <new>
#include <stdexcept>
#include <thread>

#include "base/wrap.h"
#include "io/notice.h"
#include "io/output.h"

namespace imucal {

const cli::Check FinitePositive{[](std::string& text) -> std::string {
                                  double value = 0;
                                  const char* end = text.data() + text.size();
                                  const auto parsed = std::from_chars(text.data(), end, value);
                                  const bool is_good = parsed.ec == std::errc() && parsed.ptr == end &&
                                                       std::isfinite(value) && value > 0;
                                  return is_good ? "" : "expected a finite number above 0, found \"" + text + "\"";
                                },
                                "POSITIVE"};

// CLI11 lets "-1" wrap around.
static const cli::Check WholeNumber{[](std::string& text) -> std::string {
                                      uint64_t value = 0;
                                      const char* end = text.data() + text.size();
                                      const auto parsed = std::from_chars(text.data(), end, value);
                                      return parsed.ec == std::errc() && parsed.ptr == end
                                                 ? ""
                                                 : "expected a whole number 0 .. 2^64 - 1, found \"" + text + "\"";
                                    },
                                    "UINT"};

int CommonOptions::thread_count() const {
  if (threads > 0) return threads;
  const unsigned cores = std::thread::hardware_concurrency();
  return cores ? static_cast<int>(cores) : 1;
}

void add_common_options(cli::App* app, CommonOptions* options, unsigned flags) {
  app->add_option("--json", options->json_path, "write the result as JSON to FILE (- for standard output)")
      ->writes()
      ->type_name("FILE");
  app->add_flag("--quiet,-q", options->quiet, "no text but errors");
  if (flags & kWithSeed)
    app->add_option("--seed", options->seed, "seed of the random numbers (reported in the result)")
        ->check(WholeNumber)
        ->capture_default_str();
  app->add_option("--threads", options->threads,
                  flags & kWithThreads ? "threads to use (0: one per core)"
                                       : "as for the other commands; this one uses one thread")
      ->check(cli::Range(0, 1024));
}

namespace {

// An option common to all programs at argv[i]; its number of words (2 where the value stands apart), 0: another word.
int common_words(const std::string& word) {
  for (const char* name : {"--json", "--seed", "--threads"}) {
    if (word == name) return 2;
    if (word.rfind(std::string(name) + "=", 0) == 0) return 1;
  }
  return word == "-q" || word == "--quiet" ? 1 : 0;
}

// "errormodel --json - expect M" -> "errormodel expect --json - M": what stands before the subcommand goes behind it.
std::vector<std::string> common_behind(const CLI::App& app, int argc, char** argv) {
  std::vector<std::string> words(argv + 1, argv + argc), moved;
  if (app.get_subcommands([](const CLI::App*) { return true; }).empty()) return words;
  size_t at = 0;
  while (at < words.size()) {
    const int n = common_words(words[at]);
    if (n == 0 || at + static_cast<size_t>(n) > words.size()) break;
    moved.insert(moved.end(), words.begin() + static_cast<long>(at), words.begin() + static_cast<long>(at) + n);
    at += static_cast<size_t>(n);
  }
  if (at == words.size() || words[at].empty() || words[at][0] == '-') return words;
  words.erase(words.begin(), words.begin() + static_cast<long>(at));
  words.insert(words.begin() + 1, moved.begin(), moved.end());
  return words;
}

// Before hours of work: of two results in one file the first would be lost, and one without a name is written nowhere; what
// is read from now on is none of them.
void require_files(const std::vector<cli::Output>& outputs) {
  for (size_t i = 0; i < outputs.size(); ++i) {
    if (outputs[i].path.empty())
      throw usage_error(outputs[i].option + ": the name is empty; name a file, or leave the option out");
    for (size_t j = 0; j < i; ++j)
      if (is_same_file(outputs[i].path, outputs[j].path))
        throw usage_error(outputs[j].option + " and " + outputs[i].option + " name one file, " + outputs[i].path +
                          ": give each a file of its own");
    announce_result(outputs[i].path);
  }
}

// Not behind the line that shows the progress, which stands on a terminal only.
void complain(const std::string& name, const std::string& message) {
  if (::isatty(STDERR_FILENO)) std::cerr << "\r\033[K";
  std::cerr << wrapped(printable(name + ": " + message), terminal_columns(STDERR_FILENO)) << "\n";
}

// What was printed must have arrived.
Exit checked_output(const std::string& name, Exit exit) {
  errno = 0;
  std::cout.flush();
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout) return exit;
  complain(name,
           std::string("standard output: cannot write: ") + (errno != 0 ? std::strerror(errno) : "the stream failed"));
  return Exit::kData;
}

int out_of_memory(const std::string& name) {
  complain(name, "out of memory: more is asked for than this machine can hold; give a shorter duration or log, a "
                 "larger step, or fewer "
                 "values (--tau), axes or threads");
  return static_cast<int>(Exit::kData);
}

} // namespace

int run_program(cli::App* program, int argc, char** argv, const std::function<Exit()>& run) {
  CLI::App* app = &program->behind();
  const std::string name = app->get_name();
  set_notice_sink([name](const std::string& message) { complain(name, "note: " + message); });
  std::signal(SIGXFSZ, SIG_IGN); // a file beyond the limit of its size is an error to be told, and no end
  app->set_version_flag("--version", name + " (imucal) " IMUCAL_VERSION);
  try {
    std::vector<std::string> words = common_behind(*app, argc, argv);
    std::reverse(words.begin(), words.end()); // CLI11 takes them from the back
    app->parse(words);
    require_files(program->outputs());
    return static_cast<int>(checked_output(name, run()));
  } catch (const CLI::CallForHelp& e) {
    return app->exit(e);
  } catch (const CLI::CallForAllHelp& e) {
    return app->exit(e);
  } catch (const CLI::CallForVersion& e) {
    return app->exit(e);
  } catch (const CLI::ParseError& e) {
    complain(name, std::string(e.what()) + " (try " + name + " --help)");
    return static_cast<int>(Exit::kUsage);
  } catch (const Error& e) {
    complain(name, e.what());
    return static_cast<int>(e.exit());
  } catch (const std::bad_alloc&) {
    return out_of_memory(name);
  } catch (const std::length_error&) { // of a vector that no machine could hold
    return out_of_memory(name);
  } catch (const std::exception& e) {
    complain(name, std::string("internal error: ") + e.what());
    return static_cast<int>(Exit::kData);
  }
}

} // namespace imucal
