// SPDX-License-Identifier: MIT
// profile: calibration error of temperature profiles, what none can beat, and the best one for a chamber.
#include <cstdio>

#include "cli/program.h"
#include "profile/bound.h"
#include "profile/covariance.h"
#include "profile/report.h"

using namespace imucal;

namespace {

struct ErrorOptions {
  CommonOptions common;
  std::vector<std::string> inputs;
  std::string model, filter_model, range;
  int order = 3, points = 61;
  double prior_sigma_dph = 1e4;
  bool turn_on = false, restart_each_cycle = false, shape_only = false, proven = false;
};

Exit run_error(const ErrorOptions& o) {
  CalibrationSetup setup;
  setup.truth = read_model(o.model);
  setup.filter = o.filter_model.empty() ? setup.truth : read_model(o.filter_model);
  setup.order = o.order;
  setup.points = o.points;
  setup.prior_sigma_dph = o.prior_sigma_dph;
  setup.turn_on_constants = o.turn_on;
  setup.shape_only = o.shape_only;
  std::vector<CalibrationRun> runs;
  double lo = 1e300, hi = -1e300, max_rate = 0;
  for (const std::string& path : o.inputs) {
    ProfileInput input = read_profile_input(path, o.restart_each_cycle);
    lo = std::min(lo, input.lo_degc);
    hi = std::max(hi, input.hi_degc);
    max_rate = std::max(max_rate, input.max_rate_degc_per_min);
    for (CalibrationRun& run : input.runs) runs.push_back(std::move(run));
  }
  check_distinct_temperatures(runs, o.order);
  const TemperatureRange range = o.range.empty() ? TemperatureRange{lo, hi} : parse_range("--range", o.range);
  setup.lo_degc = range.lo_degc;
  setup.hi_degc = range.hi_degc;
  const CalibrationError error = calibration_error(runs, setup);
  const double bound_dph = slow_ramp_bound(setup.truth, o.order, error.duration_s);

  Json json = to_json(error);
  json["bound_dph"] = bound_dph;
  json["efficiency"] = bound_dph / error.worst_dph;
  json["order"] = o.order;
  json["range_degc"] = {range.lo_degc, range.hi_degc};
  json["runs"] = runs.size();
  Bound bound;
  if (o.proven && runs.size() == 1 && max_rate > 0) {
    bound = calibration_bound({setup.truth, o.order, error.duration_s, range.hi_degc - range.lo_degc, max_rate,
                               o.prior_sigma_dph, 1.0});
    json["proven_bound_dph"] = bound.proven_dph;
    json["proven_efficiency"] = bound.proven_dph / error.worst_dph;
  }
  if (o.common.talks()) {
    std::fputs(error_text(error, !o.filter_model.empty()).c_str(), stdout);
    std::printf("worst %.3f dph, rms %.3f dph over %g..%g degC after %.0f s (%zu run%s)\n", error.worst_dph,
                error.rms_dph, range.lo_degc, range.hi_degc, error.duration_s, runs.size(),
                runs.size() == 1 ? "" : "s");
    std::printf("slow-ramp bound %.3f dph: efficiency %.1f %%\n", bound_dph, 100 * bound_dph / error.worst_dph);
    if (bound.proven_dph > 0)
      std::printf("proven bound at up to %g degC/min %.3f dph: efficiency %.1f %%\n", max_rate, bound.proven_dph,
                  100 * bound.proven_dph / error.worst_dph);
    if (lo > range.lo_degc + 1e-9 || hi < range.hi_degc - 1e-9)
      std::printf("note: the temperatures reach %g..%g degC only; beyond them the polynomial extrapolates\n", lo, hi);
    if (!o.turn_on && setup.truth.turn_on_sigma_dph > 0)
      std::printf("note: the turn-on constant (%g dph) is taken as part of b0; --turn-on counts it as an error\n",
                  setup.truth.turn_on_sigma_dph);
  }
  if (o.common.wants_json()) write_json(o.common.json_path, json);
  return Exit::kDone;
}

struct BoundOptions {
  CommonOptions common;
  std::string model, range;
  int order = 3;
  double duration_s = 0, max_rate = 0, max_cooling_rate = 0, prior_sigma_dph = 1e4;
};

Exit run_bound(const BoundOptions& o) {
  BoundRequest request;
  request.model = read_model(o.model);
  request.order = o.order;
  request.duration_s = o.duration_s;
  // Unlimited heating with a limit on cooling is unlimited for the bound.
  request.max_rate_degc_per_min = o.max_rate > 0 ? std::max(o.max_rate, o.max_cooling_rate) : 0;
  request.prior_sigma_dph = o.prior_sigma_dph;
  if (o.max_rate > 0 && o.range.empty())
    throw usage_error("--max-rate needs --range A:B: how far the chamber has to go");
  if (!o.range.empty()) {
    const TemperatureRange range = parse_range("--range", o.range);
    request.span_degc = range.hi_degc - range.lo_degc;
  }
  const Bound bound = calibration_bound(request);
  if (o.common.talks()) {
    std::printf("slow-ramp bound    %8.3f dph\n", bound.slow_ramp_dph);
    for (const std::string& a : bound.assumptions) std::printf("    - %s\n", a.c_str());
    std::printf("proven bound       %8.3f dph\n", bound.proven_dph);
    for (const std::string& a : bound.proven_assumptions) std::printf("    - %s\n", a.c_str());
  }
  if (o.common.wants_json()) write_json(o.common.json_path, to_json(bound));
  return Exit::kDone;
}

void add_error(CLI::App* app, ErrorOptions* o) {
  app->add_option("input", o->inputs, "profiles (JSON) or recorded logs (CSV); each is a run")->required()->type_name("FILE");
  app->add_option("--model", o->model, "true error model (JSON)")->required()->type_name("FILE");
  app->add_option("--filter-model", o->filter_model, "error model that the filter assumes (default: the true one)")->type_name("FILE");
  app->add_option("--order", o->order, "order of the polynomial")->required();
  app->add_option("--range", o->range, "span A:B in degC that is judged (default: what the profile reaches)")->type_name("A:B");
  app->add_option("--points", o->points, "temperatures reported")->check(CLI::Range(2, 10001))->capture_default_str();
  app->add_option("--prior-sigma-dph", o->prior_sigma_dph, "sigma of each coefficient before the test")->check(CLI::Range(1e-3, 1e9))->capture_default_str();
  app->add_flag("--turn-on", o->turn_on, "count the model's turn-on constant, one per run");
  app->add_flag("--restart-each-cycle", o->restart_each_cycle, "the device is switched off between the profile's repeats");
  app->add_flag("--shape-only", o->shape_only, "judge B(T) less its mean over the span");
  app->add_flag("--proven", o->proven, "also the proven bound at the profile's fastest ramp");
  add_common_options(app, &o->common);
}

void add_bound(CLI::App* app, BoundOptions* o) {
  app->add_option("--model", o->model, "error model (JSON)")->required()->type_name("FILE");
  app->add_option("--order", o->order, "order of the polynomial")->required();
  app->add_option("--duration-s", o->duration_s, "duration of the test")->required();
  app->add_option("--range", o->range, "calibrated span A:B in degC")->type_name("A:B");
  app->add_option("--max-rate", o->max_rate, "highest |dT/dt| of heating in degC/min (0: unlimited)")->check(CLI::Range(0.0, 1e4));
  app->add_option("--max-cooling-rate", o->max_cooling_rate, "the same for cooling (default: as heating)")->check(CLI::Range(0.0, 1e4));
  app->add_option("--prior-sigma-dph", o->prior_sigma_dph, "sigma of each coefficient before the test")->check(CLI::Range(1e-3, 1e9))->capture_default_str();
  add_common_options(app, &o->common);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Temperature profiles: calibration error, bounds, optimisation.", "profile");
  app.require_subcommand(1);
  ErrorOptions error;
  BoundOptions bound;
  CLI::App* error_app = app.add_subcommand("error", "calibration error over temperature that a profile or log leaves");
  CLI::App* bound_app = app.add_subcommand("bound", "what no profile of a duration can beat");
  add_error(error_app, &error);
  add_bound(bound_app, &bound);
  return run_program(&app, argc, argv, [&] {
    if (error_app->parsed()) return run_error(error);
    return run_bound(bound);
  });
}
