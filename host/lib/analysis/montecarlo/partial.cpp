// SPDX-License-Identifier: MIT
// Shards: partial results of a campaign as JSON, and their merging.
#include <algorithm>
#include <cstdio>

#include "analysis/montecarlo/campaign.h"
#include "base/error.h"

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
  raw.rate_hz = field.at("rate_hz").number();
  raw.counts_scale_dph = field.at("counts_scale_dph").number();
  raw.max_counts = static_cast<int32_t>(field.at("max_counts").integer(1, 0x7fffffff));
  raw.temp_lsb_degc = field.at("temp_lsb_degc").number();
  raw.temp_offset_degc = field.at("temp_offset_degc").number();
  raw.temp_noise_degc = field.at("temp_noise_degc").number();
  raw.jitter_s = field.at("jitter_s").number();
  raw.missing_frac = field.at("missing_frac").number();
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
  o.order = static_cast<int>(whole("order"));
  o.points = static_cast<size_t>(whole("points"));
  o.prior_sigma_dph = identity.at("prior_sigma_dph").number();
  o.missing_frac = identity.at("missing_seconds_frac").number();
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
                    {"elapsed_s", result.elapsed_s},
                    {"cpu_s", result.cpu_s},
                    {"tally", result.tally.to_json()}});
}

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
  const auto ranges = file.at("ranges").elements();
  if (ranges.size() != 1) file.at("ranges").refuse("expected one range of runs");
  const auto ends = ranges[0].numbers();
  if (ends.size() != 2 || ends[1] < ends[0]) ranges[0].refuse("expected [first, end]");
  out.result.first_run = static_cast<uint64_t>(ends[0]);
  out.result.runs_done = static_cast<uint64_t>(ends[1] - ends[0]);
  out.result.elapsed_s = file.at("elapsed_s").number();
  out.result.cpu_s = file.at("cpu_s").number();
  out.result.tally = Tally::from_json(file.at("tally"));
  if (static_cast<uint64_t>(out.result.tally.counted("runs")) != out.result.runs_done)
    file.at("tally").refuse("its number of runs is not that of the range");
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
    out.result.elapsed_s = std::max(out.result.elapsed_s, next.result.elapsed_s);
    out.result.cpu_s += next.result.cpu_s;
  }
  return out;
}

} // namespace imucal
