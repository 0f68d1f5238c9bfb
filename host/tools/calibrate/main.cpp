// SPDX-License-Identifier: MIT
// calibrate: talks to the IMU over its serial port.  `calibrate --help` lists the subcommands.
#include <cstdio>

#include "analysis/fit/judge.h"
#include "base/error.h"

#include "calibrate/commands.h"
#include "calibrate/fit_command.h"
#include "device/recorder.h"
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

void add_stall(cli::App* app, double* stall_s) {
  app->add_option("--stall-s", *stall_s,
                  "give up when the sensor delivers nothing for so long (default: 30 for the first second, then 2.5)")
      ->check(FinitePositive);
}

void add_run(cli::App* app, RunArguments* o) {
  app->add_option("--order", o->run.order, "order of the polynomial")
      ->check(cli::Range(1, IMUCAL_MAX_ORDER))
      ->capture_default_str();
  app->add_option("--model", o->model_paths, "error model; one for all axes, or one per axis")
      ->required()
      ->allow_extra_args(false)
      ->type_name("MODEL.json");
  app->add_option("--axis", o->run.axes,
                  "axis to calibrate (repeat; default: all gyros; all accelerometers where the model is of one)")
      ->allow_extra_args(false);
  app->add_option("--range", o->range, "temperatures the table is for, degC (default: of the profile or the model)")
      ->type_name("LOW:HIGH");
  app->add_option("--profile", o->profile_path, "what the chamber does: gives range and duration")
      ->type_name("PROFILE.json");
  app->add_option("--until-error", o->run.until_error, "end when the predicted worst one-sigma error is below this")
      ->check(FinitePositive)
      ->type_name("DPH");
  app->add_option("--duration-s", o->run.duration_s, "end after so much sensor time")->check(FinitePositive);
  add_stall(app, &o->run.stall_s);
  app->add_option("--faulty-s", o->run.faulty_s,
                  "give up when no axis has had a second without a fault for so long, of sensor time")
      ->check(FinitePositive)
      ->capture_default_str();
  app->add_option("--accept", o->run.judge.accept,
                  "flash although this rule speaks against it (repeat; rules: calibrate fit --help)")
      ->allow_extra_args(false)
      ->type_name("RULE");
  app->add_option("--max-error", o->run.judge.max_error_dph,
                  "largest predicted one-sigma error to accept, dph (accelerometers: mg); default 100 dph, 10 mg")
      ->check(FinitePositive)
      ->type_name("ERROR");
  app->add_flag("--keep-partial", o->run.keep_partial, "Ctrl-C: flash what was learnt so far (default: nothing)");
  add_prior_sigma(app, &o->run.prior_sigma, "what is known of a coefficient beforehand");
  app->add_option("--record", o->run.record_path, "write the raw 1-s means as a log")->writes()->type_name("LOG.csv");
  app->add_option("--record-compensated", o->run.record_compensated_path, "write the compensated 1-s means as a log")
      ->writes()
      ->type_name("LOG.csv");
  app->add_flag("--force", o->run.may_overwrite, "write over logs that are there");
  app->add_option("-o,--output", o->table_path, "write the table as flashed (also where the flash fails)")
      ->writes()
      ->type_name("TABLE.json");
}

RunOptions complete(RunArguments arguments, bool quiet) {
  for (const std::string& path : arguments.model_paths) arguments.run.models.push_back(read_model(path));
  if (!arguments.profile_path.empty()) arguments.run.profile = read_profile(arguments.profile_path);
  if (!arguments.range.empty()) arguments.run.range = parse_range("--range", arguments.range);
  arguments.run.quiet = quiet;
  return arguments.run;
}

struct Arguments {
  CommonOptions common;
  PortOptions port;
  MonitorOptions watch;
  RecoverArguments recover;
  RunArguments run;
  FitArguments fit;
  std::string table_path;
};

struct Commands {
  cli::App *list, *info, *monitor, *record, *recover, *run, *flash, *verify, *dump, *rollback, *fit, *stop;
};

