// SPDX-License-Identifier: MIT
// Habits shared by all programs (host/README.md): --json --quiet --seed --threads --version, exit status, errors.
#pragma once
#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "base/progress.h"
#include "cli/arguments.h"
#include "io/json_file.h"

namespace imucal {

struct CommonOptions {
  std::string json_path; // empty: none; "-": standard output
  bool quiet = false;
  uint64_t seed = 1;
  int threads = 0; // 0: one per core

  bool wants_json() const { return !json_path.empty(); }
  // Text for people goes to standard output unless --quiet or the JSON goes there.
  bool talks() const { return !quiet && json_path != "-"; }
  int thread_count() const;
};

// What a command does: draws random numbers; works on several threads (any command takes --threads).
enum CommonFlag : unsigned { kWithSeed = 1, kWithThreads = 2 };

// A finite number above 0 (cli::PositiveNumber takes inf).
extern const cli::Check FinitePositive;

// Adds the options to a program (or a subcommand).
void add_common_options(cli::App* app, CommonOptions* options, unsigned flags = 0);

// Parses, runs `run`, prints errors as "<program>: <message>" to standard error; returns the exit status.
// `run` is called after parsing; it returns kDone or kNegative and throws Error otherwise.
int run_program(cli::App* app, int argc, char** argv, const std::function<Exit()>& run);

} // namespace imucal
