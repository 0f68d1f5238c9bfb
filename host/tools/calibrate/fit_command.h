// SPDX-License-Identifier: MIT
// `calibrate fit`: logs in, table and result out.
#pragma once
#include <string>
#include <vector>

#include "analysis/fit/fit.h"
#include "base/error.h"
#include "cli/program.h"

namespace imucal {

struct FitArguments {
  std::vector<std::string> log_paths;
  std::vector<std::string> model_paths;
  std::string method = "kf", table_path, range;
  FitOptions options;
  TableInfo table;
};

struct RecoverArguments {
  std::string part_path, output_path;
  bool may_overwrite = false;
};
Exit recover_command(const RecoverArguments& arguments, const CommonOptions& common);

// Adds the subcommand's options.
void add_fit_options(cli::App* app, FitArguments* arguments);

Exit fit_command(const FitArguments& arguments, const CommonOptions& common);

} // namespace imucal
