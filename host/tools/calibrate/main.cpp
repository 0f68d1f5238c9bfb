// SPDX-License-Identifier: MIT
// calibrate: talks to the IMU over its serial port.  `calibrate --help` lists the subcommands.
#include <cstdio>

#include "base/error.h"

#include "calibrate/commands.h"
#include "calibrate/fit_command.h"
#include "io/table_json.h"

using namespace imucal;

namespace {

struct PortOptions {
  std::string port;
  int baud = kDefaultBaud;
  DeviceOptions device;
};

struct RunArguments {
  std::vector<std::string> model_paths;
  std::string profile_path, range, table_path;
  RunOptions run;
};

void add_port(cli::App* app, PortOptions* o) {
  app->add_option("-p,--port", o->port, "serial device (/dev/ttyACM0), pseudo-terminal (/dev/pts/3) or tcp:HOST:PORT")
      ->type_name("PORT");
  app->add_option("--baud", o->baud, "of a serial device")->capture_default_str();
  app->add_option("--timeout-s", o->device.reply_timeout_s, "how long to wait for a reply before asking again")
      ->check(cli::Range(0.01, 60.0))
      ->capture_default_str();
  app->add_option("--tries", o->device.tries, "how often to ask before giving the device up")
      ->check(cli::Range(1, 100))
      ->capture_default_str();
}

void add_run(cli::App* app, RunArguments* o) {
  app->add_option("--order", o->run.order, "order of the polynomial")
      ->check(cli::Range(1, IMUCAL_MAX_ORDER))
      ->capture_default_str();
  app->add_option("--model", o->model_paths, "error model; one for all axes, or one per axis")
      ->required()
      ->allow_extra_args(false)
      ->type_name("MODEL.json");
  app->add_option("--axis", o->run.axes, "axis to calibrate (repeat; default: all gyros)")->allow_extra_args(false);
  app->add_option("--range", o->range, "temperatures the table is for, degC (default: of the profile or the model)")
      ->type_name("LOW:HIGH");
  app->add_option("--profile", o->profile_path, "what the chamber does: gives range and duration")
      ->type_name("PROFILE.json");
  app->add_option("--until-error", o->run.until_error, "end when the predicted worst one-sigma error is below this")
      ->check(FinitePositive)
      ->type_name("DPH");
  app->add_option("--duration-s", o->run.duration_s, "end after so much sensor time")->check(FinitePositive);
  app->add_option("--stall-s", o->run.stall_s, "give up when the sensor delivers nothing for so long")
      ->check(FinitePositive)
      ->capture_default_str();
  app->add_option("--prior-sigma", o->run.prior_sigma, "what is known of a coefficient beforehand")
      ->check(cli::Range(1e-3, 1e6))
      ->capture_default_str();
  app->add_option("--record", o->run.record_path, "write the raw 1-s means as a log")->type_name("LOG.csv");
  app->add_option("--record-compensated", o->run.record_compensated_path, "write the compensated 1-s means as a log")
      ->type_name("LOG.csv");
  app->add_flag("--force", o->run.may_overwrite, "write over logs that are there");
  app->add_option("-o,--output", o->table_path, "write the table as flashed")->type_name("TABLE.json");
}

RunOptions complete(RunArguments arguments, bool quiet) {
  for (const std::string& path : arguments.model_paths) arguments.run.models.push_back(read_model(path));
  if (!arguments.profile_path.empty()) arguments.run.profile = read_profile(arguments.profile_path);
  if (!arguments.range.empty()) arguments.run.range = parse_range("--range", arguments.range);
  arguments.run.quiet = quiet;
  return arguments.run;
}

} // namespace

int main(int argc, char** argv) {
  cli::App app("calibrates an IMU over its serial port", "calibrate");
  app.require_subcommand(1);
  app.fallthrough();
  CommonOptions common;
  PortOptions port;
  add_common_options(&app, &common);
  add_port(&app, &port);

  cli::App* list = app.add_subcommand("list", "list the serial devices of this machine");
  cli::App* info = app.add_subcommand("info", "who the device is, its table, its counters");
  MonitorOptions watch;
  cli::App* monitor_app = app.add_subcommand("monitor", "print the 1-s means, raw and compensated");
  cli::App* record_app = app.add_subcommand("record", "write the 1-s means as a log");
  for (cli::App* sub : {monitor_app, record_app})
    sub->add_option("--duration-s", watch.duration_s, "end after so much sensor time (default: when the sensor ends)")
        ->check(FinitePositive);
  record_app->add_option("-o,--output", watch.raw_path, "log of the raw means")->required()->type_name("LOG.csv");
  record_app->add_option("--compensated", watch.compensated_path, "log of the compensated means")->type_name("LOG.csv");
  record_app->add_flag("--force", watch.may_overwrite, "write over logs that are there");
  RecoverArguments recover;
  cli::App* recover_app = app.add_subcommand("recover", "make a log of a recording that was cut off (LOG.csv.part)");
  recover_app->add_option("PART", recover.part_path, "what was left behind")->required()->type_name("LOG.csv.part");
  recover_app->add_option("-o,--output", recover.output_path, "log to write (default: the name without .part)")
      ->type_name("LOG.csv");
  recover_app->add_flag("--force", recover.may_overwrite, "write over a log that is there");
  RunArguments run;
  cli::App* run_app = app.add_subcommand("run", "learn the polynomials, flash the table, read it back");
  add_run(run_app, &run);
  std::string table_path;
  cli::App* flash = app.add_subcommand("flash", "flash a table, read it back");
  cli::App* verify = app.add_subcommand("verify", "compare a table with the device's (exit 1: differs)");
  cli::App* dump = app.add_subcommand("dump", "read the device's table");
  for (cli::App* sub : {flash, verify})
    sub->add_option("TABLE", table_path, "table (.json, or .bin: the bytes as flashed)")
        ->required()
        ->type_name("TABLE.json");
  dump->add_option("-o,--output", table_path, "table to write (.json or .bin)")->required()->type_name("TABLE.json");
  cli::App* rollback = app.add_subcommand("rollback", "return to the table before");
  FitArguments fit;
  cli::App* fit_app = app.add_subcommand("fit", "learn the polynomials from recorded logs, no device needed");
  add_fit_options(fit_app, &fit);
  cli::App* stop = app.add_subcommand("stop", "end a calibration that a program left running on the device");
  app.add_subcommand("erase", "erase both tables: the device runs uncompensated");

  return run_program(&app, argc, argv, [&]() -> Exit {
    if (*list) return list_ports(common);
    if (*fit_app) return fit_command(fit, common);
    if (*recover_app) return recover_command(recover, common);
    RunOptions run_options;
    if (*run_app) run_options = complete(run, common.quiet); // bad files show before the device is asked
    if (*flash || *verify) (void)read_table(table_path);
    Device device(open_transport(port.port, port.baud), port.device);
    device.connect();
    if (*info) return show_info(&device, common);
    if (*monitor_app || *record_app) return monitor(&device, watch, common);
    if (*run_app) return calibrate_device(&device, run_options, run.table_path, common);
    if (*flash) return flash_table(&device, table_path, common);
    if (*verify) return verify_table(&device, table_path, common);
    if (*dump) return dump_table(&device, table_path, common);
    if (*stop) return stop_session(&device, common);
    if (*rollback) return roll_back(&device, common);
    return erase_tables(&device, common);
  });
}
