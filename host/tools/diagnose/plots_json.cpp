// SPDX-License-Identifier: MIT
#include "diagnose/plots_json.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/logs/blocks.h"
#include "diagnose/gap_words.h"
#include "diagnose/json_parts.h"

namespace imucal {
namespace {

const char* rest_name(Rest test) {
  static const char* const names[] = {
      "spectrum",      "variance_over_temperature", "variance_over_time", "distribution", "bursts", "line",
      "sudden_changes"};
  return names[static_cast<size_t>(test)];
}

Json cell_json(const WhereCell& c) {
  Json out = {{"excess", c.excess}, {"n", c.n}, {"z", c.z()}, {"noise_floor", std::sqrt(2 * c.n)}};
  if (c.mean_z != 0) out["mean_z"] = c.mean_z;
  return out;
}

Json cells_json(const std::vector<WhereCell>& cells, const char* range, const char* name, bool is_log) {
  const bool has_shares = std::any_of(cells.begin(), cells.end(), [](const WhereCell& c) { return c.share > 0; });
  Json list = Json::array();
  for (const WhereCell& c : cells) {
    Json cell = range ? Json{{range, {c.lo, c.hi}}} : is_log ? Json{{name, std::stoi(c.name)}} : Json{{name, c.name}};
    cell.update(cell_json(c));
    if (has_shares) cell["share"] = c.share;
    list.push_back(cell);
  }
  return list;
}

Json findings_json(const Selection& s) {
  Json findings = Json::array();
  for (const RestFinding& f : s.before) {
    if (f.evidence_nats <= 0) continue;
    bool remains = false;
    for (const RestFinding& a : s.after) remains = remains || (a.test == f.test && a.evidence_nats > 0);
    findings.push_back({{"probe", rest_name(f.test)},
                        {"evidence_nats", f.evidence_nats},
                        {"p_value", f.p_value()},
                        {"statement", rest_text(f.test)},
                        {"remains_after", remains}});
  }
  return findings;
}

} // namespace

Json where_json(const AxisResult& axis) {
  const WhereResult& w = axis.where;
  return {{"tau_s", {w.tau_lo_s, w.tau_hi_s}},
          {"temp_degc", {w.temp_lo_degc, w.temp_hi_degc}},
          {"time_s", {w.time_lo_s, w.time_hi_s}},
          {"direction", w.direction},
          {"logs", w.logs},
          {"sentence", w.sentence},
          {"findings", findings_json(axis.study.selection)},
          {"by_tau", cells_json(w.by_tau, "tau_s", nullptr, false)},
          {"by_temperature", cells_json(w.by_temperature, "temp_degc", nullptr, false)},
          {"by_phase", cells_json(w.by_phase, nullptr, "phase", false)},
          {"by_log", cells_json(w.by_log, nullptr, "log", true)}};
}

namespace {

// Used rows [first, end) of a run that one mean is of.
struct MeanRows {
  long first, end;
};
// `block` rows each.  None goes over a hole as long as itself: it would be of no time and of no temperature.  Before a hole one
// of half as many rows is kept.
std::vector<MeanRows> rows_of_means(const CampaignRun& run, long n, long block) {
  std::vector<MeanRows> out;
  long first = 0;
  for (long k = 1; k <= n; ++k) {
    const bool is_hole = k < n && run.steps[static_cast<size_t>(k)] > block;
    if (k - first == block || (is_hole && 2 * (k - first) >= block)) out.push_back({first, k});
    if (k - first == block || is_hole) first = k;
  }
  return out;
}

// One-minute means: what was measured, what the polynomial and the whole answer make of it, and what is left.
// Means of what is left, without hits: one of a million dph is no part of what a minute was.
Json residual_json(const Campaign& campaign, const Fit& before, const Fit& after) {
  Json temp = Json::array(), rate = Json::array(), time = Json::array(), log = Json::array(), raw = Json::array(),
       b = Json::array(), a = Json::array(), fitted_b = Json::array(), fitted_a = Json::array();
  const long block = std::max(rows_of_minute(campaign.dt_s), static_cast<long>(campaign.n() / 1500));
  const std::vector<Eigen::VectorXd> hits = hits_of(campaign);
  long n_hits = 0;
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    n_hits += (hits[r].array() != 0).count();
    for (const auto& [k, end] : rows_of_means(run, before.residual[r].size(), block)) {
      const long n = end - k;
      const Eigen::ArrayXd counts = (hits[r].segment(k, n).array() == 0).cast<double>();
      const auto mean_of = [&](const auto& x) { return (x.array() * counts).sum() / std::max(1.0, counts.sum()); };
      Eigen::VectorXd rates(n);
      for (long i = 0; i < n; ++i)
        rates[i] = run.input.rate_dph[static_cast<size_t>(run.used[static_cast<size_t>(k + i)])];
      const double mean = mean_of(rates), left_b = mean_of(before.residual[r].segment(k, n)),
                   left_a = mean_of(after.residual[r].segment(k, n));
      const size_t row = static_cast<size_t>(run.used[static_cast<size_t>(k + n / 2)]);
      temp.push_back(campaign.has_temperature ? Json(run.input.smooth_degc[row]) : Json(nullptr));
      rate.push_back(run.input.rate_degc_min[row]);
      time.push_back(time_in_log_s(run, run.input.t_s[row]));
      log.push_back(run.input.log);
      raw.push_back(mean), b.push_back(left_b), a.push_back(left_a);
      fitted_b.push_back(mean - left_b), fitted_a.push_back(mean - left_a);
    }
  }
  return {{"mean_s", static_cast<double>(block) * campaign.dt_s},
          {"n_hits", n_hits},
          {"temp_degc", temp},
          {"rate_degc_per_min", rate},
          {"t_s", time},
          {"log", log},
          {"rate_dph", raw},
          {"polynomial_dph", fitted_b},
          {"answer_dph", fitted_a},
          {"before_dph", b},
          {"after_dph", a}};
}

// Energy of the slow innovations over averaging time and temperature: z of every cell.
Json map_json(const Campaign& campaign, const Fit& fit) {
  constexpr size_t kTemps = 12;
  const double lo = campaign.lo_degc, span = std::max(1e-9, campaign.hi_degc - lo);
  std::vector<std::vector<double>> sum, n;
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    std::vector<double> level(fit.e[r].data(), fit.e[r].data() + fit.e[r].size());
    for (size_t band = 0; level.size() >= 2; ++band) {
      if (sum.size() <= band) sum.push_back(std::vector<double>(kTemps, 0.0)), n.push_back(sum.back());
      std::vector<double> next;
      const double scale = std::ldexp(1.0, static_cast<int>(band));
      for (size_t i = 0; i + 1 < level.size(); i += 2) {
        const double w = (level[i] - level[i + 1]) * 0.7071067811865476;
        const size_t k = std::min(run.n() - 1, static_cast<size_t>((static_cast<double>(i) + 1) * scale));
        const double temp = run.input.smooth_degc[static_cast<size_t>(run.used[k])];
        const size_t b = std::min(kTemps - 1, static_cast<size_t>(std::max(0.0, (temp - lo) / span * kTemps)));
        sum[band][b] += w * w - 1, n[band][b] += 1;
        next.push_back((level[i] + level[i + 1]) * 0.7071067811865476);
      }
      level.swap(next);
    }
  }
  Json tau = Json::array(), temp = Json::array(), z = Json::array();
  for (size_t b = 0; b <= kTemps; ++b) temp.push_back(lo + span * static_cast<double>(b) / kTemps);
  for (size_t band = 0; band < sum.size(); ++band) {
    tau.push_back(campaign.dt_s * std::ldexp(1.0, static_cast<int>(band)));
    Json row = Json::array();
    for (size_t b = 0; b < kTemps; ++b)
      row.push_back(number(sum[band][b] / std::sqrt(2 * n[band][b]))); // no data: null
    z.push_back(row);
  }
  return {{"tau_s", tau}, {"temp_edges_degc", temp}, {"z", z}};
}

