// SPDX-License-Identifier: MIT
// The result of one axis as JSON (design 1.6, and README.md for what is added) and as text.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "analysis/diagnose/diagnose.h"

namespace imucal {

namespace {

constexpr double kAgainst =
    6.6; // deviance by which held-out data speak against an effect: 1 % of chi2, one degree

Json number(double x) {
  return std::isfinite(x) ? Json(x) : Json(nullptr);
}

// The parameters of a term with their standard errors, by the names of the contract.
Parameters effect_values(const Term& term, const Campaign& campaign) {
  if (!term.fixed_parameters.empty()) return term.fixed_parameters;
  Estimate estimate = term.estimate();
  if (term.form() == Form::kSteps)
    // Times as in the log, logs by their place in the call.
    for (size_t s = 0; s + 1 < estimate.shape.size(); s += 2) {
      const CampaignRun& run = campaign.runs[static_cast<size_t>(term.shape[s])];
      estimate.shape[s] = static_cast<double>(run.input.log);
      estimate.shape[s + 1] += run.start_s;
    }
  return term.estimator->values_on(campaign.runs.front().input, estimate);
}

Json evidence_json(const CandidateEvidence& c) {
  Json out = {{"name", c.name},
              {"evidence_nats", number(c.evidence_nats)},
              {"gain_nats", number(c.gain_nats)},
              {"threshold_nats", number(c.threshold_nats)}};
  if (std::isfinite(c.gain_reestimated_nats)) out["gain_reestimated_nats"] = c.gain_reestimated_nats;
  return out;
}

Json cell_json(const WhereCell& c) {
  Json out = {{"excess", c.excess}, {"n", c.n}, {"z", c.z()}, {"noise_floor", std::sqrt(2 * c.n)}};
  if (c.mean_z != 0) out["mean_z"] = c.mean_z;
  return out;
}

Json where_json(const AxisResult& axis) {
  const WhereResult& w = axis.where;
  Json findings = Json::array();
  for (const GenericFinding& f : axis.selection.before) {
    if (f.evidence_nats() <= 0) continue;
    bool remains = false;
    for (const GenericFinding& a : axis.selection.after)
      remains = remains || (a.test == f.test && a.evidence_nats() > 0);
    findings.push_back({{"probe", generic_names()[f.test]},
                        {"evidence_nats", f.evidence_nats()},
                        {"p_value", std::min(1.0, 0.01 * std::exp(-f.evidence_nats()))},
                        {"statement", generic_statement(f.test)},
                        {"remains_after", remains}});
  }
  Json tau = Json::array(), temp = Json::array(), phase = Json::array(), log = Json::array();
  for (const WhereCell& c : w.by_tau) {
    Json cell = {{"tau_s", {c.lo, c.hi}}};
    cell.update(cell_json(c));
    tau.push_back(cell);
  }
  for (const WhereCell& c : w.by_temperature) {
    Json cell = {{"temp_degc", {c.lo, c.hi}}};
    cell.update(cell_json(c));
    temp.push_back(cell);
  }
  for (const WhereCell& c : w.by_phase) {
    Json cell = {{"phase", c.name}};
    cell.update(cell_json(c));
    phase.push_back(cell);
  }
  for (const WhereCell& c : w.by_log) {
    Json cell = {{"log", std::stoi(c.name)}};
    cell.update(cell_json(c));
    log.push_back(cell);
  }
  return {{"tau_s", {w.tau_lo_s, w.tau_hi_s}},
          {"temp_degc", {w.temp_lo_degc, w.temp_hi_degc}},
          {"time_s", {w.time_lo_s, w.time_hi_s}},
          {"direction", w.direction},
          {"logs", w.logs},
          {"sentence", w.sentence},
          {"findings", findings},
          {"by_tau", tau},
          {"by_temperature", temp},
          {"by_phase", phase},
          {"by_log", log}};
}

// 60-s means of the residual with their temperature, direction, time and log.
Json residual_json(const Campaign& campaign, const Fit& before, const Fit& after) {
  Json temp = Json::array(), rate = Json::array(), time = Json::array(), log = Json::array(),
       b = Json::array(), a = Json::array();
  size_t total = 0;
  for (const CampaignRun& run : campaign.runs) total += run.n();
  const long block = std::max<long>(60, static_cast<long>(total / 1500));
  for (size_t r = 0; r < campaign.runs.size(); ++r) {
    const CampaignRun& run = campaign.runs[r];
    for (long k = 0; k + block <= before.residual[r].size(); k += block) {
      const size_t row = static_cast<size_t>(run.used[static_cast<size_t>(k + block / 2)]);
      temp.push_back(campaign.has_temperature ? Json(run.input.smooth_degc[row]) : Json(nullptr));
      rate.push_back(run.input.rate_degc_min[row]);
      time.push_back(run.start_s + run.input.t_s[row]);
      log.push_back(run.input.log);
      b.push_back(before.residual[r].segment(k, block).mean());
      a.push_back(after.residual[r].segment(k, block).mean());
    }
  }
  return {{"mean_s", block}, {"temp_degc", temp}, {"rate_degc_per_min", rate}, {"t_s", time}, {"log", log},
          {"before_dph", b}, {"after_dph", a}};
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
        const size_t b =
            std::min(kTemps - 1, static_cast<size_t>(std::max(0.0, (temp - lo) / span * kTemps)));
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
      row.push_back(n[band][b] > 0 ? sum[band][b] / std::sqrt(2 * n[band][b]) : 0.0);
    z.push_back(row);
  }
  return {{"tau_s", tau}, {"temp_edges_degc", temp}, {"z", z}};
}

Json numbers(const std::vector<double>& x) {
  Json out = Json::array();
  for (double v : x) out.push_back(number(v));
  return out;
}

// Deviance per hour that the held-out data lose without this effect; NaN: not a term of the final hypothesis.
double held_out_gain(const AxisResult& axis, const SelectedEffect& effect) {
  const std::vector<Term>& terms = axis.selection.final.terms;
  for (size_t t = 0; t < terms.size() && t < axis.gap.gain_by_term.size(); ++t)
    if (terms[t].effect == effect.term.effect) return axis.gap.gain_by_term[t];
  return std::nan("");
}

// The answer in a sentence.  Silence of a profile is no answer on what it cannot show.
std::string headline(const AxisResult& axis) {
  switch (axis.selection.verdict) {
  case Verdict::kNoGap: {
    const std::string hidden = axis.identifiability.not_detectable();
    return "no gap that these logs can show" +
           (hidden.empty() ? "" : "; not detectable on these profiles: " + hidden);
  }
  case Verdict::kExplained:
    return "a gap, explained";
  case Verdict::kPartlyExplained:
    return "a gap, partly explained";
  case Verdict::kUnexplained:
    return "a gap that no known effect explains";
  }
  return "";
}

} // namespace

