// SPDX-License-Identifier: MIT
// profile: calibration error of temperature profiles, what none can beat, and the best one for a chamber.
#include <cstdio>
#include <optional>

#include "analysis/profile/bound.h"
#include "analysis/profile/covariance.h"
#include "analysis/profile/optimize.h"
#include "analysis/profile/signature.h"
#include "cli/program.h"
#include "cli/text.h"
#include "profile/report.h"

using namespace imucal;

namespace {

struct ErrorOptions {
  CommonOptions common;
  std::vector<std::string> inputs;
  std::string model, filter_model, range;
  int order = 3, points = 61;
  double prior_sigma_dph = kPriorSigma;
  bool turn_on = false, restart_each_cycle = false, shape_only = false, proven = false;
  std::string tell_apart;
};

// A yardstick that a fast profile, or noise slower than the test, may beat: then it says so.
void print_yardstick(double bound_dph, double worst_dph, const std::string& unit) {
  tell("slow-ramp bound %.3f %s: efficiency %.1f %%\n", bound_dph, unit.c_str(), 100 * bound_dph / worst_dph);
  if (worst_dph < bound_dph)
    tell("  (beaten: ramps are not slow against the noise here, or the noise is slower than the test; "
         "the proven "
         "bound holds)\n");
}

// The runs of all inputs and what they reach.
struct Reached {
  std::vector<CalibrationRun> runs;
  double lo_degc = 1e300, hi_degc = -1e300, max_rate_degc_per_min = 0;
};

Reached read_inputs(const ErrorOptions& o) {
  Reached all;
  for (const std::string& path : o.inputs) {
    ProfileInput input = read_profile_input(path, o.restart_each_cycle);
    all.lo_degc = std::min(all.lo_degc, input.lo_degc);
    all.hi_degc = std::max(all.hi_degc, input.hi_degc);
    all.max_rate_degc_per_min = std::max(all.max_rate_degc_per_min, input.max_rate_degc_per_min);
    for (CalibrationRun& run : input.runs) all.runs.push_back(std::move(run));
  }
  check_distinct_temperatures(all.runs, o.order);
  return all;
}

// Without the span.
CalibrationSetup setup_of(const ErrorOptions& o) {
  CalibrationSetup setup;
  setup.truth = read_model(o.model);
  setup.filter = o.filter_model.empty() ? setup.truth : read_model(o.filter_model);
  if (setup.filter.unit_or_dph() != setup.truth.unit_or_dph())
    throw data_error(o.filter_model + ": a model in " + setup.filter.unit_or_dph() + ", that of the sensor, " +
                     o.model + ", is in " + setup.truth.unit_or_dph() + ": give two models of one sensor");
  setup.order = o.order;
  setup.points = o.points;
  setup.prior_sigma_dph = o.prior_sigma_dph;
  setup.turn_on_constants = o.turn_on;
  setup.shape_only = o.shape_only;
  return setup;
}

struct ErrorResult {
  CalibrationError error;
  SignatureTable signatures;
  double slow_ramp_dph = 0;
  std::optional<Bound> proven; // where asked for and defined: one run with ramps
};

ErrorResult judge_runs(const ErrorOptions& o, const CalibrationSetup& setup, const Reached& in) {
  ErrorResult r;
  r.error = calibration_error(in.runs, setup);
  r.slow_ramp_dph = slow_ramp_bound(setup.truth, o.order, r.error.duration_s);
  r.signatures = signature_table(
      in.runs, setup, o.tell_apart.empty() ? standard_effects(o.order) : effects_by_name(o.tell_apart, o.order));
  if (o.proven && in.runs.size() == 1 && in.max_rate_degc_per_min > 0)
    r.proven = calibration_bound({setup.truth, o.order, r.error.duration_s, setup.hi_degc - setup.lo_degc,
                                  in.max_rate_degc_per_min, o.prior_sigma_dph, 1.0});
  return r;
}

Json yardstick_json(const CalibrationError& error, double bound_dph) {
  Json json = to_json(error);
  json["bound_dph"] = bound_dph;
  json["efficiency"] = bound_dph / error.worst_dph;
  return json;
}

Json with_unit(Json json, const ErrorModel& model) {
  json["unit"] = model.unit_or_dph();
  return json;
}

void add_proven(const CalibrationError& error, const Bound& bound, Json* json) {
  (*json)["proven_bound_dph"] = bound.proven_dph;
  (*json)["proven_efficiency"] = bound.proven_dph / error.worst_dph;
}

Json error_json(const ErrorOptions& o, const CalibrationSetup& setup, size_t n_runs, const ErrorResult& r) {
  Json json = yardstick_json(r.error, r.slow_ramp_dph);
  json["unit"] = setup.truth.unit_or_dph();
  json["order"] = o.order;
  json["range_degc"] = {setup.lo_degc, setup.hi_degc};
  json["runs"] = n_runs;
  json["tell_apart"] = to_json(r.signatures);
  json["worst_correlation"] = r.signatures.worst;
  if (r.proven) add_proven(r.error, *r.proven, &json);
  return json;
}

void print_error(const ErrorOptions& o, const CalibrationSetup& setup, const Reached& in, const ErrorResult& r) {
  const size_t n_runs = in.runs.size();
  std::fputs(error_text(r.error, !o.filter_model.empty(), setup.truth.unit_or_dph()).c_str(), stdout);
  const std::string unit_text = setup.truth.unit_or_dph();
  const char* unit = unit_text.c_str();
  tell("worst %.3f %s, rms %.3f %s over %g..%g degC after %.0f s (%zu run%s)\n", r.error.worst_dph, unit,
       r.error.rms_dph, unit, setup.lo_degc, setup.hi_degc, r.error.duration_s, n_runs, n_runs == 1 ? "" : "s");
  print_yardstick(r.slow_ramp_dph, r.error.worst_dph, unit_text);
  if (r.proven && r.proven->proven_dph > 0)
    tell("proven bound at up to %g degC/min %.3f %s: efficiency %.1f %%\n", in.max_rate_degc_per_min,
         r.proven->proven_dph, unit, 100 * r.proven->proven_dph / r.error.worst_dph);
  say(stdout, signature_text(r.signatures, unit));
  if (in.lo_degc > setup.lo_degc + 1e-9 || in.hi_degc < setup.hi_degc - 1e-9)
    tell("note: the temperatures reach %g..%g degC only; beyond them the polynomial extrapolates\n", in.lo_degc,
         in.hi_degc);
  if (!o.turn_on && setup.truth.turn_on_sigma_dph > 0)
    tell("note: the turn-on constant (%g %s) is taken as part of b0; --turn-on counts it as an error\n",
         setup.truth.turn_on_sigma_dph, unit);
}

Exit run_error(const ErrorOptions& o) {
  CalibrationSetup setup = setup_of(o);
  const Reached in = read_inputs(o);
  const TemperatureRange range =
      o.range.empty() ? TemperatureRange{in.lo_degc, in.hi_degc} : parse_range("--range", o.range);
  setup.lo_degc = range.lo_degc;
  setup.hi_degc = range.hi_degc;
  const ErrorResult r = judge_runs(o, setup, in);
  if (o.common.talks()) print_error(o, setup, in, r);
  if (o.common.wants_json()) write_json(o.common.json_path, error_json(o, setup, in.runs.size(), r));
  return Exit::kDone;
}

struct BoundOptions {
  CommonOptions common;
  std::string model, range;
  int order = 3;
  double duration_s = 0, max_rate = 0, max_cooling_rate = 0, prior_sigma_dph = kPriorSigma;
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
    const std::string unit = request.model.unit_or_dph();
    tell("slow-ramp bound    %8.3f %s\n", bound.slow_ramp_dph, unit.c_str());
    for (const std::string& a : bound.assumptions) tell("    - %s\n", a.c_str());
    tell("proven bound       %8.3f %s\n", bound.proven_dph, unit.c_str());
    for (const std::string& a : bound.proven_assumptions) tell("    - %s\n", a.c_str());
  }
  if (o.common.wants_json()) write_json(o.common.json_path, with_unit(to_json(bound), request.model));
  return Exit::kDone;
}