// Held-out units in minutes, one after the other.
Json held_out_json(const AxisResult& axis) {
  Json unit = Json::array(), log = Json::array(), time = Json::array(), temp = Json::array(), slope = Json::array(),
       rate = Json::array(), before = Json::array(), after = Json::array();
  const std::vector<UnitMinutes>& units = axis.study.gap.units;
  for (size_t u = 0; u < units.size(); ++u)
    for (size_t k = 0; k < units[u].t_s.size(); ++k) {
      unit.push_back(u), log.push_back(units[u].log), time.push_back(units[u].t_s[k]);
      temp.push_back(axis.campaign.has_temperature ? Json(units[u].temp_degc[k]) : Json(nullptr));
      slope.push_back(units[u].slope_degc_min[k]);
      rate.push_back(short_number(units[u].rate_dph[k]));
      before.push_back(short_number(units[u].before_dph[k])), after.push_back(short_number(units[u].after_dph[k]));
    }
  return {{"mean_s", axis.study.gap.minutes.minute_s},
          {"are_logs", axis.study.gap.method == HeldOut::kLogs},
          {"unit", unit},
          {"log", log},
          {"t_s", time},
          {"temp_degc", temp},
          {"rate_degc_per_min", slope},
          {"rate_dph", rate},
          {"before_dph", before},
          {"after_dph", after}};
}

