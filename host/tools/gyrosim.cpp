// SPDX-License-Identifier: MIT
// gyrosim: simulates a chamber and gyros.  `log` writes a log.
#include <cstdio>

#include "cli/program.h"
#include "sim/simulate.h"

using namespace imucal;

namespace {

struct LogOptions {
  CommonOptions common;
  std::vector<std::string> model_paths;
  std::string profile_path, effects_path, output_path;
  size_t n_axes = 0;  // 0: as many as models
  SimOptions sim;
};

void add_log(CLI::App* app, LogOptions* o) {
  app->add_option("--model", o->model_paths, "error model with thermal polynomial and effects; one, or one per axis")
      ->required()
      ->allow_extra_args(false)
      ->type_name("MODEL.json");
  app->add_option("--profile", o->profile_path, "temperature profile of the chamber")
      ->required()
      ->type_name("PROFILE.json");
  app->add_option("--axes", o->n_axes, "number of axes (default: one per model)")->check(CLI::Range(1, 64));
  app->add_option("--effects", o->effects_path, "further effects: a list of {name, parameters, [axis], [log]}")
      ->type_name("EFFECTS.json");
  app->add_option("-o,--output", o->output_path, "log to write (- for standard output)")
      ->required()
      ->type_name("LOG.csv");
  app->add_option("--log-index", o->sim.log_index, "which log (run) of the device this is, from 0: noise, turn-on "
                                                   "constants and what changes from run to run differ by it")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  app->add_option("--n-logs", o->sim.n_logs, "logs of the device in all")->check(CLI::Range(1, 65536));
  app->add_option("--device", o->sim.device, "another device of the same seed")->capture_default_str();
  app->add_option("--temp-noise-degc", o->sim.temp_noise_degc, "thermometer noise per second")
      ->check(CLI::NonNegativeNumber);
  app->add_option("--temp-lsb-degc", o->sim.temp_lsb_degc, "thermometer quantum")->check(CLI::NonNegativeNumber);
  app->add_option("--rate-lsb-dph", o->sim.rate_lsb_dph, "quantum of the 1-s means")->check(CLI::NonNegativeNumber);
  app->add_option("--jitter-s", o->sim.jitter_s, "standard deviation of the time stamps")
      ->check(CLI::NonNegativeNumber);
  app->add_option("--missing", o->sim.missing_frac, "part of the seconds missing from the log")
      ->check(CLI::Range(0.0, 0.99));
  add_common_options(app, &o->common, kWithSeed);
}

Json report(const LogOptions& o, const SimulatedLog& simulated, size_t n_rows) {
  Json json = {{"log", o.output_path}, {"seed", o.common.seed}, {"log_index", o.sim.log_index},
               {"rows", n_rows},       {"axes", Json::array()}};
  for (const SimulatedAxis& a : simulated.axes)
    json["axes"].push_back({{"axis", a.name},
                            {"turn_on_dph", a.turn_on_dph},
                            {"bias",
                             {{"t0_degc", a.run.bias.t0_degc},
                              {"range_degc", a.run.bias.range_degc},
                              {"coeff_dph", a.run.bias.coeff_dph}}}});
  return json;
}

Exit run_log(LogOptions o) {
  std::vector<ErrorModel> models;
  for (const std::string& path : o.model_paths) models.push_back(read_model(path));
  const size_t n_axes = o.n_axes ? o.n_axes : models.size();
  const Profile profile = read_profile(o.profile_path);
  std::vector<EffectSpec> effects;
  if (!o.effects_path.empty()) effects = read_effects(o.effects_path);
  o.sim.seed = o.common.seed;
  if (o.sim.n_logs <= o.sim.log_index) o.sim.n_logs = o.sim.log_index + 1;
  const SimulatedLog simulated = simulate(models, n_axes, profile, effects, o.sim);
  const Log log = to_log(simulated, o.sim);
  write_log(o.output_path, log);
  if (o.common.wants_json()) write_json(o.common.json_path, report(o, simulated, log.size()));
  if (o.common.talks() && o.output_path != "-")
    std::printf("%s: %zu s, %zu axes, %.1f to %.1f degC, seed %llu, log %zu of %zu\n", o.output_path.c_str(),
                log.size(), n_axes, profile.min_degc(), profile.max_degc(),
                static_cast<unsigned long long>(o.common.seed), o.sim.log_index, o.sim.n_logs);
  return Exit::kDone;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("simulates a chamber and gyros", "gyrosim");
  app.require_subcommand(1);
  LogOptions log;
  CLI::App* log_app = app.add_subcommand("log", "write a simulated log of 1-s means");
  add_log(log_app, &log);
  return run_program(&app, argc, argv, [&] { return run_log(log); });
}
