// SPDX-License-Identifier: MIT
// Shards: partial results of a campaign as JSON, and their merging.
#include <algorithm>
#include <cstdio>

#include "analysis/montecarlo/campaign.h"
#include "analysis/montecarlo/whiteness.h"
#include "base/error.h"
#include "io/notice.h"

namespace imucal {

static Json to_json(const RawFormat& raw) {
  return {{"rate_hz", raw.rate_hz},
          {"counts_scale_dph", raw.counts_scale_dph},
          {"max_counts", raw.max_counts},
          {"temp_lsb_degc", raw.temp_lsb_degc},
          {"temp_offset_degc", raw.temp_offset_degc},
          {"temp_noise_degc", raw.temp_noise_degc},
          {"jitter_s", raw.jitter_s},
          {"missing_frac", raw.missing_frac}};
}

static RawFormat raw_from_json(const JsonField& field) {
  RawFormat raw;
  constexpr double kLeast = 1e-12, kMost = 1e12;
  raw.rate_hz = field.at("rate_hz").number(kLeast, kMost);
  raw.counts_scale_dph = field.at("counts_scale_dph").number(kLeast, kMost);
  raw.max_counts = static_cast<int32_t>(field.at("max_counts").integer(1, 0x7fffffff));
  raw.temp_lsb_degc = field.at("temp_lsb_degc").number(kLeast, kMost);
  raw.temp_offset_degc = field.at("temp_offset_degc").number(-kMost, kMost);
  raw.temp_noise_degc = field.at("temp_noise_degc").number(0, kMost);
  raw.jitter_s = field.at("jitter_s").number(0, kMost);
  raw.missing_frac = field.at("missing_frac").number(0, kMostMissing);
  return raw;
}

Json campaign_identity(const CampaignOptions& o) {
  ErrorModel with_effects = o.model;
  with_effects.effects.insert(with_effects.effects.end(), o.effects.begin(), o.effects.end());
  return {{"seed", o.seed},
          {"model", to_json(with_effects)},
          {"filter_model", to_json(o.filter)},
          {"profile", to_json(o.profile)},
          {"order", o.order},
          {"points", o.points},
          {"prior_sigma_dph", o.prior_sigma_dph},
          {"missing_seconds_frac", o.missing_frac},
          {"raw", to_json(o.raw)},
          {"no_track", o.no_track},
          {"least_squares_every", o.least_squares_every},
          {"reference_every", o.reference_every},
          {"residual_every", o.residual_every}};
}

CampaignOptions options_from_identity(const JsonField& identity) {
  const auto whole = [&](const char* name) {
    return static_cast<uint64_t>(identity.at(name).integer(0, INT64_C(1) << 53));
  };
  CampaignOptions o;
  o.seed = whole("seed");
  o.model = model_from_json(identity.at("model"));
  o.filter = model_from_json(identity.at("filter_model"));
  o.profile = profile_from_json(identity.at("profile"));
  o.order = static_cast<int>(identity.at("order").integer(1, IMUCAL_MAX_ORDER));
  o.points = static_cast<size_t>(identity.at("points").integer(2, kMostPoints));
  o.prior_sigma_dph = identity.at("prior_sigma_dph").number(0);
  o.missing_frac = identity.at("missing_seconds_frac").number(0, kMostMissing);
  o.raw = raw_from_json(identity.at("raw"));
  o.no_track = identity.at("no_track").json() == true;
  o.least_squares_every = whole("least_squares_every");
  o.reference_every = whole("reference_every");
  o.residual_every = whole("residual_every");
  return o;
}

void write_partial(const std::string& path, const CampaignOptions& options, const CampaignResult& result) {
  write_json(path, {{"imucal_montecarlo_partial", 1},
                    {"campaign", campaign_identity(options)},
                    {"ranges", Json::array({Json::array({result.first_run, result.first_run + result.runs_done})})},
                    {"interrupted", result.is_interrupted},
                    {"runs", options.runs},
                    {"elapsed_s", result.elapsed_s},
                    {"cpu_s", result.cpu_s},
                    {"tally", result.tally.to_json()}});
}

namespace {

// A list of the tally as score.cpp and residual.cpp fill it; a damaged file must not be summed, nor read beyond its end.
struct ListRule {
  enum Length { kOne, kPoints, kLags, kWindows };
  const char* kind;
  const char* name;
  Length length;
  const char* counter; // there where this count is above 0
  bool is_of_squares;  // or of sizes: none below 0
};
constexpr ListRule kLists[] = {{"counts", "seconds", ListRule::kOne, "runs", true},
                               {"counts", "missed", ListRule::kOne, "runs", true},
                               {"counts", "refused", ListRule::kOne, "runs", true},
                               {"counts", "dropped", ListRule::kOne, "runs", true},
                               {"counts", "within1", ListRule::kPoints, "runs", true},
                               {"counts", "within2", ListRule::kPoints, "runs", true},
                               {"counts", "lags", ListRule::kLags, "runs", true},
                               {"counts", "residual_tests", ListRule::kWindows, "residual_runs", true},
                               {"sums", "error", ListRule::kPoints, "runs", false},
                               {"sums", "error2", ListRule::kPoints, "runs", true},
                               {"sums", "variance", ListRule::kPoints, "runs", true},
                               {"sums", "worst_error", ListRule::kOne, "runs", true},
                               {"sums", "nis", ListRule::kOne, "runs", true},
                               {"sums", "mean_innovation2", ListRule::kOne, "runs", true},
                               {"sums", "lags", ListRule::kLags, "runs", false},
                               {"sums", "nees", ListRule::kOne, "nees_runs", true},
                               {"sums", "ls_error2", ListRule::kPoints, "ls_runs", true},
                               {"sums", "ls_difference2", ListRule::kPoints, "ls_runs", true},
                               {"sums", "ls_largest_difference", ListRule::kOne, "ls_runs", true},
                               {"sums", "residual_d2", ListRule::kWindows, "residual_runs", true},
                               {"sums", "residual_d4", ListRule::kWindows, "residual_runs", true},
                               {"sums", "residual_extra", ListRule::kWindows, "residual_runs", false},
                               {"maxima", "comp_lsb", ListRule::kOne, "runs", true},
                               {"maxima", "ls_largest_difference", ListRule::kOne, "ls_runs", true},
                               {"maxima", "reference_bias_dph", ListRule::kOne, "reference_runs", true},
                               {"maxima", "reference_sigma_rel", ListRule::kOne, "reference_runs", true}};

size_t length_of(const ListRule& rule, const CampaignOptions& options) {
  switch (rule.length) {
  case ListRule::kPoints:
    return options.points;
  case ListRule::kLags:
    return kInnovationLagCount;
  case ListRule::kWindows:
    return residual_windows(options).size();
  default:
    return 1;
  }
}

std::vector<double> values_of(const ListRule& rule, const Tally& tally) {
  if (rule.kind == std::string("sums")) return tally.sums(rule.name);
  if (rule.kind == std::string("maxima")) return tally.maxima(rule.name);
  const std::vector<int64_t> counts = tally.counts(rule.name);
  return {counts.begin(), counts.end()};
}

void require_lists(const JsonField& field, const CampaignOptions& options, const Tally& tally) {
  for (const ListRule& rule : kLists) {
    const JsonField kind = field.at(rule.kind);
    if (tally.counted(rule.counter) == 0) {
      if (kind.find(rule.name))
        kind.at(rule.name).refuse("is there, but no run that counts as " + std::string(rule.counter));
      continue;
    }
    const JsonField list = kind.at(rule.name);
    const std::vector<double> values = values_of(rule, tally);
    if (const size_t n = length_of(rule, options); values.size() != n)
      list.refuse("expected " + std::to_string(n) + " numbers, found " + std::to_string(values.size()));
    for (const double value : values)
      if (rule.is_of_squares && value < 0) list.refuse("is negative, and cannot be");
  }
  const int64_t runs = tally.counted("runs");
  for (const char* part :
       {"nees_runs", "ls_runs", "reference_runs", "residual_runs", "within1", "within2", "residual_tests"})
    for (const int64_t n : tally.counts(part))
      if (n > runs) field.at("counts").at(part).refuse("counts more than there are runs");
  if (runs > 0 && tally.counted("seconds") <= runs * (options.order + 1))
    field.at("counts").at("seconds").refuse("too few for so many runs");
}

// The runs of a shard: [first, end].
void read_range(const JsonField& field, CampaignResult* result) {
  const auto ranges = field.elements();
  if (ranges.size() != 1) field.refuse("expected one range of runs");
  const auto ends = ranges[0].elements();
  if (ends.size() != 2) ranges[0].refuse("expected [first, end]");
  const int64_t first = ends[0].integer(0, INT64_C(1) << 53), end = ends[1].integer(first, INT64_C(1) << 53);
  result->first_run = static_cast<uint64_t>(first);
  result->runs_done = static_cast<uint64_t>(end - first);
}

// A gap in the runs is told: what is merged is not the whole that was asked for.
void tell_missing(const std::vector<const Partial*>& in_order) {
  for (const Partial* partial : in_order)
    if (partial->result.is_interrupted)
      notice(partial->path + ": was interrupted after " + std::to_string(partial->result.runs_done) + " of " +
             std::to_string(partial->options.runs) + " runs; the others are missing");
  for (size_t i = 1; i < in_order.size(); ++i) {
    const CampaignResult &before = in_order[i - 1]->result, &next = in_order[i]->result;
    const uint64_t end = before.first_run + before.runs_done;
    if (next.first_run > end && !before.is_interrupted)
      notice("runs " + std::to_string(end) + " to " + std::to_string(next.first_run - 1) + " are missing between " +
             in_order[i - 1]->path + " and " + in_order[i]->path);
  }
}

} // namespace

Partial read_partial(const std::string& path) {
  const JsonField file = read_json(path);
  if (!file.find("imucal_montecarlo_partial"))
    file.refuse("is not a partial result; write one with montecarlo … --partial FILE");
  if (file.at("imucal_montecarlo_partial").integer(0, 1000000) != 1)
    file.at("imucal_montecarlo_partial").refuse("version not known to this program (it knows 1)");
  Partial out;
  out.path = path;
  out.identity = file.at("campaign").json();
  out.options = options_from_identity(file.at("campaign"));
  read_range(file.at("ranges"), &out.result);
  if (const auto interrupted = file.find("interrupted")) out.result.is_interrupted = interrupted->json() == true;
  if (const auto runs = file.find("runs")) out.options.runs = static_cast<uint64_t>(runs->integer(1, INT64_C(1) << 53));
  out.result.elapsed_s = file.at("elapsed_s").number(0);
  out.result.cpu_s = file.at("cpu_s").number(0);
  out.result.tally = Tally::from_json(file.at("tally"));
  if (static_cast<uint64_t>(out.result.tally.counted("runs")) != out.result.runs_done)
    file.at("tally").refuse("its number of runs is not that of the range");
  require_lists(file.at("tally"), out.options, out.result.tally);
  return out;
}

Partial merge_partials(const std::vector<Partial>& partials) {
  if (partials.empty()) throw usage_error("nothing to merge");
  std::vector<const Partial*> in_order;
  for (const Partial& p : partials) in_order.push_back(&p);
  std::sort(in_order.begin(), in_order.end(),
            [](const Partial* a, const Partial* b) { return a->result.first_run < b->result.first_run; });
  Partial out = *in_order.front();
  for (size_t i = 1; i < in_order.size(); ++i) {
    const Partial &next = *in_order[i], &before = *in_order[i - 1];
    if (next.identity != out.identity)
      throw data_error(next.path + ": is of another campaign than " + out.path +
                       " (seed, model, profile, order and formats must be the same)");
    if (next.result.first_run < before.result.first_run + before.result.runs_done)
      throw data_error(next.path + ": holds runs that " + before.path + " holds too (from run " +
                       std::to_string(next.result.first_run) + "); give each shard another --first-run");
    out.result.tally.merge(next.result.tally);
    out.result.runs_done += next.result.runs_done;
    out.result.is_interrupted = out.result.is_interrupted || next.result.is_interrupted;
    out.result.elapsed_s = std::max(out.result.elapsed_s, next.result.elapsed_s);
    out.result.cpu_s += next.result.cpu_s;
  }
  tell_missing(in_order);
  return out;
}

} // namespace imucal
