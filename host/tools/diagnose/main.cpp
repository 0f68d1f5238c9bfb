// SPDX-License-Identifier: MIT
// diagnose: is there a gap between the logs and the believed model, where, which effect, how far does it
// shrink.
#include <algorithm>
#include <cstdio>
#include <iostream>

#include "analysis/diagnose/diagnose.h"
#include "base/suggest.h"
#include "base/units.h"
#include "cli/program.h"
#include "cli/text.h"
#include "diagnose/library_json.h"
#include "diagnose/report.h"
#include "diagnose/report_text.h"
#include "physics/effects/effect.h"

using namespace imucal;

// "20:100": sigma in dph and time constant in seconds.
static Markov parse_instability(const std::string& text) {
  Markov out;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%lf:%lf%c", &out.sigma_dph, &out.tau_s, &rest) != 2 || !(out.sigma_dph > 0) ||
      !(out.tau_s > 0))
    throw usage_error("--instability \"" + text + "\": expected SIGMA_DPH:TAU_S, two positive numbers such as 20:100");
  return out;
}

namespace {

// What the command line says beside the options of the library.
struct Request {
  CommonOptions common;
  DiagnoseOptions options;
  bool list = false, no_cache = false;
  std::string model_out, instability;
  double arw = 0, white_mg = 0;
  double model_seconds = 0; // taken and not looked at
  cli::Option *arw_option = nullptr, *white_option = nullptr;
};

void add_noise_options(cli::App* app, Request* r) {
  app->add_option("--model", r->options.model_path, "error model that is believed; without it the noise is estimated")
      ->type_name("MODEL.json");
  r->arw_option = app->add_option("--arw", r->arw, "data sheet in the place of a model: angle random walk")
                      ->type_name("DEG_RT_H")
                      ->check(cli::PositiveNumber);
  r->white_option = app->add_option("--white", r->white_mg, "data sheet of an accelerometer: its white noise")
                        ->type_name("MG_RT_HZ")
                        ->check(cli::PositiveNumber);
  app->add_option("--instability", r->instability,
                  "data sheet: bias instability and its time constant (accelerometers: in mg)")
      ->type_name("SIGMA_DPH:TAU_S");
}

void add_data_options(cli::App* app, Request* r) {
  DiagnoseOptions& o = r->options;
  app->add_option("--log", o.logs, "logs of one device, each a run")->type_name("LOG.csv ...");
  app->add_option("--holdout", o.held_out, "logs that are not fitted, only predicted")->type_name("LOG.csv ...");
  app->add_option(
      "--axis", o.axes,
      "axes to diagnose (default: all gyros; accelerometers where the model is of one or there is no gyro)");
  app->add_option("--without", o.without, "effect to take out of the library");
  app->add_option("--only", o.only, "effect to keep; all others are taken out");
}

void add_calibration_options(cli::App* app, Request* r) {
  DiagnoseOptions& o = r->options;
  app->add_option(
         "--false-alarm-rate", o.false_alarm_rate,
         "probability of naming a cause in the mean when there is no gap, all candidates and axes counted; the "
         "tests of what is left have rates of their own")
      ->check(cli::Range(1e-6, 0.5))
      ->capture_default_str();
  app->add_option("--nulls", o.nulls, "simulations of the fitted noise for calibration")
      ->check(cli::Range(50, 100000))
      ->capture_default_str();
  app->add_option("--cache", o.cache_folder, "folder of calibrations")->type_name("DIR")->capture_default_str();
  app->add_flag("--no-cache", r->no_cache, "calibrate anew and keep nothing");
  app->add_option("--model-seconds", r->model_seconds,
                  "kept for old command lines: the noise is estimated again in any case")
      ->check(cli::NonNegativeNumber);
  app->add_option("--model-out", r->model_out, "write the model with the effects found")
      ->writes()
      ->type_name("MODEL.json");
  app->add_flag("--list-effects", r->list, "list the library and stop");
}

Exit list_effects(const CommonOptions& common) {
  const Json library = library_json();
  if (common.wants_json()) write_json(common.json_path, library);
  if (common.talks())
    for (const Json& effect : library["effects"])
      std::cout << effect["name"].text() << ": " << effect["description"].text() << "\n";
  return Exit::kDone;
}

// A name that no effect has is a slip of the command line, and no fault of the data.
void require_effects(const std::string& option, const std::vector<std::string>& names) {
  std::vector<std::string> known;
  for (const Effect* effect : effect_library()) known.push_back(effect->name());
  for (const std::string& name : names)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw usage_error(option + " " + name + ": there is no such effect" + did_you_mean(name, known) +
                        " (diagnose --list-effects names all)");
}

Exit run(Request* r) {
  const CommonOptions& common = r->common;
  DiagnoseOptions& options = r->options;
  if (r->list) return list_effects(common);
  if (options.logs.empty()) throw usage_error("at least one --log LOG.csv is needed (or --list-effects)");
  const bool has_white = r->white_option->count() > 0, has_arw = has_white || r->arw_option->count() > 0;
  if (has_white && r->arw_option->count() > 0)
    throw usage_error("give --arw (a gyro) or --white (an accelerometer), not both");
  if (!options.model_path.empty() && (has_arw || !r->instability.empty()))
    throw usage_error("give --model or a data sheet (--arw, --white, --instability), not both");
  if (has_arw) options.arw_deg_rt_h = has_white ? arw_from_white_sigma(r->white_mg) : r->arw;
  if (!r->instability.empty()) options.instability = parse_instability(r->instability);
  require_effects("--without", options.without);
  require_effects("--only", options.only);
  options.seed = common.seed;
  options.threads = common.thread_count();
  if (r->no_cache) options.cache_folder.clear();
  DiagnoseResult result = diagnose(options);
  if (!r->model_out.empty())
    result.warnings.insert(result.warnings.end(), result.model_warnings.begin(), result.model_warnings.end());
  if (common.wants_json()) write_json(common.json_path, diagnosis_json(options, result));
  if (!r->model_out.empty()) write_json(r->model_out, to_json(result.model));
  const std::vector<std::string> not_judged = unanswered(result);
  if (common.talks()) {
    say(stdout, diagnosis_text(result));
  } else {
    for (const std::string& warning : result.warnings) say(stderr, "diagnose: warning: " + warning + "\n");
    for (const std::string& line : not_judged) say(stderr, "diagnose: " + line + "\n");
  }
  return not_judged.empty() ? Exit::kDone : Exit::kNegative;
}

} // namespace

int main(int argc, char** argv) {
  cli::App app("find what a gyro or an accelerometer does that its error model leaves out; exit status 1: an axis "
               "could not be judged",
               "diagnose");
  Request request;
  request.options.cache_folder = default_cache_folder();
  add_common_options(&app, &request.common, kWithSeed | kWithThreads);
  add_noise_options(&app, &request);
  add_data_options(&app, &request);
  add_calibration_options(&app, &request);
  return run_program(&app, argc, argv, [&] { return run(&request); });
}
