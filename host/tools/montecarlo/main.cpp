// SPDX-License-Identifier: MIT
// montecarlo: does the C core keep its promise?  Simulated calibration tests through sum -> kf -> table ->
// comp, scored against the truth.
#include <cstdio>

#include "analysis/montecarlo/campaign.h"
#include "analysis/montecarlo/compare.h"
#include "cli/program.h"
#include "cli/text.h"
#include "io/notice.h"
#include "montecarlo/report.h"

using namespace imucal;

namespace {

struct Options {
  CommonOptions common;
  std::string model_path, profile_path, filter_path, effects_path, partial_path;
  CampaignOptions campaign;
  bool core_only = false, strict = false;
  std::vector<std::string> merge_paths;
};

void add_raw_options(cli::App* app, RawFormat* raw) {
  const std::string group = "The simulated sensor";
  app->add_option("--rate-hz", raw->rate_hz, "raw samples per second")
      ->capture_default_str()
      ->check(FinitePositive)
      ->group(group);
  app->add_option("--counts-scale-dph", raw->counts_scale_dph, "one count of the gyro")
      ->capture_default_str()
      ->check(FinitePositive)
      ->group(group);
  app->add_option("--temp-lsb-degc", raw->temp_lsb_degc, "one count of the thermometer")
      ->capture_default_str()
      ->check(FinitePositive)
      ->group(group);
  app->add_option("--temp-noise-degc", raw->temp_noise_degc, "thermometer noise of a sample")
      ->check(cli::NonNegativeNumber)
      ->group(group);
  app->add_option("--jitter-s", raw->jitter_s, "standard deviation of the time stamps")
      ->check(cli::NonNegativeNumber)
      ->group(group);
  app->add_option("--missing-samples", raw->missing_frac, "part of the samples that never arrive")
      ->check(cli::Range(0.0, kMostMissing))
      ->group(group);
}

void add_options(cli::App* app, Options* o) {
  CampaignOptions& c = o->campaign;
  app->add_option("--model", o->model_path, "true error model with thermal polynomial and effects")
      ->type_name("MODEL.json");
  app->add_option("--profile", o->profile_path, "temperature profile of the test")->type_name("PROFILE.json");
  app->add_option("--order", c.order, "order of the polynomial the filter learns")->check(cli::Range(1, 5));
  app->add_option("--runs", c.runs, "simulated tests")->check(cli::Range(1, 100000000))->capture_default_str();
  app->add_option("--first-run", c.first_run, "number of the first run of this shard")->capture_default_str();
  app->add_option("--filter-model", o->filter_path, "error model the filter assumes (default: the true one)")
      ->type_name("MODEL.json");
  app->add_option("--effects", o->effects_path, "further effects on the sensor")->type_name("EFFECTS.json");
  app->add_option("--partial", o->partial_path, "write a partial result for `montecarlo merge`")
      ->writes()
      ->type_name("FILE");
  app->add_option("--points", c.points, "temperatures scored")
      ->check(cli::Range(2, static_cast<int>(kMostPoints)))
      ->capture_default_str();
  app->add_option("--missing-seconds", c.missing_frac, "part of the seconds that are missing altogether")
      ->check(cli::Range(0.0, kMostMissing));
  app->add_flag("--core-only", o->core_only, "the chain and its score only: no least squares, double reference, DP");
  app->add_option("--residual-every", c.residual_every, "DP curve of the residual in every n-th run (0: none)")
      ->capture_default_str();
  app->add_flag("--no-track", c.no_track, "take a coarse thermometer's reading as it is (common/track.h)");
  app->add_flag("--strict", o->strict, "exit with 1 where NEES or NIS are outside their intervals");
  add_raw_options(app, &c.raw);
  add_common_options(app, &o->common, kWithSeed | kWithThreads);
}

Exit publish(const Options& o, const CampaignPlan& plan, const CampaignResult& result) {
  const Json json = campaign_json(plan, result);
  const std::string text = campaign_text(json); // before a file that is there is given up for the result
  if (o.common.wants_json()) write_json(o.common.json_path, json);
  if (o.common.talks()) say(stdout, text);
  if (!o.strict || result.runs_done == 0) return Exit::kDone;
  const auto outside = [](const Json& x) {
    if (x.is_null()) return false;
    const double mean(x["mean"]), lo(x["ci95"][0]), hi(x["ci95"][1]);
    return mean < lo || mean > hi;
  };
  return outside(json["nees"]) || outside(json["nis"]) ? Exit::kNegative : Exit::kDone;
}

// The chain is simulated with a gyro's counts.
ErrorModel read_gyro_model(const std::string& path) {
  ErrorModel model = read_model(path);
  if (model.unit == "mg")
    throw data_error(path + ": an accelerometer's model (\"unit\": \"mg\"), but montecarlo simulates gyros in counts; "
                            "profile error predicts the calibration error of an accelerometer");
  return model;
}

Exit run_merge(const Options& o) {
  std::vector<Partial> partials;
  for (const std::string& path : o.merge_paths) partials.push_back(read_partial(path));
  const Partial whole = merge_partials(partials);
  return publish(o, plan_campaign(whole.options), whole.result);
}

Exit run_compare(Options o) {
  CampaignOptions& c = o.campaign;
  if (o.model_path.empty()) throw usage_error("compare: --model is required");
  c.model = c.filter = read_gyro_model(o.model_path);
  c.seed = o.common.seed;
  c.threads = o.common.thread_count();
  const auto scenarios = standard_scenarios();
  Progress bar("compare", static_cast<double>(scenarios.size()), o.common.quiet);
  std::vector<Comparison> all;
  for (const Scenario& scenario : scenarios) {
    bar.update(static_cast<double>(all.size()), scenario.name);
    Comparison one = compare_methods(c, scenario, interrupted);
    if (interrupted()) break;
    all.push_back(std::move(one));
  }
  bar.finish();
  const bool is_interrupted = all.size() < scenarios.size();
  if (all.empty()) throw Error(Exit::kInterrupted, "interrupted before the first profile was done; nothing is written");
  Json json = to_json(all, c);
  json["interrupted"] = is_interrupted;
  if (o.common.wants_json()) write_json(o.common.json_path, json);
  if (o.common.talks()) say(stdout, to_text(all, c));
  if (!is_interrupted) return Exit::kDone;
  notice("interrupted: " + std::to_string(all.size()) + " of " + std::to_string(scenarios.size()) +
         " profiles are done");
  return Exit::kInterrupted;
}

Exit run_campaign_command(Options o) {
  CampaignOptions& c = o.campaign;
  if (o.model_path.empty() || o.profile_path.empty())
    throw usage_error("--model and --profile are required (try montecarlo --help)");
  c.model = read_gyro_model(o.model_path);
  c.filter = o.filter_path.empty() ? c.model : read_gyro_model(o.filter_path);
  if (!o.effects_path.empty()) c.effects = read_effects(o.effects_path);
  c.profile = read_profile(o.profile_path);
  c.seed = o.common.seed;
  c.threads = o.common.thread_count();
  if (o.core_only) c.least_squares_every = c.reference_every = c.residual_every = 0;
  const CampaignPlan plan = plan_campaign(c);
  Progress bar("montecarlo", static_cast<double>(c.runs), o.common.quiet);
  const auto progress = [&](const CampaignResult& so_far) {
    char note[80] = "";
    if (const auto n = so_far.tally.counted("nees_runs"); n > 0)
      std::snprintf(note, sizeof note, "%llu of %llu runs, NEES %.3f of %d",
                    static_cast<unsigned long long>(so_far.runs_done), static_cast<unsigned long long>(c.runs),
                    so_far.tally.sum("nees") / static_cast<double>(n), c.order + 1);
    bar.update(static_cast<double>(so_far.runs_done), note);
  };
  const CampaignResult result = run_campaign(plan, progress, interrupted);
  bar.finish();
  if (!o.partial_path.empty()) write_partial(o.partial_path, c, result);
  const Exit exit = publish(o, plan, result);
  return result.is_interrupted ? Exit::kInterrupted : exit;
}

} // namespace