void add_recordings(cli::App* app, Arguments* a, Commands* c) {
  c->monitor = app->add_subcommand("monitor", "print the 1-s means, raw and compensated");
  c->record = app->add_subcommand("record", "write the 1-s means as a log");
  for (cli::App* sub : {c->monitor, c->record}) {
    sub->add_option("--duration-s", a->watch.duration_s,
                    "end after so much sensor time (default: when the sensor ends)")
        ->check(FinitePositive);
    add_stall(sub, &a->watch.stall_s);
  }
  c->record->add_option("-o,--output", a->watch.raw_path, "log of the raw means")
      ->writes()
      ->required()
      ->type_name("LOG.csv");
  c->record->add_option("--compensated", a->watch.compensated_path, "log of the compensated means")
      ->writes()
      ->type_name("LOG.csv");
  c->record->add_flag("--force", a->watch.may_overwrite, "write over logs that are there");
  c->recover = app->add_subcommand("recover", "make a log of a recording that was cut off (LOG.csv.part)");
  c->recover->add_option("PART", a->recover.part_path, "what was left behind")->required()->type_name("LOG.csv.part");
  c->recover->add_option("-o,--output", a->recover.output_path, "log to write (default: the name without .part)")
      ->writes()
      ->type_name("LOG.csv");
  c->recover->add_flag("--force", a->recover.may_overwrite, "write over a log that is there");
}

void add_tables(cli::App* app, Arguments* a, Commands* c) {
  c->flash = app->add_subcommand("flash", "flash a table, read it back");
  c->verify = app->add_subcommand("verify", "compare a table with the device's (exit 1: differs)");
  c->dump = app->add_subcommand("dump", "read the device's table");
  for (cli::App* sub : {c->flash, c->verify})
    sub->add_option("TABLE", a->table_path, "table (.json, or .bin: the bytes as flashed)")
        ->required()
        ->type_name("TABLE.json");
  c->dump->add_option("-o,--output", a->table_path, "table to write (.json or .bin)")
      ->writes()
      ->required()
      ->type_name("TABLE.json");
  c->rollback = app->add_subcommand("rollback", "return to the table before");
}

Commands add_commands(cli::App* app, Arguments* a) {
  Commands c{};
  c.list = app->add_subcommand("list", "list the serial devices of this machine");
  c.info = app->add_subcommand("info", "who the device is, its table, its counters");
  add_recordings(app, a, &c);
  c.run = app->add_subcommand("run", "learn the polynomials, judge, flash the table, read it back");
  add_run(c.run, &a->run);
  add_tables(app, a, &c);
  c.fit = app->add_subcommand("fit", "learn the polynomials from recorded logs, no device needed");
  add_fit_options(c.fit, &a->fit);
  c.stop = app->add_subcommand("stop", "end a calibration that a program left running on the device");
  app->add_subcommand("erase", "erase both tables: the device runs uncompensated");
  return c;
}

// What a wrong file or name ends is seen before the device is asked, and before hours of work.
RunOptions checked_run(const Arguments& a) {
  require_rules(a.run.run.judge.accept);
  RunOptions options = complete(a.run, a.common.quiet);
  require_writable(a.run.table_path);
  if (a.common.wants_json()) require_writable(a.common.json_path);
  return options;
}

Exit with_device(const Commands& c, const Arguments& a) {
  const RunOptions run_options = *c.run ? checked_run(a) : RunOptions{};
  if (*c.flash || *c.verify) (void)read_table(a.table_path);
  Device device(open_transport(a.port.port, a.port.baud), a.port.device);
  device.connect();
  if (*c.info) return show_info(&device, a.common);
  if (*c.monitor || *c.record) return monitor(&device, a.watch, a.common);
  if (*c.run) return calibrate_device(&device, run_options, a.run.table_path, a.common);
  if (*c.flash) return flash_table(&device, a.table_path, a.common);
  if (*c.verify) return verify_table(&device, a.table_path, a.common);
  if (*c.dump) return dump_table(&device, a.table_path, a.common);
  if (*c.stop) return stop_session(&device, a.common);
  if (*c.rollback) return roll_back(&device, a.common);
  return erase_tables(&device, a.common);
}

} // namespace

int main(int argc, char** argv) {
  cli::App app("calibrates an IMU over its serial port", "calibrate");
  app.require_subcommand(1);
  app.fallthrough();
  Arguments a;
  add_common_options(&app, &a.common);
  add_port(&app, &a.port);
  const Commands c = add_commands(&app, &a);
  return run_program(&app, argc, argv, [&]() -> Exit {
    if (*c.list) return list_ports(a.common);
    if (*c.fit) return fit_command(a.fit, a.common);
    if (*c.recover) return recover_command(a.recover, a.common);
    return with_device(c, a);
  });
}
