// SPDX-License-Identifier: MIT
#include "cli/program.h"

#include <iostream>
#include <thread>

namespace imucal {

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

}  // namespace imucal
