// SPDX-License-Identifier: MIT
#include "diagnose/report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <utility>

#include "analysis/diagnose/logs/blocks.h"
#include "base/axis_unit.h"
#include "diagnose/advice.h"
#include "diagnose/noise_words.h"
#include "diagnose/words.h"

namespace imucal {
namespace {

constexpr double kWeak_nats = 3;     // of evidence; below, odds of less than 20 to 1 beyond what a name must gain
constexpr double kNearlyAll = 0.95;  // a shrinkage that surely stays below leaves something
constexpr double kScaleEnd = -0.995; // a shrinkage is not told below -100 %

Json number(double x) {
  return std::isfinite(x) ? Json(x) : Json(nullptr);
}
Json numbers(const std::vector<double>& x) {
  Json out = Json::array();
  for (double v : x) out.push_back(number(v));
  return out;
}
const char* verdict_name(Verdict verdict) {
  switch (verdict) {
  case Verdict::kNoGap:
    return "no_gap";
  case Verdict::kExplained:
    return "explained";
  case Verdict::kPartlyExplained:
    return "partly_explained";
  case Verdict::kUnexplained:
    return "unexplained";
  }
  return "";
}
const char* doubt_text(Doubt doubt) {
  switch (doubt) {
  case Doubt::kMemberOpen:
    return "the logs tell the family of the cause, not its member";
  case Doubt::kShapeOpen:
    return "a free shape of this family follows the logs more closely than any of its members: the family is told, "
           "its member is open";
  case Doubt::kLoopOpen:
    return "only the states in which the runs began are seen, not a loop: whatever begins anew in every run and "
           "fades looks alike; logs that turn, and go far enough both ways, would tell";
  case Doubt::kSlowNoise:
    return "slow noise and a repeatable cause explain these logs equally well: they cannot tell";
  case Doubt::kAgainst:
    return "held-out data do not support it";
  case Doubt::kNone:
    break;
  }
  return "";
}
const char* rest_name(Rest test) {
  static const char* const names[] = {
      "spectrum",      "variance_over_temperature", "variance_over_time", "distribution", "bursts", "line",
      "sudden_changes"};
  return names[static_cast<size_t>(test)];
}
const char* rest_text(Rest test) {
  static const char* const texts[] = {"noise of another spectrum than the model's",
                                      "noise of a strength that depends on temperature",
                                      "noise of a strength that changes with time",
                                      "noise that is not Gaussian",
                                      "noise that comes in bursts",
                                      "a line in the spectrum",
                                      "sudden changes of the bias"};
  return texts[static_cast<size_t>(test)];
}
const char* held_out_text(HeldOut method) {
  return method == HeldOut::kLogs      ? "held-out logs"
         : method == HeldOut::kEachLog ? "each log held out in turn"
                                       : "quarters of the one log held out in turn, each with a constant of its own";
}

// Slow noise that a repeatable cause equals has no evidence of its own: neither gains over the other.
bool has_evidence(const SelectedEffect& e) {
  return e.doubt != Doubt::kSlowNoise;
}
// What was seen, or why the name is not more than it is; empty: nothing beside the name.
std::string statement_of(const SelectedEffect& e) {
  return e.statement.empty() ? doubt_text(e.doubt) : e.statement;
}
bool is_weak(const SelectedEffect& e) {
  return has_evidence(e) && e.evidence_nats < kWeak_nats;
}

// What the numbers mean, where they alone do not say it.
std::string in_words(const AxisResult& axis, const SelectedEffect& e) {
  return e.term.effect && e.doubt != Doubt::kSlowNoise ? noise_over_temperature(e.term, axis.campaign) : "";
}

// In the axis' unit: a tenth of a dph, or three digits of a few mg.
std::string figure(double value, const AxisResult& axis) {
  return format(is_accelerometer(axis.axis) ? "%.3g" : "%.1f", value);
}

bool is_note(const AxisResult& axis, const SelectedEffect& e) {
  return is_note(e, axis.study.selection.white_dph);
}
// As people read: what adds most first (what is not known in dph before it), then other parameters of the believed noise, then
// notes.
std::vector<size_t> reading_order(const AxisResult& axis) {
  const std::vector<SelectedEffect>& effects = axis.study.selection.effects;
  std::vector<size_t> order(effects.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto rank = [&](size_t i) {
    const SelectedEffect& e = effects[i];
    const bool is_retuned = e.term.estimator && e.term.estimator->is_nominal_noise();
    return std::make_pair(is_note(axis, e) ? 2 : is_retuned ? 1 : 0, std::isfinite(e.rms_dph) ? -e.rms_dph : -HUGE_VAL);
  };
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return rank(a) < rank(b); });
  return order;
}

// Its values; none where it has none of its own.
Parameters values_of(const AxisResult& axis, const SelectedEffect& e) {
  return e.term.effect && e.doubt != Doubt::kSlowNoise ? effect_values(e.term, axis.campaign) : Parameters();
}

bool is_shared_noise(const SelectedEffect& e) {
  return e.term.estimator && e.term.form() == Form::kAxes && !e.statement.empty();
}
// What the parameters of shared noise are: not what was measured.
std::string as_simulated(const AxisResult& axis, const SelectedEffect& e) {
  std::string list;
  for (const ParameterValue& p : values_of(axis, e))
    list += (list.empty() ? "" : ", ") + name_in_unit(p.name, axis_unit(axis.axis)) + format(" %.3g", p.number.value);
  return "a simulation gets that from white noise added to each axis: " + list;
}

// How sure a name is and what else it may be, a line each: the same in text, JSON and on the page.
std::vector<std::string> remarks_on(const AxisResult& axis, const SelectedEffect& e) {
  std::vector<std::string> out;
  const EffectMeaning meaning = e.term.effect ? e.term.effect->meaning(values_of(axis, e)) : EffectMeaning();
  if (!meaning.remark.empty()) out.push_back(meaning.remark);
  if (is_weak(e))
    out.push_back(format("weak evidence: odds of %.2g to 1 beyond what a name must gain; another log should confirm it",
                         std::exp(std::max(0.0, e.evidence_nats))));
  if (const std::string statement = statement_of(e); !statement.empty()) out.push_back(statement);
  if (is_shared_noise(e)) out.push_back(as_simulated(axis, e));
  if (is_note(axis, e))
    out.push_back(format("a small part of the noise: %s of %s %s from second to second",
                         figure(e.rms_dph, axis).c_str(), figure(axis.study.selection.white_dph, axis).c_str(),
                         axis_unit(axis.axis)));
  if (e.is_untested) out.push_back("the held-out logs cannot test it");
  if (e.is_of_starts)
    out.push_back(
        "in the held-out logs only the state in which each began is seen, read from that log itself: by the size "
        "told here alone a new log is not foretold, and the gap shrinks by less");
  std::vector<std::string> rivals;
  for (const CandidateEvidence& c : e.set)
    if (name_of(c) != name_of(e) && (!c.effect || c.effect != e.term.effect)) rivals.push_back(name_of(c));
  if (!rivals.empty()) out.push_back("cannot be told from: " + joined(rivals, ", "));
  return out;
}

Json evidence_json(const CandidateEvidence& c) {
  return {{"name", name_of(c)},
          {"family", family_name(c.family)},
          {"evidence_nats", number(c.evidence_nats())},
          {"gain_nats", number(c.gain_nats)},
          {"threshold_nats", number(c.threshold_nats)}};
}

Json cell_json(const WhereCell& c) {
  Json out = {{"excess", c.excess}, {"n", c.n}, {"z", c.z()}, {"noise_floor", std::sqrt(2 * c.n)}};
  if (c.mean_z != 0) out["mean_z"] = c.mean_z;
  return out;
}

Json cells_json(const std::vector<WhereCell>& cells, const char* range, const char* name, bool is_log) {
  Json list = Json::array();
  for (const WhereCell& c : cells) {
    Json cell = range ? Json{{range, {c.lo, c.hi}}} : is_log ? Json{{name, std::stoi(c.name)}} : Json{{name, c.name}};
    cell.update(cell_json(c));
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
    for (long k = 0; k + block <= before.residual[r].size(); k += block) {
      const Eigen::ArrayXd counts = (hits[r].segment(k, block).array() == 0).cast<double>();
      const auto mean_of = [&](const auto& x) { return (x.array() * counts).sum() / std::max(1.0, counts.sum()); };
      Eigen::VectorXd rates(block);
      for (long i = 0; i < block; ++i)
        rates[i] = run.input.rate_dph[static_cast<size_t>(run.used[static_cast<size_t>(k + i)])];
      const double mean = mean_of(rates), left_b = mean_of(before.residual[r].segment(k, block)),
                   left_a = mean_of(after.residual[r].segment(k, block));
      const size_t row = static_cast<size_t>(run.used[static_cast<size_t>(k + block / 2)]);
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
    for (size_t b = 0; b < kTemps; ++b) row.push_back(n[band][b] > 0 ? sum[band][b] / std::sqrt(2 * n[band][b]) : 0.0);
    z.push_back(row);
  }
  return {{"tau_s", tau}, {"temp_edges_degc", temp}, {"z", z}};
}

bool is_noise(const SelectedEffect& e) {
  return e.doubt != Doubt::kSlowNoise && e.term.estimator && e.term.form() == Form::kNoise;
}
bool is_slow_noise(const SelectedEffect& e) {
  return is_noise(e) && e.term.estimator->is_slow_noise();
}
template <typename Is> bool finds(const Selection& s, const Is& is) {
  return std::any_of(s.effects.begin(), s.effects.end(), is);
}

// Jumps in time, one after the other.
std::string text_of(const std::vector<StepValue>& steps, bool tells_log, const char* unit) {
  std::string out;
  for (const StepValue& step : steps) {
    char line[120];
    const Measured& size = step.amplitude_dph;
    out += out.empty() ? "" : ", ";
    std::snprintf(line, sizeof line, "%+.4g", size.value), out += line;
    if (std::isfinite(size.std_error)) std::snprintf(line, sizeof line, " +- %.2g", size.std_error), out += line;
    std::snprintf(line, sizeof line, " %s at %.0f s", unit, step.t_s), out += line;
    if (tells_log) out += " of log " + std::to_string(step.log + 1);
  }
  return out;
}
constexpr double kMoreThanNoise = 1.2; // times: worth a word
// What the fit gets wrong in other logs is worth a word beside the noise.
bool has_errors_of_fit(const GapResult& g) {
  return g.fit_ms_dph2 > 0.1 * g.noise_rms_dph * g.noise_rms_dph;
}
// What is left, in a sentence.
std::string remainder(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const GapResult& g = axis.study.gap;
  std::vector<std::string> said;
  const auto add = [&](const std::string& text) { add_once(text, &said); };
  std::vector<std::string> rejected; // names that were taken back: they stand for something else
  for (const CandidateEvidence& c : s.remainders)
    if (c.reference)
      add(std::string(c.reference->what) + " would follow the logs more closely");
    else
      add_once(name_of(c), &rejected);
  if (!rejected.empty()) add("considered and rejected: " + joined(rejected, ", "));
  for (const SelectedEffect& e : s.dropped)
    if (!e.came_by_chance) add("what " + name_of(e) + " took in the fitted logs and held-out data do not support");
  for (const RestFinding& f : s.after)
    if (f.evidence_nats > 0) add(rest_text(f.test));
  std::vector<std::string> unseen;
  for (const RestFinding& f : s.unseen)
    if (f.evidence_nats > 0) unseen.push_back(rest_text(f.test));
  if (!unseen.empty()) add("in the held-out logs alone: " + joined(unseen, ", "));
  if (g.run_to_run_rms_dph > 0)
    add(format("what differs from run to run, %s %s", figure(g.run_to_run_rms_dph, axis).c_str(),
               axis_unit(axis.axis)));
  if (!s.own_jumps.empty()) add("jumps in time that held-out logs have of their own");
  for (const SelectedEffect& e : s.effects)
    if (e.doubt == Doubt::kShapeOpen) add("the shape is open: " + family_label(e.family));
  if (g.has_mean && g.has_residual() && g.rms_after_dph > 1.1 * g.rms_before_dph)
    add(std::string("the predicted mean is further from the held-out rates than before") +
        (g.has_figure() ? "" : ", as far as their noise tells"));
  for (const Selection::Strength& noise : s.stronger_noise)
    add(format("the noise of held-out log %d is %.1f times as strong as that of the fitted logs", noise.log + 1,
               noise.times));
  if (s.leaves_mean || (s.exceeds_noise && g.times_expected() > kMoreThanNoise))
    add(format("the held-out residual is %.1f times what %s would leave", g.times_expected(),
               has_errors_of_fit(g) ? "noise and errors of the fit" : "the noise alone"));
  if (s.verdict != Verdict::kUnexplained && g.has_figure() && g.ci_hi < kNearlyAll)
    add(format("%.0f %% of the gap on data that were not fitted", 100 * (1 - g.shrinkage)));
  if (!g.has_mean &&
      finds(s, [](const SelectedEffect& e) { return e.term.estimator && e.term.form() == Form::kSteps; }))
    add("jumps at single moments foretell no other data");
  if (!g.has_mean && finds(s, is_noise)) add("a noise has no mean to predict");
  return said.empty() ? "nothing detectable on the held-out data" : joined(said, "; ");
}

// What is named is of the mean of other data, not of their noise alone.
bool names_mean(const Selection& s) {
  return std::any_of(s.effects.begin(), s.effects.end(), [](const SelectedEffect& e) {
    return !e.term.effect || (e.term.form() != Form::kNoise && e.term.form() != Form::kSteps &&
                              e.term.form() != Form::kStructural && e.term.form() != Form::kAxes);
  });
}
bool claims_shrinkage(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  return s.verdict != Verdict::kUnexplained && axis.study.gap.has_mean && names_mean(s);
}
bool has_figure(const AxisResult& axis) {
  return claims_shrinkage(axis) && axis.study.gap.has_figure();
}

// What a stand-in removes; a figure of which the residual says the contrary is none.
bool has_stand_in(const AxisResult& axis) {
  const GapResult& g = axis.study.gap;
  const bool is_contradicted = g.shrinkage > 0 && g.rms_after_dph > g.rms_before_dph;
  return axis.study.selection.verdict == Verdict::kUnexplained && g.has_figure() && !is_contradicted;
}
std::string stand_in_does(double shrinkage) {
  if (shrinkage >= 0) return format("removes %.0f %% of the gap", 100 * shrinkage);
  if (shrinkage <= kScaleEnd) return "makes the gap more than 100 % worse";
  return format("makes the gap %.0f %% worse", -100 * shrinkage);
}

// What the residuals are means of.
std::string means_text(const GapResult& gap) {
  return std::lround(gap.minute_s) == 60 ? "one-minute means" : format("means over %.0f s", gap.minute_s);
}

// Slow noise that was found beside the noise that was believed.
std::string noise_statement(const AxisResult& axis) {
  const GapResult& g = axis.study.gap;
  if (g.has_mean || !finds(axis.study.selection, is_slow_noise)) return "";
  return format("%s: %s would leave %s %s, these logs show %s; with the noise that was found %s is expected",
                means_text(g).c_str(),
                axis.is_believed ? "the believed noise" : "the noise that was estimated without a cause",
                figure(g.believed_rms_dph, axis).c_str(), axis_unit(axis.axis), figure(g.rms_before_dph, axis).c_str(),
                figure(g.noise_rms_dph, axis).c_str());
}

// How far the gap shrinks on data that were not fitted, or why that is not known; empty: not asked.
std::string held_out_statement(const AxisResult& axis) {
  const GapResult& g = axis.study.gap;
  if (!g.has_residual())
    return axis.study.selection.verdict == Verdict::kNoGap
               ? ""
               : "no figure: no rates at temperatures that were fitted (" + std::string(held_out_text(g.method)) + ")";
  const std::string residual =
      format("residual of %s %s -> %s %s, %s %s", means_text(g).c_str(), figure(g.rms_before_dph, axis).c_str(),
             figure(g.rms_after_dph, axis).c_str(), axis_unit(axis.axis),
             finds(axis.study.selection, is_slow_noise) ? "noise with the slow noise found" : "noise alone",
             figure(g.noise_rms_dph, axis).c_str()) +
      (has_errors_of_fit(g) ? format(", errors of the fit %s", figure(std::sqrt(g.fit_ms_dph2), axis).c_str()) : "") +
      (g.run_to_run_rms_dph > 0
           ? format(", what differs from run to run %s", figure(g.run_to_run_rms_dph, axis).c_str())
           : "");
  if (axis.study.selection.verdict == Verdict::kUnexplained && g.has_figure())
    return format("a flexible stand-in%s %s: not an explanation; %s",
                  axis.study.selection.effects.empty() ? "" : " of that family",
                  has_stand_in(axis) ? stand_in_does(g.shrinkage).c_str() : "leaves more than before",
                  residual.c_str());
  if (!g.has_mean && g.run_to_run_rms_dph > 0)
    return "no figure: what differs from run to run foretells no other run; " + residual;
  if (!claims_shrinkage(axis)) return noise_statement(axis);
  if (g.is_of_starts)
    return format("no figure: only the states in which the runs began are seen, and these foretell nothing (%s); %s",
                  held_out_text(g.method), residual.c_str());
  if (g.is_of_nearest)
    return format("no figure: what the nearest shape with parameters gets wrong is not known well enough (%s); %s",
                  held_out_text(g.method), residual.c_str());
  if (!g.has_figure())
    return format("no figure: noise hides how far the gap shrinks (95 %%: %.0f to %.0f %%; %s); %s", 100 * g.ci_lo,
                  100 * g.ci_hi, held_out_text(g.method), residual.c_str());
  if (g.ci_hi <= kScaleEnd)
    return format("the gap grows by more than 100 %% (%s); %s", held_out_text(g.method), residual.c_str());
  return format("the gap %s by %.0f %% (95 %%: %.0f to %.0f; %s); %s", g.shrinkage < 0 ? "grows" : "shrinks",
                100 * std::fabs(g.shrinkage), 100 * (g.shrinkage < 0 ? -g.ci_hi : g.ci_lo),
                100 * (g.shrinkage < 0 ? -g.ci_lo : g.ci_hi), held_out_text(g.method), residual.c_str());
}

Json gap_json(const AxisResult& axis) {
  const std::string unit = axis_unit(axis.axis);
  const GapResult& g = axis.study.gap;
  Json own_jumps = Json::array(), stronger = Json::array();
  for (const Selection::Strength& noise : axis.study.selection.stronger_noise)
    stronger.push_back({{"log", noise.log}, {"times", noise.times}});
  for (const StepValue& jump : axis.study.selection.own_jumps)
    own_jumps.push_back({{"log", jump.log},
                         {"t_s", jump.t_s},
                         {"size_dph", jump.amplitude_dph.value},
                         {"size_error_dph", jump.amplitude_dph.std_error}});
  Json gap = {
      {"before", g.before},
      {"after", g.after},
      {"shrinkage", has_figure(axis) ? Json(g.shrinkage) : Json(nullptr)},
      {"ci95", has_figure(axis) ? Json{g.ci_lo, g.ci_hi} : Json(nullptr)},
      {"unit",
       unit + "^2: mean square of what the models leave in the noise-free mean of the held-out data, estimated"},
      {"method", held_out_text(g.method)},
      {"gain", g.gain},
      {"gain_unit", "deviance per hour, held out"},
      {"hours", g.hours},
      {"gain_by_unit", g.delta_by_unit},
      {"log_by_unit", g.log_by_unit},
      {"statement", held_out_statement(axis)},
      {"part_within_fitted_temperatures", g.part_within},
      {"remainder", remainder(axis)},
      {"jumps_of_held_out_logs", own_jumps},
      {"stronger_noise_of_held_out_logs", stronger},
      {"has_mean", g.has_mean},
      {"residual_mean_s", g.minute_s},
      {"residual_rms_dph",
       {{"before", number(g.has_residual() ? g.rms_before_dph : std::nan(""))},
        {"after", number(g.has_residual() ? g.rms_after_dph : std::nan(""))},
        {"noise", g.noise_rms_dph},
        {"from_run_to_run", g.run_to_run_rms_dph},
        {"noise_error", g.noise_error_dph},
        {"errors_of_fit", std::sqrt(g.fit_ms_dph2)},
        {"believed_noise", g.believed_rms_dph}}},
      {"dp2_distance_dph", {{"before", g.dp2_before_dph}, {"after", g.dp2_after_dph}}}};
  if (has_stand_in(axis)) gap["stand_in_shrinkage"] = g.shrinkage;
  return gap;
}

// How often draws of the noise alone gain so much, in any axis of the call; null where no draws set what was to be gained.
Json p_value(const Selection& s, const SelectedEffect& e, double rate) {
  const auto is_drawn = [](Form form) {
    return form == Form::kColumns || form == Form::kTemperature || form == Form::kRunRandom;
  };
  if (!has_evidence(e) || s.is_told_by_held_out || e.is_structural) return Json(nullptr);
  if (e.term.estimator && !is_drawn(e.term.form())) return Json(nullptr);
  return Json(
      std::min(1.0, rate * std::exp((s.chance.over_nats - std::max(0.0, e.evidence_nats)) / s.chance.scale_nats)));
}

// It has a mean that can be drawn through the rates: noise and what the recorder did have none.
bool has_curve(const SelectedEffect& e) {
  if (e.doubt == Doubt::kSlowNoise) return false;
  if (!e.term.estimator) return !e.term.effect;
  const Form form = e.term.form();
  return form != Form::kNoise && form != Form::kStructural && form != Form::kAxes;
}

Json causes_json(const std::vector<HardwareCause>& causes) {
  Json out = Json::array();
  for (const HardwareCause& cause : causes) out.push_back({{"what", cause.what}, {"source", cause.source}});
  return out;
}

Json effect_json(const AxisResult& axis, const SelectedEffect& e, double rate) {
  Json set = Json::array();
  for (const CandidateEvidence& c : e.set) set.push_back(evidence_json(c));
  const Parameters values = values_of(axis, e);
  Json entry = {{"name", name_of(e)},
                {"family", family_name(e.family)},
                {"parameters", parameters_json(values)},
                {"std_errors", std_errors_json(values)},
                {"evidence_nats", e.evidence_nats},
                {"is_weak", is_weak(e)},
                {"is_note", is_note(axis, e)},
                {"has_curve", has_curve(e)},
                {"rms_dph", number(e.rms_dph)},
                {"gain_nats", e.gain_nats},
                {"p_value", p_value(axis.study.selection, e, rate)},
                {"set", set},
                {"is_untested", e.is_untested},
                {"remarks", remarks_on(axis, e)},
                {"held_out_gain", number(2 * e.held_out_nats / std::max(1e-9, axis.study.gap.hours))}};
  if (const std::string words = in_words(axis, e); !words.empty()) entry["in_words"] = words;
  if (is_shared_noise(e)) entry["measured"] = e.statement;
  if (e.is_family && e.term.effect) entry["member"] = e.term.effect->name();
  if (e.term.effect && e.doubt != Doubt::kSlowNoise) {
    const EffectMeaning meaning = e.term.effect->meaning(values);
    entry["label"] = e.is_family ? family_label(e.family) : meaning.label;
    entry["hardware_causes"] = causes_json(meaning.hardware_causes);
  }
  if (const std::string statement = statement_of(e); !statement.empty()) entry["statement"] = statement;
  return entry;
}

// Other parameters of the believed noise, and notes, are beside the cause, if there is one.
bool has_weak_causes_only(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  const auto is_cause = [&](const SelectedEffect& e) {
    return !is_note(axis, e) && !(e.term.estimator && e.term.estimator->is_nominal_noise());
  };
  const bool has_cause = std::any_of(s.effects.begin(), s.effects.end(), is_cause);
  return std::all_of(s.effects.begin(), s.effects.end(),
                     [&](const SelectedEffect& e) { return is_weak(e) || (has_cause && !is_cause(e)); });
}

// Why the family of a cause is told and no member of it.
std::string what_is_open(const std::vector<SelectedEffect>& effects) {
  const std::string no_member = "no member of it is told by these logs";
  if (effects.size() != 1) return no_member;
  const SelectedEffect& e = effects.front();
  if (e.doubt == Doubt::kShapeOpen) return "a free shape of it fits better than any member";
  if (e.doubt == Doubt::kLoopOpen) return "the states in which runs began are seen, a loop is not";
  std::vector<std::string> members;
  for (const CandidateEvidence& c : e.set)
    if (c.effect && c.family == e.family) add_once(c.effect->name(), &members);
  return members.size() == 1
             ? "of its members only " + members.front() + " comes near, and these logs do not bear it out"
             : no_member;
}

// A gap that has no name: what comes nearest, where anything does.
std::string unexplained(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  std::vector<SelectedEffect> told;
  std::vector<std::string> families, nearest, shared; // what axes share is measured, whatever else there is
  for (const SelectedEffect& e : s.effects)
    if (is_shared_noise(e) && !is_note(axis, e))
      add_once(name_of(e), &shared);
    else if (!is_note(axis, e))
      told.push_back(e);
  const std::string beside = shared.empty() ? "" : "; beside it " + joined(shared, " and ");
  for (const SelectedEffect& e : told) add_once(name_of(e), &families);
  for (const CandidateEvidence& c : s.remainders)
    if (!c.reference) add_once(name_of(c), &nearest);
  if (!families.empty())
    return "a gap, with a cause of the family " + joined(families, " and ") + "; " + what_is_open(told) + beside;
  if (!nearest.empty())
    return "a gap without a sure name; nearest comes " + joined(nearest, " and ") +
           ", which these logs do not bear out" + beside;
  return "a gap that no known effect explains" + beside;
}

std::string why_refused(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  if (!axis.refused.empty()) return axis.refused;
  if (s.effects.empty() && s.n_left_out == 0) return "too few usable seconds to judge";
  return "what the recorder did to the samples leaves too few usable seconds to judge";
}

bool is_undecided(const Selection& s) {
  return std::any_of(s.effects.begin(), s.effects.end(),
                     [](const SelectedEffect& e) { return e.doubt == Doubt::kSlowNoise; });
}

// The verdict in a few words, never more than the headline says.
std::string title(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  if (!is_judged(axis)) return "no answer";
  switch (s.verdict) {
  case Verdict::kNoGap:
    return "no gap found";
  case Verdict::kExplained:
    return has_weak_causes_only(axis) ? "gap, weakly explained" : "gap explained";
  case Verdict::kPartlyExplained:
    return is_undecided(s) ? "gap, noise or cause open" : "gap partly explained";
  case Verdict::kUnexplained:
    return "gap, cause open";
  }
  return "";
}

// What was found, for the headline, which is without notes.  Slow noise that may be a cause is told there in words.
std::string names_told(const AxisResult& axis) {
  const std::vector<SelectedEffect>& effects = axis.study.selection.effects;
  std::vector<std::string> names;
  for (size_t i : reading_order(axis)) {
    const SelectedEffect& e = effects[i];
    if (e.doubt == Doubt::kSlowNoise || is_note(axis, e)) continue;
    add_once(name_of(e) + (is_weak(e) && !has_weak_causes_only(axis) ? " (weak)" : ""), &names);
  }
  return joined(names, ", ");
}

// The answer in a sentence.  Silence of a profile is no answer on what it cannot show.
std::string headline(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  if (!is_judged(axis)) return "no answer: " + why_refused(axis);
  const std::string names = names_told(axis);
  const auto with = [&](const char* between) { return names.empty() ? "" : between + names; };
  switch (s.verdict) {
  case Verdict::kNoGap: {
    const std::string hidden = hidden_text(axis);
    return "no gap that these logs can show" + (hidden.empty() ? "" : "; not detectable on these profiles: " + hidden);
  }
  case Verdict::kExplained:
    return (has_weak_causes_only(axis) ? "a gap, explained by little more than a name must gain" : "a gap, explained") +
           with(": ");
  case Verdict::kPartlyExplained:
    if (is_undecided(s))
      return "a gap: slow noise or a repeatable cause, these logs cannot tell" + with("; beside it ");
    return "a gap, partly explained" + with(": ");
  case Verdict::kUnexplained:
    return unexplained(axis);
  }
  return "";
}

std::vector<std::string> notes(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  std::vector<std::string> out;
  for (const SelectedEffect& e : s.dropped)
    out.push_back(
        name_of(e) +
        format(
            " would gain %.0f nats on the fitted logs, but the held-out data do not support it (%.1f nats): not named",
            e.gain_nats, e.held_out_nats));
  for (const SelectedEffect& e : s.effects)
    if (e.is_any_shape && !e.is_family)
      out.push_back(
          e.term.effect->name() +
          ": found in a shape that its parameters do not tell; they are those of the nearest one, which leaves more");
  if (s.is_told_by_held_out && !s.effects.empty() && s.effects.front().family != Family::kSlowNoise)
    out.push_back("slow noise would explain the fitted logs as well; what is named is told by all logs together");
  if (!s.own_jumps.empty())
    out.push_back("held-out logs have jumps of their own, which no fitted log foretells: " +
                  text_of(s.own_jumps, true, axis_unit(axis.axis)) + " held out; the level after each is left free");
  if (s.n_dropouts > 0)
    out.push_back(format("%zu exact zeros that are no rates are drop-outs and were left out", s.n_dropouts));
  if (s.n_left_out > s.n_dropouts)
    out.push_back(format("%zu seconds in all were left out because of what the recorder or converter did to them, or "
                         "to samples next to them",
                         s.n_left_out));
  if (s.is_noise_retuned)
    out.push_back(
        "the believed noise parameters do not fit these logs: they were estimated again under every candidate");
  return out;
}

// Of an axis that was not judged.  Who reads the verdict alone must take it neither for clean nor for explained.
Json refused_json(const AxisResult& axis) {
  return {{"axis", axis.axis},
          {"unit", axis_unit(axis.axis)},
          {"verdict", verdict_name(Verdict::kUnexplained)},
          {"statement", headline(axis)},
          {"title", title(axis)},
          {"refused", why_refused(axis)},
          {"where", nullptr},
          {"effects", Json::array()},
          {"not_detectable_here", Json::array()},
          {"indistinguishable", Json::array()},
          {"open_pairs", Json::array()},
          {"advice", Json::array()},
          {"advised_profile", nullptr},
          {"notes", Json::array()},
          {"gap",
           {{"before", nullptr},
            {"after", nullptr},
            {"shrinkage", nullptr},
            {"ci95", nullptr},
            {"unit", std::string(axis_unit(axis.axis)) + "^2"},
            {"remainder", "not judged"},
            {"residual_rms_dph", {{"before", nullptr}, {"after", nullptr}}},
            {"dp2_distance_dph", {{"before", nullptr}, {"after", nullptr}}}}}};
}

Json plots_json(const AxisResult& axis) {
  const GapResult& g = axis.study.gap;
  const Selection& s = axis.study.selection;
  const Campaign& campaign = axis.campaign;
  Json candidates = Json::array(), tests = Json::array();
  for (const CandidateEvidence& c : s.first_scan) candidates.push_back(evidence_json(c));
  for (size_t i = 0; i < s.before.size(); ++i)
    tests.push_back({{"name", rest_name(s.before[i].test)},
                     {"evidence_before_nats", s.before[i].evidence_nats},
                     {"evidence_after_nats", s.after[i].evidence_nats},
                     {"threshold_nats", s.before[i].threshold_nats}});
  return {{"gap_map", campaign.has_temperature ? map_json(campaign, axis.nominal_fit) : Json(nullptr)},
          {"gap_map_after", campaign.has_temperature ? map_json(campaign, axis.final_fit) : Json(nullptr)},
          {"residual", residual_json(campaign, axis.plain_fit, axis.final_fit)},
          {"dp2",
           {{"tau_s", numbers(g.dp2_tau_s)},
            {"data_dph", numbers(g.dp2_data_dph)},
            {"model_before_dph", numbers(g.dp2_nominal_dph)},
            {"model_after_dph", numbers(g.dp2_final_dph)}}},
          {"candidates", candidates},
          {"tests", tests}};
}

Json answer_json(const AxisResult& axis, double rate) {
  if (!axis.refused.empty()) return refused_json(axis);
  const Selection& s = axis.study.selection;
  Json effects = Json::array(), hidden = Json::array(), alike = Json::array(), detectable = Json::array();
  for (const SelectedEffect& e : s.effects) effects.push_back(effect_json(axis, e, rate));
  if (s.cannot_judge) {
    Json out = refused_json(axis);
    out["effects"] = effects;
    return out;
  }
  const auto entry_of = [](const Detectability& d) {
    return Json{{"name", d.name}, {"smallest_detectable", parameters_json(d.smallest_detectable)}};
  };
  for (const Detectability& d : axis.identifiability.effects) detectable.push_back(entry_of(d));
  for (const Detectability* d : hidden_effects(axis)) hidden.push_back(entry_of(*d));
  for (const Alike& pair : axis.identifiability.indistinguishable) alike.push_back({pair.first, pair.second});
  Json pairs = Json::array();
  for (const Alike& pair : open_pairs(axis))
    pairs.push_back({{"names", {pair.first, pair.second}}, {"told_from_times", number(pair.told_from)}});
  const Campaign& campaign = axis.campaign;
  const NoiseModel& noise = s.fitted_noise;
  Json markov = Json::array();
  for (const Markov& m : noise.markov) markov.push_back({{"sigma_dph", m.sigma_dph}, {"tau_s", m.tau_s}});
  const bool is_advised = advised_profile_helps(axis);
  const Profile profile = separating_profile(campaign.lo_degc, campaign.hi_degc);
  return {
      {"axis", axis.axis},
      {"unit", axis_unit(axis.axis)},
      {"verdict", verdict_name(s.verdict)},
      {"statement", headline(axis)},
      {"title", title(axis)},
      {"is_weak", !s.effects.empty() && has_weak_causes_only(axis)},
      {"where", s.verdict == Verdict::kNoGap ? Json(nullptr) : where_json(axis)},
      {"effects", effects},
      {"reading_order", reading_order(axis)},
      {"not_detectable_here", hidden},
      {"smallest_detectable", detectable},
      {"indistinguishable", alike},
      {"open_pairs", pairs},
      {"advice", advice(axis)},
      {"notes", notes(axis)},
      {"noise", {{"arw_deg_rt_h", noise.white_sigma_dph / 60}, {"markov", markov}, {"is_retuned", s.is_noise_retuned}}},
      {"threshold_nats", s.chance.threshold_nats},
      {"gap", gap_json(axis)},
      {"plots", plots_json(axis)},
      {"seconds", axis.seconds},
      {"advised_profile", is_advised ? to_json(profile) : Json(nullptr)},
      {"advised_profile_mirrored",
       is_advised ? to_json(mirrored(profile, campaign.lo_degc, campaign.hi_degc)) : Json(nullptr)}};
}

Json axis_json(const AxisResult& axis, double rate) {
  Json out = answer_json(axis, rate), left_out = Json::array();
  for (const UnusedLog& log : axis.left_out) left_out.push_back({{"log", log.path}, {"why", log.why}});
  if (!axis.left_out.empty()) out["left_out_logs"] = left_out;
  return out;
}

std::string text_of(const ParameterValue& p, const AxisResult& axis) {
  char line[120];
  const char* unit = axis_unit(axis.axis);
  const size_t n_logs = axis.campaign.runs.size() + axis.campaign.left_out.size();
  if (p.kind == EffectParameter::kSteps) return text_of(p.steps, n_logs > 1, unit);
  if (p.kind == EffectParameter::kText) return p.name + " " + p.text;
  const bool is_white_mg = p.name == "arw_deg_rt_h" && std::string(unit) == "mg";
  const double factor = is_white_mg ? 60 : 1;
  std::snprintf(line, sizeof line, "%s %.4g", is_white_mg ? "white_mg_rt_hz" : name_in_unit(p.name, unit).c_str(),
                factor * p.number.value);
  std::string out = line;
  if (std::isfinite(p.number.std_error)) {
    std::snprintf(line, sizeof line, " +- %.2g", factor * p.number.std_error);
    out += line;
  }
  return out;
}

std::string effect_text(const AxisResult& axis, const SelectedEffect& e) {
  std::string list;
  const bool is_shared = is_shared_noise(e); // what was measured first: the parameters are those of a simulation
  if (is_shared) list = e.statement;
  for (const ParameterValue& p : is_shared ? Parameters() : values_of(axis, e))
    list += (list.empty() ? "" : ", ") + text_of(p, axis);
  std::string out = (is_note(axis, e) ? "  note    " : "  effect  ") + name_of(e);
  if (e.is_family && e.term.effect && !list.empty()) out += " (as " + e.term.effect->name() + ")";
  out += list.empty() ? "" : ": " + list;
  out += has_evidence(e) ? format(" (evidence %.1f nats)\n", e.evidence_nats) : "\n";
  if (const std::string words = in_words(axis, e); !words.empty()) out += "          " + words + "\n";
  for (const std::string& remark : remarks_on(axis, e))
    if (!is_shared || remark != e.statement) out += "          " + remark + "\n";
  return out;
}

std::string axis_text(const AxisResult& axis) {
  const Selection& s = axis.study.selection;
  std::string out = axis.axis + ": " + headline(axis) + "\n";
  if (!is_judged(axis)) {
    for (size_t i : reading_order(axis)) out += effect_text(axis, s.effects[i]); // what the recorder did
    return out;
  }
  if (s.verdict != Verdict::kNoGap) out += "  where   " + axis.where.sentence + "\n";
  for (size_t i : reading_order(axis)) out += effect_text(axis, s.effects[i]);
  if (const std::string held_out = held_out_statement(axis); !held_out.empty()) out += "  held out  " + held_out + "\n";
  if (!s.effects.empty() || s.verdict == Verdict::kUnexplained) out += "            left: " + remainder(axis) + "\n";
  for (const std::string& note : notes(axis)) out += "  note    " + note + "\n";
  return out;
}

Json properties_json(const EffectEstimator* e) {
  if (!e) return Json::object();
  return {{"is_slow_noise", e->is_slow_noise()},
          {"is_nominal_noise", e->is_nominal_noise()},
          {"is_repeatable", e->is_repeatable()},
          {"is_structural", e->is_structural()},
          {"is_censoring", e->is_censoring()},
          {"needs_temperature", e->needs_temperature()},
          {"concerns_coarse_thermometer", e->concerns_coarse_thermometer()},
          {"has_markov_spectrum", e->has_markov_spectrum()}};
}

} // namespace

Json diagnosis_json(const DiagnoseOptions& options, const DiagnoseResult& result) {
  Json axes = Json::array();
  bool from_cache = true;
  for (const AxisResult& axis : result.axes) {
    axes.push_back(axis_json(axis, options.false_alarm_rate));
    from_cache = from_cache && (axis.is_calibration_cached || !axis.refused.empty());
  }
  return {{"imucal_diagnosis", 1},
          {"version", IMUCAL_VERSION},
          {"model", result.has_model ? Json(options.model_path) : Json(nullptr)},
          {"logs", options.logs},
          {"held_out_logs", options.held_out},
          {"false_alarm_rate", options.false_alarm_rate},
          {"seed", options.seed},
          {"calibration", {{"nulls", options.nulls}, {"from_cache", from_cache}, {"seconds", result.calibration_s}}},
          {"warnings", result.warnings},
          {"library", library_json()},
          {"axes", axes}};
}

std::vector<std::string> unanswered(const DiagnoseResult& result) {
  std::vector<std::string> out;
  for (const AxisResult& axis : result.axes)
    if (!is_judged(axis)) out.push_back(axis.axis + ": " + headline(axis));
  return out;
}

std::string diagnosis_text(const DiagnoseOptions&, const DiagnoseResult& result) {
  std::string text;
  for (const AxisResult& axis : result.axes) text += axis_text(axis);
  // What the profiles cannot tell, on a line each: once for all axes, with their names where it is not of all.
  std::vector<std::string> said;
  std::map<std::string, std::vector<std::string>> of_axes;
  size_t n_judged = 0;
  for (const AxisResult& axis : result.axes) {
    if (!is_judged(axis)) continue;
    ++n_judged;
    for (const std::string& line : advice(axis)) add_once(line, &said), add_once(axis.axis, &of_axes[line]);
  }
  for (const std::string& line : said)
    if (line != constant_offsets()) { // said in the JSON
      const std::vector<std::string>& names = of_axes[line];
      text += "advice    " + (names.size() < n_judged ? joined(names, ", ") + ": " : "") + line + "\n";
    }
  for (const std::string& warning : result.warnings) text += "warning: " + warning + "\n";
  return text;
}

Json library_json() {
  Json list = Json::array();
  for (const Effect* effect : effect_library()) {
    Json parameters = Json::array();
    for (const EffectParameter& p : effect->parameters()) {
      Json entry = {{"name", p.name}, {"meaning", p.meaning}, {"unit", p.unit()}};
      if (p.kind == EffectParameter::kNumber) entry["min"] = p.lo, entry["max"] = p.hi;
      if (p.is_optional) entry["optional"] = true;
      if (!p.words.empty()) entry["words"] = p.words;
      parameters.push_back(entry);
    }
    list.push_back({{"name", effect->name()},
                    {"label", effect->label()},
                    {"description", effect->description()},
                    {"family", family_name(effect->family())},
                    {"parameters", parameters},
                    {"hardware_causes", causes_json(effect->hardware_causes())},
                    {"properties", properties_json(effect->estimator())},
                    {"can_be_diagnosed", effect->estimator() != nullptr}});
  }
  Json families = Json::array();
  for (Family family : all_families())
    families.push_back({{"name", family_name(family)}, {"label", family_label(family)}});
  return {{"imucal_effects", 1}, {"effects", list}, {"families", families}};
}

} // namespace imucal