Json axis_json(const AxisResult& axis, const Campaign& campaign, const Fit& nominal_fit,
               const Fit& final_fit) {
  const Selection& s = axis.selection;
  Json effects = Json::array();
  for (const SelectedEffect& e : s.effects) {
    Json set = Json::array();
    for (const CandidateEvidence& c : e.set) set.push_back(evidence_json(c));
    const Parameters values = effect_values(e.term, campaign);
    Json entry = {{"name", e.term.effect->name()},
                  {"family", family_name(e.term.effect->family())},
                  {"parameters", parameters_json(values)},
                  {"std_errors", std_errors_json(values)},
                  {"evidence_nats", e.evidence_nats},
                  {"gain_nats", e.gain_nats},
                  {"p_value", e.p_value},
                  {"set", set}};
    if (!e.statement.empty()) entry["statement"] = e.statement;
    entry["held_out_gain"] = number(held_out_gain(axis, e));
    effects.push_back(entry);
  }
  Json hidden = Json::array(), alike = Json::array();
  for (const Detectability& d : axis.identifiability.effects)
    if (!d.is_notable)
      hidden.push_back({{"name", d.name}, {"smallest_detectable", parameters_json(d.smallest_detectable)}});
  Json detectable = Json::array();
  for (const Detectability& d : axis.identifiability.effects)
    detectable.push_back({{"name", d.name}, {"smallest_detectable", parameters_json(d.smallest_detectable)}});
  for (const auto& pair : axis.identifiability.indistinguishable) alike.push_back({pair.first, pair.second});
  Json candidates = Json::array();
  for (const CandidateEvidence& c : s.first_scan) candidates.push_back(evidence_json(c));
  Json tests = Json::array();
  for (size_t i = 0; i < s.before.size(); ++i)
    tests.push_back({{"name", generic_names()[s.before[i].test]},
                     {"evidence_before_nats", s.before[i].evidence_nats()},
                     {"evidence_after_nats", s.after[i].evidence_nats()},
                     {"threshold_nats", s.before[i].threshold_nats}});
  const GapResult& g = axis.gap;
  Json gap = {{"before", g.before},
              {"after", g.after},
              {"shrinkage", g.shrinkage},
              {"ci95", {g.ci_lo, g.ci_hi}},
              {"unit", "deviance per hour, held out"},
              {"method", g.method},
              {"gain", g.gain},
              {"gain_ci95", {g.gain_lo, g.gain_hi}},
              {"interval", g.interval_method},
              {"hours", g.hours},
              {"gain_by_unit", g.delta_by_unit},
              {"reference",
               "the best of the final model and library-free references: the shrinkage is an upper bound"},
              {"remainder", g.remainder},
              {"residual_rms_dph", {{"before", g.rms_before_dph}, {"after", g.rms_after_dph}}},
              {"dp2_distance_dph", {{"before", g.dp2_before_dph}, {"after", g.dp2_after_dph}}}};
  Json plots = {{"gap_map", campaign.has_temperature ? map_json(campaign, nominal_fit) : Json(nullptr)},
                {"gap_map_after", campaign.has_temperature ? map_json(campaign, final_fit) : Json(nullptr)},
                {"residual", residual_json(campaign, nominal_fit, final_fit)},
                {"dp2",
                 {{"tau_s", numbers(g.dp2_tau_s)},
                  {"data_dph", numbers(g.dp2_data_dph)},
                  {"model_before_dph", numbers(g.dp2_nominal_dph)},
                  {"model_after_dph", numbers(g.dp2_final_dph)}}},
                {"candidates", candidates},
                {"tests", tests}};
  Json out = {{"axis", axis.axis},
              {"verdict", to_text(s.verdict)},
              {"statement", headline(axis)},
              {"where", s.verdict == Verdict::kNoGap ? Json(nullptr) : where_json(axis)},
              {"effects", effects},
              {"not_detectable_here", hidden},
              {"smallest_detectable", detectable},
              {"indistinguishable", alike},
              {"advice", axis.advice},
              {"notes", s.notes},
              {"gap", gap},
              {"plots", plots},
              {"seconds", axis.seconds}};
  out["advised_profile"] = campaign.has_temperature && (!hidden.empty() || !alike.empty())
                               ? to_json(separating_profile(campaign.lo_degc, campaign.hi_degc))
                               : Json(nullptr);
  return out;
}