struct OptimizeOptions {
  CommonOptions common;
  std::string model, range, profile_path, objective = "worst", tell_apart;
  int order = 3, effort = 1;
  double max_rate = 0, max_cooling_rate = 0, duration_s = 0, required_error_dph = 0, min_soak_s = 0, max_soak_s = 0,
         max_correlation = 0.75, prior_sigma_dph = kPriorSigma, spend_percent = 0;
  bool no_proof = false;
};

void check_optimize_options(const OptimizeOptions& o) {
  if ((o.duration_s > 0) == (o.required_error_dph > 0))
    throw usage_error("give either --duration-s or --required-error (the shortest duration that reaches it)");
  if (o.spend_percent > 0 && o.tell_apart.empty()) throw usage_error("--spend needs --tell-apart: what to spend it on");
}

OptimizeRequest request_of(const OptimizeOptions& o) {
  OptimizeRequest request;
  request.setup.truth = request.setup.filter = read_model(o.model);
  request.setup.order = o.order;
  request.setup.prior_sigma_dph = o.prior_sigma_dph;
  const TemperatureRange range = parse_range("--range", o.range);
  request.setup.lo_degc = range.lo_degc;
  request.setup.hi_degc = range.hi_degc;
  request.limits = {range.lo_degc, range.hi_degc, o.max_rate, o.max_cooling_rate > 0 ? o.max_cooling_rate : o.max_rate,
                    o.min_soak_s,  o.max_soak_s};
  request.duration_s = o.duration_s;
  request.required_dph = o.required_error_dph;
  request.objective = o.objective == "rms" ? Objective::kRms : Objective::kWorst;
  if (!o.tell_apart.empty())
    request.tell_apart = o.tell_apart == "all" ? standard_effects(o.order) : effects_by_name(o.tell_apart, o.order);
  request.max_correlation = o.max_correlation;
  request.spend_frac = o.spend_percent / 100;
  request.seed = o.common.seed;
  request.effort = o.effort;
  return request;
}