int main(int argc, char** argv) {
  cli::App app("simulated calibration tests through the C core, scored against the truth", "montecarlo");
  Options run, merged;
  run.campaign.raw.rate_hz = 10; // before add_options, which shows them in --help
  run.campaign.raw.counts_scale_dph = 1;
  add_options(&app, &run);
  cli::App* merge = app.add_subcommand("merge", "merge partial results of shards into the result of the whole");
  merge->add_option("FILES", merged.merge_paths, "partial results")->required();
  merge->add_flag("--strict", merged.strict, "exit with 1 where NEES or NIS are outside their intervals");
  add_common_options(merge, &merged.common);
  Options compared;
  compared.campaign.raw = run.campaign.raw;
  compared.campaign.runs = 500;
  cli::App* compare = app.add_subcommand("compare", "the core's filter against other methods on several profiles");
  compare->add_option("--model", compared.model_path, "true error model with thermal polynomial")->required();
  compare->add_option("--order", compared.campaign.order, "order of the polynomial")->check(cli::Range(1, 5));
  compare->add_option("--runs", compared.campaign.runs, "simulated tests per profile")->check(cli::Range(1, 1000000));
  add_common_options(compare, &compared.common, kWithSeed | kWithThreads);
  return run_program(&app, argc, argv, [&] {
    if (merge->parsed()) return run_merge(merged);
    return compare->parsed() ? run_compare(compared) : run_campaign_command(run);
  });
}
