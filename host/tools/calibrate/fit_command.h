// SPDX-License-Identifier: MIT
// `calibrate fit`: logs in, table and result out.
#pragma once
#include <string>
#include <vector>

#include "analysis/fit/fit.h"
#include "base/error.h"
#include "cli/program.h"

namespace imucal {

// --prior-sigma-dph, in the unit of the axis for accelerometers; --prior-sigma as it was called before.
void add_prior_sigma(cli::App* app, double* sigma, const std::string& help);

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