OptimizeResult optimize_shown(OptimizeRequest request, bool quiet) {
  Progress progress("optimising", 1, quiet);
  request.progress = [&](double done_frac, double best_dph) {
    char note[48];
    std::snprintf(note, sizeof note, "best %.3f %s", best_dph, request.setup.truth.unit_or_dph().c_str());
    progress.update(done_frac, note);
  };
  OptimizeResult r = optimize_profile(request);
  progress.finish();
  return r;
}

// Slow ramps, and what is proven under the chamber's limits unless --no-proof.
Bound bound_of(const OptimizeOptions& o, const OptimizeRequest& request, double duration_s) {
  Bound bound;
  if (!o.no_proof)
    bound = calibration_bound({request.setup.truth, o.order, duration_s, request.limits.span_degc(),
                               std::max(request.limits.heating_degc_per_min, request.limits.cooling_degc_per_min),
                               o.prior_sigma_dph, 1.0});
  bound.slow_ramp_dph = slow_ramp_bound(request.setup.truth, o.order, duration_s);
  return bound;
}

Json optimize_json(const OptimizeOptions& o, const OptimizeResult& r, const Bound& bound) {
  Json json = yardstick_json(r.error, bound.slow_ramp_dph);
  if (!o.no_proof) add_proven(r.error, bound, &json);
  json["objective"] = o.objective;
  json["worst_correlation"] = r.signatures.worst;
  json["tell_apart"] = to_json(r.signatures);
  if (!o.tell_apart.empty()) {
    json["max_correlation"] = o.max_correlation;
    json["meets_correlation"] = r.meets_correlation;
    json["accuracy_only_dph"] = r.accuracy_only_dph;
  }
  if (r.paper_passes > 0)
    json["paper"] = {{"passes", r.paper_passes},
                     {"worst_dph", r.paper_error.worst_dph},
                     {"rms_dph", r.paper_error.rms_dph},
                     {"efficiency", bound.slow_ramp_dph / r.paper_error.worst_dph},
                     {"profile", to_json(r.paper)}};
  json["shape"] = r.shape;
  json["profile"] = to_json(r.profile);
  json["seed"] = o.common.seed;
  json["evaluations"] = r.evaluations;
  return json;
}

void print_legs(const Profile& profile) {
  for (const ProfileLeg& leg : legs(profile)) {
    if (leg.start_degc == leg.end_degc)
      tell("  soak %8.1f s at %7.2f degC\n", leg.end_s - leg.start_s, leg.start_degc);
    else
      tell("  ramp %8.1f s to %7.2f degC (%+.3f degC/min)\n", leg.end_s - leg.start_s, leg.end_degc,
           leg.rate_degc_per_min());
  }
}

