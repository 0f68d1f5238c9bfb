// SPDX-License-Identifier: MIT
// diagnose: is there a gap between the logs and the believed model, where, which effect, how far does it
// shrink.
#include <iostream>

#include "cli/program.h"
#include "analysis/diagnose/diagnose.h"

using namespace imucal;

int main(int argc, char** argv) {
  CLI::App app("find what a gyro does that its error model leaves out", "diagnose");
  CommonOptions common;
  DiagnoseOptions options;
  bool list = false, no_cache = false;
  std::string model_out;
  options.cache_folder = default_cache_folder();
  add_common_options(&app, &common, kWithSeed | kWithThreads);
  app.add_option("--model", options.model_path, "error model that is believed")->type_name("MODEL.json");
  app.add_option("--log", options.logs, "logs of one device, each a run")->type_name("LOG.csv ...");
  app.add_option("--holdout", options.held_out, "logs that are not fitted, only predicted")
      ->type_name("LOG.csv ...");
  app.add_option("--axis", options.axes, "axes to diagnose (default: all gyro axes)");
  app.add_option("--without", options.without, "effect to take out of the library");
  app.add_option("--only", options.only, "effect to keep; all others are taken out");
  app.add_option(
         "--false-alarm-rate", options.false_alarm_rate,
         "probability of naming anything when there is no gap, all candidates, tests and axes counted")
      ->check(CLI::Range(1e-6, 0.5))
      ->capture_default_str();
  app.add_option("--nulls", options.nulls, "simulations of the nominal model for calibration")
      ->check(CLI::Range(50, 100000))
      ->capture_default_str();
  app.add_option("--cache", options.cache_folder, "folder of calibrations")
      ->type_name("DIR")
      ->capture_default_str();
  app.add_flag("--no-cache", no_cache, "calibrate anew and keep nothing");
  app.add_option(
         "--model-seconds", options.model_seconds,
         "the model's noise parameters were themselves estimated from this many seconds of data (0: known)")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--model-out", model_out, "write the model with the effects found")->type_name("MODEL.json");
  app.add_flag("--list-effects", list, "list the library and stop");
  return run_program(&app, argc, argv, [&] {
    if (list) {
      const Json library = library_json();
      if (common.wants_json()) write_json(common.json_path, library);
      if (common.talks())
        for (const Json& effect : library["effects"])
          std::cout << effect["name"].get<std::string>() << ": " << effect["description"].get<std::string>()
                    << "\n";
      return Exit::kDone;
    }
    if (options.model_path.empty() || options.logs.empty())
      throw usage_error("--model MODEL.json and at least one --log LOG.csv are needed (or --list-effects)");
    options.seed = common.seed;
    options.threads = common.thread_count();
    options.quiet = common.quiet;
    if (no_cache) options.cache_folder.clear();
    const DiagnoseResult result = diagnose(options);
    if (common.wants_json()) write_json(common.json_path, result.json);
    if (!model_out.empty()) write_json(model_out, to_json(result.model));
    if (common.talks()) std::cout << result.text;
    if (!common.talks())
      for (const std::string& warning : result.warnings)
        std::cerr << "diagnose: warning: " << warning << "\n";
    return Exit::kDone;
  });
}
