// SPDX-License-Identifier: MIT
#include "analysis/montecarlo/compare.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "analysis/montecarlo/reference.h"
#include "base/units.h"

namespace imucal {

namespace {

Profile ramps(double start_degc, std::vector<ProfileSegment> segments) {
  Profile profile;
  profile.start_degc = start_degc;
  profile.segments = std::move(segments);
  return profile;
}

// Taken out of a freezer: T = 25 - 43 exp(-t/tau), in ramps between points of time.
Profile freezer_warm_up() {
  Profile profile = ramps(-18, {});
  const double tau_s = 1800, step_s = 300;
  double last_degc = -18;
  for (double t_s = step_s; t_s <= 8400; t_s += step_s) {
    const double next_degc = 25 - 43 * std::exp(-t_s / tau_s);
    profile.segments.push_back({(next_degc - last_degc) / (step_s / kSecondsPerMinute), 0, next_degc});
    last_degc = next_degc;
  }
  return profile;
}

constexpr Method kMethods[] = {Method::kKalman, Method::kLeastSquares, Method::kRisingBins, Method::kRisingMaximum};

void score_method(const CampaignPlan& plan, const std::vector<double>& coeff, const std::vector<double>& truth,
                  Method method, Tally* tally) {
  const std::string name = to_text(method);
  tally->count(name + " runs");
  if (coeff.empty()) return;
  std::vector<double> error2;
  double mean = 0;
  for (const double temp_degc : plan.temp_degc) {
    const double tn = (temp_degc - plan.chain.t0_degc) / plan.chain.range_degc;
    const double error = bias_dph(coeff, tn) - bias_dph(truth, tn);
    error2.push_back(error * error);
    mean += error * error / static_cast<double>(plan.temp_degc.size());
  }
  tally->count(name + " fitted");
  tally->add(name + " error2", error2);
  tally->add(name + " mean4", mean * mean);
}

// One test, all methods.  `reading`: the chain without temperature tracking, whose seconds the others see.
void score_all(const CampaignPlan& plan, const CampaignPlan& reading, uint64_t run, Tally* tally) {
  const CalibrationTest test = calibrate_run(plan, run);
  score_method(plan, test.chain.coefficients(), test.truth, Method::kKalman, tally);
  const CalibrationTest plain = plan.chain.is_tracked ? calibrate_run(reading, run) : test;
  std::vector<FitPoint> seconds;
  for (const SecondMean& s : plain.chain.seconds())
    seconds.push_back({static_cast<double>(s.temp_degc), static_cast<double>(s.z_dph)});
  for (const Method method : kMethods)
    if (method != Method::kKalman)
      score_method(
          plan,
          fit_polynomial(points_of(method, seconds), plan.options.order, plan.chain.t0_degc, plan.chain.range_degc),
          test.truth, method, tally);
}

MethodScore summary(const Tally& tally, Method method, bool is_tracked) {
  const std::string name = to_text(method);
  const auto n = static_cast<double>(tally.counted(name + " fitted"));
  MethodScore score;
  score.method = method;
  score.thermometer_use = method == Method::kKalman && is_tracked ? "tracked" : "reading";
  score.part_fitted = n / std::max(1.0, static_cast<double>(tally.counted(name + " runs")));
  if (n == 0) return score;
  double mean2 = 0;
  const auto error2 = tally.sums(name + " error2");
  for (const double e : error2) {
    score.sigma_dph.push_back(std::sqrt(e / n));
    score.worst_dph = std::max(score.worst_dph, score.sigma_dph.back());
    mean2 += e / n / static_cast<double>(error2.size());
  }
  score.rms_dph = std::sqrt(mean2);
  const double variance = std::max(0.0, tally.sum(name + " mean4") / n - mean2 * mean2);
  score.rms_std_error_dph = std::sqrt(variance / n) / (2 * score.rms_dph);
  return score;
}

} // namespace

std::vector<Scenario> standard_scenarios() {
  const std::vector<std::pair<std::string, Profile>> profiles = {
      {"ramp", ramps(0, {{0.6, 0, 60}})},
      {"ramp and 20-min soaks", ramps(0, {{0, 1200, 0}, {0.6, 0, 60}, {0, 1200, 0}})},
      {"freezer warm-up", freezer_warm_up()},
      {"up and down", ramps(0, {{60.0 / 70, 0, 60}, {60.0 / 70, 0, 0}})}};
  std::vector<Scenario> all;
  for (const auto& [name, profile] : profiles) {
    all.push_back({name, profile, 0.01, 0.02});
    all.push_back({name + ", 1 degC thermometer", profile, 1.0, 0.02});
  }
  return all;
}

Comparison compare_methods(const CampaignOptions& base, const Scenario& scenario, const std::function<bool()>& stop) {
  CampaignOptions options = base;
  options.profile = scenario.profile;
  options.raw.temp_lsb_degc = scenario.temp_lsb_degc;
  options.raw.temp_noise_degc = scenario.temp_noise_degc;
  options.residual_every = 0;
  const CampaignPlan plan = plan_campaign(options);
  CampaignPlan reading = plan;
  reading.chain.is_tracked = false;
  const CampaignResult result = run_campaign(
      plan, [&](const CampaignPlan& p, uint64_t run, Tally* tally) { score_all(p, reading, run, tally); }, nullptr,
      stop);
  Comparison out;
  out.scenario = scenario;
  out.duration_s = plan.t_s.size();
  out.temp_degc = plan.temp_degc;
  for (const Method method : kMethods) out.methods.push_back(summary(result.tally, method, plan.chain.is_tracked));
  return out;
}

Json to_json(const std::vector<Comparison>& all, const CampaignOptions& base) {
  Json json = {{"runs", base.runs}, {"seed", base.seed}, {"order", base.order}, {"scenarios", Json::array()}};
  for (const Comparison& c : all) {
    Json methods = Json::array();
    for (const MethodScore& m : c.methods)
      methods.push_back({{"method", to_text(m.method)},
                         {"thermometer", m.thermometer_use},
                         {"worst_dph", m.worst_dph},
                         {"rms_dph", m.rms_dph},
                         {"rms_std_error_dph", m.rms_std_error_dph},
                         {"part_fitted", m.part_fitted},
                         {"sigma_dph", m.sigma_dph}});
    json["scenarios"].push_back({{"scenario", c.scenario.name},
                                 {"profile", to_json(c.scenario.profile)},
                                 {"temp_lsb_degc", c.scenario.temp_lsb_degc},
                                 {"temp_noise_degc", c.scenario.temp_noise_degc},
                                 {"duration_s", c.duration_s},
                                 {"temp_degc", c.temp_degc},
                                 {"methods", methods}});
  }
  return json;
}

std::string to_text(const std::vector<Comparison>& all, const CampaignOptions& base) {
  char line[300];
  std::snprintf(line, sizeof line,
                "calibration error, dph: worst over temperature / rms (order %d, %llu tests each, seed %llu)\n",
                base.order, static_cast<unsigned long long>(base.runs), static_cast<unsigned long long>(base.seed));
  std::string out = line;
  size_t widest = 0;
  for (const Comparison& c : all) widest = std::max(widest, c.scenario.name.size());
  const int width = static_cast<int>(widest);
  std::snprintf(line, sizeof line, "%-*s", width + 8, "");
  out += line;
  for (const Method method : kMethods) {
    std::snprintf(line, sizeof line, "%18s", to_text(method).c_str());
    out += line;
  }
  out += "\n";
  for (const Comparison& c : all) {
    std::snprintf(line, sizeof line, "%-*s %3zu min", width, c.scenario.name.c_str(), c.duration_s / 60);
    out += line;
    for (const MethodScore& m : c.methods) {
      if (m.sigma_dph.empty())
        std::snprintf(line, sizeof line, "%18s", "no fit");
      else
        std::snprintf(line, sizeof line, "%9.2f /%7.2f", m.worst_dph, m.rms_dph);
      out += line;
    }
    out += "\n";
  }
  return out;
}

} // namespace imucal