void print_optimum(const OptimizeOptions& o, const OptimizeResult& r, const Bound& bound,
                   const std::string& unit_text) {
  const char* unit = unit_text.c_str();
  tell("worst %.3f %s, rms %.3f %s after %.0f s (%s)\n", r.error.worst_dph, unit, r.error.rms_dph, unit,
       r.error.duration_s, r.shape.c_str());
  print_legs(r.profile);
  print_yardstick(bound.slow_ramp_dph, r.error.worst_dph, unit_text);
  if (!o.no_proof)
    tell("proven bound under the rate limit %.3f %s: efficiency %.1f %%\n", bound.proven_dph, unit,
         100 * bound.proven_dph / r.error.worst_dph);
  if (r.paper_passes > 0)
    tell("ramps with equal soaks at both ends (%d pass%s): %.3f %s, efficiency %.1f %%\n", r.paper_passes,
         r.paper_passes == 1 ? "" : "es", r.paper_error.worst_dph, unit,
         100 * bound.slow_ramp_dph / r.paper_error.worst_dph);
  say(stdout, signature_text(r.signatures, unit));
  if (!o.tell_apart.empty())
    tell("cost of telling apart: %.1f %% (%.3f %s for accuracy alone)\n",
         100 * (r.objective_dph / r.accuracy_only_dph - 1), r.accuracy_only_dph, unit);
}

// The correlation is above what is allowed: by how much, between which effects, and what makes it possible.
void print_too_alike(const OptimizeOptions& o, const SignatureTable& signatures) {
  warn("profile: no profile found whose worst correlation is at most %g; the best has %.3f (%s, %s).  More "
       "time, a faster chamber or --max-correlation %.3f makes it possible\n",
       o.max_correlation, signatures.worst, signatures.effects[signatures.worst_a].name.c_str(),
       signatures.effects[signatures.worst_b].name.c_str(), signatures.worst + 0.0005);
}

Exit run_optimize(const OptimizeOptions& o) {
  check_optimize_options(o);
  const OptimizeRequest request = request_of(o);
  const OptimizeResult r = optimize_shown(request, o.common.quiet);
  if (!o.profile_path.empty()) write_json(o.profile_path, to_json(r.profile));
  const Bound bound = bound_of(o, request, r.error.duration_s);
  if (o.common.talks()) print_optimum(o, r, bound, request.setup.truth.unit_or_dph());
  if (o.common.wants_json()) write_json(o.common.json_path, with_unit(optimize_json(o, r, bound), request.setup.truth));
  if (!r.meets_correlation) {
    print_too_alike(o, r.signatures);
    return Exit::kNegative;
  }
  return r.meets_error ? Exit::kDone : Exit::kNegative;
}

void add_error(cli::App* app, ErrorOptions* o) {
  app->add_option("input", o->inputs, "profiles (JSON) or recorded logs (CSV); each is a run")
      ->required()
      ->type_name("FILE");
  app->add_option("--model", o->model, "true error model (JSON)")->required()->type_name("FILE");
  app->add_option("--filter-model", o->filter_model, "error model that the filter assumes (default: the true one)")
      ->type_name("FILE");
  app->add_option("--order", o->order, "order of the polynomial")->required();
  app->add_option("--range", o->range, "span A:B in degC that is judged (default: what the profile reaches)")
      ->type_name("A:B");
  app->add_option("--points", o->points, "temperatures reported")->check(cli::Range(2, 10001))->capture_default_str();
  app->add_option("--prior-sigma-dph", o->prior_sigma_dph, "sigma of each coefficient before the test")
      ->check(cli::Range(1e-3, 1e9))
      ->capture_default_str();
  app->add_flag("--turn-on", o->turn_on, "count the model's turn-on constant, one per run");
  app->add_flag("--restart-each-cycle", o->restart_each_cycle,
                "the device is switched off between the profile's repeats");
  app->add_flag("--shape-only", o->shape_only, "judge B(T) less its mean over the span");
  app->add_option("--tell-apart", o->tell_apart,
                  "effects whose signatures are compared (default: lag, rate, hysteresis, turn-on, ageing, 4th order)")
      ->type_name("EFFECT,EFFECT");
  app->add_flag("--proven", o->proven, "also the proven bound at the profile's fastest ramp");
  add_common_options(app, &o->common);
}