Json rows_json(const RecordedRows& rows) {
  Json time = Json::array(), temp = Json::array(), rate = Json::array();
  for (size_t k = 0; k < rows.t_s.size(); ++k)
    time.push_back(rows.t_s[k]), temp.push_back(short_number(rows.temp_degc[k])),
        rate.push_back(short_number(rows.rate_dph[k]));
  return {{"t_s", time}, {"temp_degc", temp}, {"rate_dph", rate}};
}

} // namespace

Json record_json(const AxisResult& axis) {
  Json logs = Json::array();
  for (const RecordedLog& log : axis.record) {
    Json entry = rows_json(log.used), left_out = Json::array();
    for (const LeftOutRows& rows : log.left_out) {
      Json some = rows_json(rows.rows);
      some.update({{"why", rows.why}, {"label", left_out_text(rows.why)}, {"n", rows.n}});
      left_out.push_back(some);
    }
    entry.update({{"log", log.log}, {"is_held_out", log.is_held_out}, {"every", log.every}, {"left_out", left_out}});
    if (!log.why_left_out.empty()) entry["why_left_out"] = log.why_left_out;
    logs.push_back(entry);
  }
  return logs;
}

Json plots_json(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const Campaign& campaign = axis.campaign;
  Json candidates = Json::array(), tests = Json::array();
  for (const CandidateEvidence& c : s.first_scan) candidates.push_back(evidence_json(c));
  for (size_t i = 0; i < s.before.size(); ++i)
    tests.push_back({{"name", rest_name(s.before[i].test)},
                     {"evidence_before_nats", s.before[i].evidence_nats},
                     {"evidence_after_nats", s.after[i].evidence_nats},
                     {"threshold_nats", s.before[i].threshold_nats}});
  return {{"record", record_json(axis)},
          {"held_out", held_out_json(axis)},
          {"gap_map", campaign.has_temperature ? map_json(campaign, axis.nominal_fit) : Json(nullptr)},
          {"gap_map_after", campaign.has_temperature ? map_json(campaign, axis.final_fit) : Json(nullptr)},
          {"residual", residual_json(campaign, axis.plain_fit, axis.final_fit)},
          {"dp2",
           {{"tau_s", numbers(axis.dp2.tau_s)},
            {"data_dph", numbers(axis.dp2.data_dph)},
            {"data_after_dph", numbers(axis.dp2.left_dph)},
            {"model_before_dph", numbers(axis.dp2.nominal_dph)},
            {"model_after_dph", numbers(axis.dp2.final_dph)}}},
          {"candidates", candidates},
          {"tests", tests}};
}

} // namespace imucal
