// SPDX-License-Identifier: MIT
#include "analysis/errormodel/sanity.h"

#include <algorithm>
#include <cmath>

#include "analysis/errormodel/confidence.h"
#include "base/error.h"
#include "base/format.h"
#include "base/repeats.h"
#include "base/temperature_step.h"
#include "health.h"

namespace imucal {

namespace {

constexpr double kMostRepeated = IMUCAL_HEALTH_MOST_REPEATED;
constexpr double kMostVariance = IMUCAL_HEALTH_MOST_NIS;
constexpr double kZ = IMUCAL_HEALTH_Z; // standard deviations beyond the tolerance

void add_repeated(const Series& s, Sanity* out) {
  long run = 0, longest = 0, end = 0;
  for (long k = 0; k < s.size(); ++k) {
    const auto i = static_cast<size_t>(k);
    run = k > 0 && s.rate_dph[i] == s.rate_dph[i - 1] ? run + 1 : 1;
    if (run > longest) longest = run, end = k;
  }
  if (static_cast<double>(longest) <= kMostRepeated) {
    if (const double share = repeated_share(s.rate_dph); share > kMostRepeatedShare)
      out->reasons.push_back({s.log, s.axis, "repeated", share, kMostRepeatedShare, repeated_text(share, s.dt_s)});
    return;
  }
  out->reasons.push_back({s.log, s.axis, "repeated", static_cast<double>(longest), kMostRepeated,
                          format("%.0f rows in a row, from %.10g s on, have the same value: the output is frozen, or "
                                 "far coarser than its noise",
                                 static_cast<double>(longest), s.t_s(end - longest + 1))});
}

std::string what_stands_out(const DpRatios& ratios) {
  if (ratios.outliers.empty()) return "the noise level changes along the record: cut it there";
  return format("%.0f event(s), the largest at t = %.0f s, %.1f sigma: look there",
                static_cast<double>(ratios.n_events), ratios.outliers[0].t_s, ratios.outliers[0].sigmas);
}

// Curve and ratios of the Allan deviation at a few taus from one row on; short records have no verdict.
void add_outliers(const Series& s, Sanity* out) {
  const DpOperator op = make_dp_operator(DpType::kAv, s.dt_s, {});
  std::vector<double> tau_s;
  for (const long n : {1L, 4L, 16L, 64L})
    if (20 * n <= s.size()) tau_s.push_back(static_cast<double>(n) * s.dt_s);
  if (tau_s.empty()) return;
  const DpRecord record(s, op);
  DpCurve curve;
  try {
    curve = dp_curve(s, record, tau_s, DpEstimator::kRms);
  } catch (const Error&) { // constant, or no window is whole: told elsewhere
    return;
  }
  std::vector<double> dof;
  for (size_t i = 0; i < tau_s.size(); ++i)
    dof.push_back(model_dof({white_component(1)}, op, std::lround(tau_s[i] / s.dt_s), curve.n[i]));
  out->ratios = dp_ratios(s, s.temp_degc, record, curve, dof);
  for (size_t i = 0; i < tau_s.size(); ++i) {
    if (dof[i] < kLeastDof) continue;
    const double variance = std::pow(kPercentileRatio / out->ratios.p95_over_rms[i], 2);
    const double limit = kMostVariance * (1 + kZ * 2 * kPercentileSpread / std::sqrt(dof[i]));
    if (variance <= limit) continue;
    out->reasons.push_back({s.log, s.axis, "outliers", variance, limit,
                            format("over %g s the mean square is %.3g times that of all but the largest values (limit "
                                   "%.3g): ",
                                   tau_s[i], variance, limit) +
                                what_stands_out(out->ratios)});
    return;
  }
}

// A rule of the core on the temperatures.
void add_temperature_rules(const Series& s, Sanity* out) {
  if (s.temp_degc.empty()) return;
  imucal_health_config_t config{};
  config.temp_step_degc = static_cast<float>(expected_temperature_step(smallest_temperature_step(s.temp_degc), s.dt_s));
  imucal_health_t health;
  if (imucal_health_init(&health, &config) != IMUCAL_OK) return;
  uint32_t gap_s = 0;
  for (size_t k = 0; k < s.rate_dph.size(); ++k) {
    if (std::isnan(s.temp_degc[k])) {
      ++gap_s;
      continue;
    }
    imucal_health_second(&health, static_cast<float>(s.rate_dph[k]), static_cast<float>(s.temp_degc[k]), 0,
                         std::isfinite(s.rate_dph[k]), gap_s);
    gap_s = 0;
  }
  imucal_health_verdict_t verdict;
  imucal_health_judge(&health, &verdict);
  for (const uint32_t rule : {IMUCAL_HEALTH_TEMP_JUMP, IMUCAL_HEALTH_TEMP_SPIKES}) {
    if (!(verdict.bits >> rule & 1U)) continue;
    const auto value = static_cast<double>(verdict.value[rule]);
    out->reasons.push_back(
        {s.log, s.axis, imucal_health_rule_name(rule), value, static_cast<double>(verdict.limit[rule]),
         rule == IMUCAL_HEALTH_TEMP_JUMP
             ? format("the temperature jumps to another level %.0f times: no sensor does that", value)
             : format("%.3g %% of the temperatures are out of reach of their neighbours: is the column a temperature, "
                      "the thermometer's line good?",
                      100 * value)});
  }
}

} // namespace

std::vector<std::string> sanity_rules() {
  return {"repeated", "outliers", imucal_health_rule_name(IMUCAL_HEALTH_TEMP_JUMP),
          imucal_health_rule_name(IMUCAL_HEALTH_TEMP_SPIKES)};
}

Sanity sanity_of(const Series& raw, const Series& detrended) {
  Sanity out;
  add_repeated(raw, &out);
  add_outliers(detrended, &out);
  add_temperature_rules(raw, &out);
  if (out.reasons.empty() && !out.ratios.outliers.empty()) out.note = what_stands_out(out.ratios);
  return out;
}

} // namespace imucal
