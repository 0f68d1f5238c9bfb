// SPDX-License-Identifier: MIT
// gyrosim: simulates a chamber and gyros.  `log` writes a log, `serve` feeds a device with raw samples of a
// simulated run, `replay` with those of a recorded log.
#include <cstdio>
#include <cstdlib>

#include "base/axis_unit.h"
#include "cli/program.h"
#include "device/feed.h"
#include "physics/effects/start_state.h"
#include "physics/sim/simulate.h"

using namespace imucal;

namespace {

struct LogOptions {
  CommonOptions common;
  std::vector<std::string> model_paths;
  std::string profile_path, effects_path, output_path;
  size_t n_axes = 0; // 0: as many as models
  SimOptions sim;
};

// How effects with a memory (hysteresis, lag, creep, warm-up, jumps at a temperature) begin the run.
void add_start(cli::App* app, SimOptions* sim) {
  app->add_option(
         "--start", [sim](const std::string& word) { sim->start = start_state_from(word); },
         "state of effects with a memory at the start of the run: drawn in every run (random), the same each "
         "time (cold), or without any rest of the past (settled); default random")
      ->check(cli::IsMember({"random", "cold", "settled"}))
      ->type_name("STATE");
}

// A quantum: none, or one by which a value can be divided.
const cli::Check Quantum{[](std::string& text) {
                           const double value = std::strtod(text.c_str(), nullptr);
                           return value == 0 || (value >= 1e-9 && value <= 1e9)
                                      ? std::string()
                                      : "expected 0 (none) or 1e-9 to 1e9, found \"" + text + "\"";
                         },
                         "QUANTUM"};
constexpr double kMostTempNoise_degc = 30;
// Rows that lie nearer than half a second are no rows of a second, and with more than half of them missing nobody can tell
// the usual step: no program reads such a log.
constexpr double kMostJitter_s = 0.07, kMostMissingSeconds = 0.45;

// What is missing; `--missing`, the name of before, meant seconds in `log` and samples in `serve` and `replay`.
enum Missing { kMissingSeconds, kMissingSamples };
constexpr bool kWithOldName = true;

void add_missing(cli::App* app, Missing what, double* frac, bool with_old_name = false) {
  const bool is_seconds = what == kMissingSeconds;
  const cli::Check check = cli::Range(0.0, is_seconds && with_old_name ? kMostMissingSeconds : 0.99);
  const cli::Option* option = app->add_option(is_seconds ? "--missing-seconds" : "--missing-samples", *frac,
                                              is_seconds ? "part of the seconds that are missing altogether"
                                                         : "part of the samples that never arrive")
                                  ->check(check);
  if (with_old_name) app->add_old_name("--missing", *frac, option)->check(check);
}

void add_log(cli::App* app, LogOptions* o) {
  app->add_option("--model", o->model_paths, "error model with thermal polynomial and effects; one, or one per axis")
      ->required()
      ->allow_extra_args(false)
      ->type_name("MODEL.json");
  app->add_option("--profile", o->profile_path, "temperature profile of the chamber")
      ->required()
      ->type_name("PROFILE.json");
  app->add_option("--axes", o->n_axes, "number of axes (default: one per model)")->check(cli::Range(1, 64));
  app->add_option("--effects", o->effects_path, "further effects: a list of {name, parameters, [axis], [log]}")
      ->type_name("EFFECTS.json");
  app->add_option("-o,--output", o->output_path, "log to write (- for standard output)")
      ->writes()
      ->required()
      ->type_name("LOG.csv");
  app->add_option("--log-index", o->sim.log_index,
                  "which log (run) of the device this is, from 0: noise, turn-on "
                  "constants and what changes from run to run differ by it")
      ->check(cli::Range(0, 65535))
      ->capture_default_str();
  app->add_option("--n-logs", o->sim.n_logs, "logs of the device in all")->check(cli::Range(1, 65536));
  app->add_option("--device", o->sim.device, "another device of the same seed")->capture_default_str();
  add_start(app, &o->sim);
  app->add_option("--temp-noise-degc", o->sim.temp_noise_degc, "thermometer noise per second")
      ->check(cli::Range(0.0, kMostTempNoise_degc));
  app->add_option("--temp-lsb-degc", o->sim.temp_lsb_degc, "thermometer quantum")->check(Quantum);
  app->add_option("--rate-lsb-dph", o->sim.rate_lsb_dph, "quantum of the 1-s means")->check(Quantum);
  app->add_option("--jitter-s", o->sim.jitter_s, "standard deviation of the time stamps")
      ->check(cli::Range(0.0, kMostJitter_s));
  add_missing(app, kMissingSeconds, &o->sim.missing_frac, kWithOldName);
  add_common_options(app, &o->common, kWithSeed);
}

Json start_json(const std::map<std::string, double>& values) {
  Json json = Json::object();
  for (const auto& [name, value] : values) json[name] = value;
  return json;
}

Json report(const LogOptions& o, const SimulatedLog& simulated, size_t n_rows) {
  Json json = {{"log", o.output_path},
               {"seed", o.common.seed},
               {"log_index", o.sim.log_index},
               {"rows", n_rows},
               {"axes", Json::array()}};
  for (const SimulatedAxis& a : simulated.axes)
    json["axes"].push_back({{"axis", a.name},
                            {"unit", axis_unit(a.name)},
                            {"turn_on_dph", a.turn_on_dph},
                            {"start", start_json(a.run.start_state)},
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

// What the raw samples of serve and replay look like; the device must be told the same scales.
void add_feed(cli::App* app, FeedOptions* o, CommonOptions* common) {
  app->add_option("--to", o->to, "where the sample records go: a file, a named pipe, tcp:HOST:PORT or tcp-listen:PORT")
      ->writes()
      ->required()
      ->type_name("SINK");
  app->add_option("--rate-hz", o->format.rate_hz, "raw samples per second")->capture_default_str();
  app->add_option("--counts-scale-dph", o->format.counts_scale_dph, "value of one count")->capture_default_str();
  app->add_option("--full-scale-counts", o->format.max_counts, "the sensor saturates here")->capture_default_str();
  app->add_option("--temp-lsb-degc", o->format.temp_lsb_degc, "value of one count of the thermometer")
      ->capture_default_str();
  app->add_option("--temp-offset-degc", o->format.temp_offset_degc, "temperature at count zero")->capture_default_str();
  app->add_option("--jitter-s", o->format.jitter_s, "standard deviation of the sample instants")
      ->check(cli::NonNegativeNumber);
  add_missing(app, kMissingSamples, &o->format.missing_frac, kWithOldName);
  app->add_option("--speed", o->speed, "sensor seconds per second; 0: as fast as the device takes them")
      ->check(cli::NonNegativeNumber);
  add_common_options(app, common, kWithSeed);
}

// As the emulated boards of the firmware count by default (firmware/README.md).
FeedOptions board_feed() {
  FeedOptions feed;
  feed.format.counts_scale_dph = 1;
  feed.format.max_counts = 8388607;
  return feed;
}

struct ServeOptions {
  CommonOptions common;
  FeedOptions feed = board_feed();
  std::vector<std::string> model_paths, accel_model_paths;
  std::string profile_path, effects_path, log_path;
  size_t n_axes = 0;
  double accel_scale_mg = 0.01;
  SimOptions sim;
};

void add_serve(cli::App* app, ServeOptions* o) {
  app->add_option("--model", o->model_paths, "error model with thermal polynomial and effects; one, or one per gyro")
      ->required()
      ->allow_extra_args(false)
      ->type_name("MODEL.json");
  app->add_option("--accel-model", o->accel_model_paths, "the same per accelerometer, its dph read as mg")
      ->allow_extra_args(false)
      ->type_name("MODEL.json");
  app->add_option("--profile", o->profile_path, "temperature profile of the chamber")
      ->required()
      ->type_name("PROFILE.json");
  app->add_option("--axes", o->n_axes, "number of gyros (default: one per model)")->check(cli::Range(1, 6));
  app->add_option("--effects", o->effects_path, "further effects: a list of {name, parameters, [axis], [log]}")
      ->type_name("EFFECTS.json");
  app->add_option("--accel-scale-mg", o->accel_scale_mg, "value of one count of an accelerometer")
      ->capture_default_str();
  app->add_option("-o,--output", o->log_path, "also write the run as a log of 1-s means")
      ->writes()
      ->type_name("LOG.csv");
  app->add_option("--log-index", o->sim.log_index, "which run of the device this is, from 0")
      ->check(cli::Range(0, 65535));
  app->add_option("--device", o->sim.device, "another device of the same seed");
  add_start(app, &o->sim);
  app->add_option("--temp-noise-degc", o->feed.format.temp_noise_degc, "thermometer noise per sample")
      ->check(cli::NonNegativeNumber);
  add_missing(app, kMissingSeconds, &o->sim.missing_frac);
  add_feed(app, &o->feed, &o->common);
}

// The result of feeding, for people and for scripts.
Exit tell_fed(const CommonOptions& common, const FeedOptions& options, const FeedResult& result) {
  if (common.wants_json())
    write_json(common.json_path, {{"seed", common.seed},
                                  {"rate_hz", options.format.rate_hz},
                                  {"samples", result.n_samples},
                                  {"saturated", result.n_saturated},
                                  {"sensor_s", result.sensor_s},
                                  {"complete", result.is_complete}});
  if (common.talks())
    std::printf("%s: %llu samples, %.0f s of sensor time, %llu saturated, seed %llu%s\n", options.to.c_str(),
                static_cast<unsigned long long>(result.n_samples), result.sensor_s,
                static_cast<unsigned long long>(result.n_saturated), static_cast<unsigned long long>(common.seed),
                result.is_complete ? "" : "; the device ended before the data did");
  return result.is_complete ? Exit::kDone : Exit::kNegative;
}

Exit run_serve(ServeOptions o) {
  std::vector<ErrorModel> models;
  for (const std::string& path : o.model_paths) models.push_back(read_model(path));
  const size_t n_gyros = o.n_axes ? o.n_axes : models.size();
  if (models.size() == 1) models.assign(n_gyros, ErrorModel(models.front()));
  if (models.size() != n_gyros)
    throw usage_error(std::to_string(models.size()) + " models for " + std::to_string(n_gyros) +
                      " gyros: give one, or one per gyro");
  o.feed.format.axis_scale.assign(n_gyros, o.feed.format.counts_scale_dph);
  for (const std::string& path : o.accel_model_paths) {
    models.push_back(read_model(path));
    models.back().unit = "mg";
    o.feed.format.axis_scale.push_back(o.accel_scale_mg);
  }
  std::vector<EffectSpec> effects;
  if (!o.effects_path.empty()) effects = read_effects(o.effects_path);
  o.sim.seed = o.feed.seed = o.common.seed;
  o.sim.n_logs = o.sim.log_index + 1;
  o.feed.quiet = o.common.quiet;
  const SimulatedDevice device = simulate_device(models, models.size(), read_profile(o.profile_path), effects, o.sim);
  if (!o.log_path.empty()) write_log(o.log_path, device.log);
  return tell_fed(o.common, o.feed, feed(device.seconds, o.feed));
}

struct ReplayOptions {
  CommonOptions common;
  FeedOptions feed = board_feed();
  std::string log_path;
};

void add_replay(cli::App* app, ReplayOptions* o) {
  app->add_option("LOG", o->log_path, "recorded log of 1-s means")->required()->type_name("LOG.csv");
  add_feed(app, &o->feed, &o->common);
}

Exit run_replay(ReplayOptions o) {
  const Log log = read_log(o.log_path);
  o.feed.seed = o.common.seed;
  o.feed.quiet = o.common.quiet;
  o.feed.format.dithered = true; // sums must give the recorded means back
  return tell_fed(o.common, o.feed, feed(replay_seconds(log), o.feed));
}

} // namespace

int main(int argc, char** argv) {
  cli::App app("simulates a chamber and gyros", "gyrosim");
  app.require_subcommand(1);
  LogOptions log;
  cli::App* log_app = app.add_subcommand("log", "write a simulated log of 1-s means");
  add_log(log_app, &log);
  ServeOptions serve;
  cli::App* serve_app = app.add_subcommand("serve", "feed a device with raw samples of a simulated run");
  add_serve(serve_app, &serve);
  ReplayOptions replay;
  cli::App* replay_app = app.add_subcommand("replay", "feed a device with a recorded log as raw samples");
  add_replay(replay_app, &replay);
  return run_program(&app, argc, argv, [&] {
    if (*serve_app) return run_serve(serve);
    if (*replay_app) return run_replay(replay);
    return run_log(log);
  });
}