void add_bound(cli::App* app, BoundOptions* o) {
  app->add_option("--model", o->model, "error model (JSON)")->required()->type_name("FILE");
  app->add_option("--order", o->order, "order of the polynomial")->required();
  app->add_option("--duration-s", o->duration_s, "duration of the test")->required()->check(FinitePositive);
  app->add_option("--range", o->range, "calibrated span A:B in degC")->type_name("A:B");
  app->add_option("--max-rate", o->max_rate, "highest |dT/dt| of heating in degC/min (0: unlimited)")
      ->check(cli::Range(0.0, 1e4));
  app->add_option("--max-cooling-rate", o->max_cooling_rate, "the same for cooling (default: as heating)")
      ->check(cli::Range(0.0, 1e4));
  app->add_option("--prior-sigma-dph", o->prior_sigma_dph, "sigma of each coefficient before the test")
      ->check(cli::Range(1e-3, 1e9))
      ->capture_default_str();
  add_common_options(app, &o->common);
}

void add_optimize(cli::App* app, OptimizeOptions* o) {
  app->add_option("--model", o->model, "error model (JSON)")->required()->type_name("FILE");
  app->add_option("--order", o->order, "order of the polynomial")->required();
  app->add_option("--range", o->range, "span A:B in degC to calibrate")->required()->type_name("A:B");
  app->add_option("--max-rate", o->max_rate,
                  "highest rate of the chamber, degC/min (heating; cooling too if not given)")
      ->required();
  app->add_option("--max-cooling-rate", o->max_cooling_rate, "highest cooling rate, degC/min")->check(FinitePositive);
  app->add_option("--duration-s", o->duration_s, "duration of the test")->check(FinitePositive);
  app->add_option("--required-error", o->required_error_dph,
                  "instead of a duration: the shortest that reaches this objective, dph")
      ->check(FinitePositive);
  app->add_option("--objective", o->objective, "worst or rms error over the span")
      ->check(cli::IsMember({"worst", "rms"}))
      ->capture_default_str();
  app->add_option("--min-soak-s", o->min_soak_s, "shortest soak")->check(cli::NonNegativeNumber);
  app->add_option("--max-soak-s", o->max_soak_s, "longest soak (0: unlimited)")->check(cli::NonNegativeNumber);
  app->add_option("--tell-apart", o->tell_apart, "keep these effects apart: names, or all for the standard six")
      ->type_name("EFFECT,EFFECT");
  app->add_option("--max-correlation", o->max_correlation, "largest correlation allowed between their signatures")
      ->check(cli::Range(0.05, 1.0))
      ->capture_default_str();
  app->add_option("--spend", o->spend_percent,
                  "with --tell-apart: accuracy that may be given up, percent, to make the signatures strong")
      ->check(cli::Range(0.0, 1000.0))
      ->type_name("PERCENT");
  app->add_option("--effort", o->effort, "multiplies the number of evaluations")
      ->check(cli::Range(1, 100))
      ->capture_default_str();
  app->add_option("--prior-sigma-dph", o->prior_sigma_dph, "sigma of each coefficient before the test")
      ->check(cli::Range(1e-3, 1e9))
      ->capture_default_str();
  app->add_flag("--no-proof", o->no_proof, "skip the proven bound (about half a second)");
  app->add_option("-o,--output", o->profile_path, "write the profile (JSON)")->writes()->type_name("FILE");
  add_common_options(app, &o->common, kWithSeed);
}

} // namespace

int main(int argc, char** argv) {
  cli::App app("Temperature profiles: calibration error, bounds, optimisation.", "profile");
  app.require_subcommand(1);
  ErrorOptions error;
  BoundOptions bound;
  OptimizeOptions optimize;
  cli::App* error_app = app.add_subcommand("error", "calibration error over temperature that a profile or log leaves");
  cli::App* bound_app = app.add_subcommand("bound", "what no profile of a duration can beat");
  cli::App* optimize_app = app.add_subcommand("optimize", "the best profile under the limits of a chamber");
  add_error(error_app, &error);
  add_bound(bound_app, &bound);
  add_optimize(optimize_app, &optimize);
  return run_program(&app, argc, argv, [&] {
    if (error_app->parsed()) return run_error(error);
    if (bound_app->parsed()) return run_bound(bound);
    return run_optimize(optimize);
  });
}