static std::string text_of(const ParameterValue& p) {
  char line[120];
  if (p.kind == EffectParameter::kSteps) return std::to_string(p.steps.size()) + " " + p.name;
  if (p.kind == EffectParameter::kText) return p.name + " " + p.text;
  std::snprintf(line, sizeof line, "%s %.4g", p.name.c_str(), p.number.value);
  std::string out = line;
  if (std::isfinite(p.number.std_error)) {
    std::snprintf(line, sizeof line, " +- %.2g", p.number.std_error);
    out += line;
  }
  return out;
}

std::string axis_text(const AxisResult& axis, const Campaign& campaign) {
  const Selection& s = axis.selection;
  std::string out = axis.axis + ": " + headline(axis) + "\n";
  char line[400];
  if (s.verdict != Verdict::kNoGap) out += "  where   " + axis.where.sentence + "\n";
  for (const SelectedEffect& e : s.effects) {
    std::string list;
    for (const ParameterValue& p : effect_values(e.term, campaign))
      list += (list.empty() ? "" : ", ") + text_of(p);
    std::snprintf(line, sizeof line, "  effect  %s: %s (evidence %.1f nats)\n", e.term.effect->name().c_str(),
                  list.c_str(), e.evidence_nats);
    out += line;
    if (const double gain = held_out_gain(axis, e); gain * axis.gap.hours < -kAgainst) {
      std::snprintf(
          line, sizeof line,
          "          the held-out data speak against it (deviance %.0f per hour worse with it): slow noise "
          "or peculiar to these logs\n",
          -gain);
      out += line;
    }
    if (e.set.size() > 1) {
      out += "          cannot be told from:";
      for (size_t i = 1; i < e.set.size(); ++i) out += (i > 1 ? ", " : " ") + e.set[i].name;
      out += "\n";
    }
  }
  for (const GenericFinding& f : s.after)
    if (f.evidence_nats() > 0) {
      std::snprintf(line, sizeof line, "  remains %s (%.1f nats over its threshold)\n",
                    generic_statement(f.test).c_str(), f.evidence_nats());
      out += line;
    }
  if (!s.effects.empty()) {
    std::snprintf(line, sizeof line,
                  "  held out  deviance gap shrinks by %.0f %% (95 %%: %.0f to %.0f; %s); residual rms %.1f "
                  "-> %.1f dph; "
                  "DP2 distance %.2f -> %.2f dph\n",
                  100 * axis.gap.shrinkage, 100 * axis.gap.ci_lo, 100 * axis.gap.ci_hi,
                  axis.gap.method.c_str(), axis.gap.rms_before_dph, axis.gap.rms_after_dph,
                  axis.gap.dp2_before_dph, axis.gap.dp2_after_dph);
    out += line;
  }
  if (!s.effects.empty()) out += "            left: " + axis.gap.remainder + "\n";
  for (const std::string& note : s.notes) out += "  note    " + note + "\n";
  return out;
}

} // namespace imucal
