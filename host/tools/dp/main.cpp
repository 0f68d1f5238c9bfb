// SPDX-License-Identifier: MIT
// dp: Allan deviation and Direct Predictor curves and distribution ratios of logs.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "analysis/dp/dp.h"
#include "analysis/dp/ratios.h"
#include "analysis/dp/stream.h"
#include "analysis/dp/tau_grid.h"
#include "analysis/errormodel/confidence.h"
#include "base/axis_unit.h"
#include "base/digits.h"
#include "base/format.h"
#include "base/parallel.h"
#include "cli/program.h"
#include "cli/text.h"
#include "io/log.h"
#include "io/notice.h"
#include "physics/effects/closed_forms.h"

using namespace imucal;

namespace {

struct Options {
  CommonOptions common;
  std::vector<std::string> logs, axes, estimators = {"rms"};
  std::string type, tau, nominal, detrend = "mean", ci_model;
  double estimation_s = 20, min_fill = 1, false_alarm_rate = 0.01;
  bool no_ratios = false, stream = false;
};

// What an interval rests on where fewer than kFewestBlocks blocks fit.
const char* assumed_noise(DpType type) {
  return type == DpType::kDp2 || type == DpType::kDp3 ? "the nominal model's noise"
                                                      : "white noise or random walk, whichever is wider";
}

Json curve_json(const DpCurve& c, const CurveIntervals& intervals) {
  Json json = {{"log", c.log},
               {"axis", c.axis},
               {"type", to_text(c.type)},
               {"estimator", to_text(c.estimator)},
               {"tau_s", c.tau_s},
               {"dp_dph", c.dp_dph},
               {"ci95_dph", Json::array()},
               {"n", c.n},
               {"unit", axis_unit(c.axis)}};
  for (const Interval& i : intervals.ci) json["ci95_dph"].push_back({i.lo, i.hi});
  if (!intervals.blocks.empty()) json["ci_blocks"] = intervals.blocks;
  return json;
}

Json ratios_json(const DpRatios& r) {
  Json json = {{"log", r.log},
               {"axis", r.axis},
               {"type", to_text(r.type)},
               {"tau_s", r.tau_s},
               {"max_over_rms", r.max_over_rms},
               {"p95_over_rms", r.p95_over_rms},
               {"max_limit", r.max_limit},
               {"dof", r.dof},
               {"verdict", r.verdict},
               {"statement", r.statement},
               {"n_events", r.n_events},
               {"outliers", Json::array()}};
  for (const DpOutlier& o : r.outliers)
    json["outliers"].push_back({{"t_s", o.t_s},
                                {"temp_degc", std::isnan(o.temp_degc) ? Json() : Json(o.temp_degc)},
                                {"tau_s", o.tau_s},
                                {"sigmas", o.sigmas}});
  return json;
}

// rms and max over records, where all have the same tau and unit.
Json across_json(const std::vector<DpCurve>& curves) {
  const std::string unit = axis_unit(curves[0].axis);
  Json json = {{"tau_s", curves[0].tau_s},
               {"n_curves", curves.size()},
               {"unit", unit},
               {"rms_dph", Json::array()},
               {"max_dph", Json::array()}};
  for (size_t i = 0; i < curves[0].tau_s.size(); ++i) {
    double sum = 0, largest = 0;
    for (const DpCurve& c : curves) {
      if (c.tau_s != curves[0].tau_s || axis_unit(c.axis) != unit) return nullptr;
      sum += c.dp_dph[i] * c.dp_dph[i] / static_cast<double>(curves.size());
      largest = std::max(largest, c.dp_dph[i]);
    }
    json["rms_dph"].push_back(std::sqrt(sum));
    json["max_dph"].push_back(largest);
  }
  return json;
}

// No more digits than the interval leaves.
std::string digits_of(double value, const Interval& ci) {
  return as_known(value, (ci.hi - ci.lo) / 2);
}

void print_curve(const DpCurve& c, const CurveIntervals& intervals) {
  const std::vector<Interval>& ci = intervals.ci;
  std::printf("%s %s %s %s\n%10s %12s %25s %9s\n", c.log.c_str(), c.axis.c_str(), to_text(c.type).c_str(),
              to_text(c.estimator).c_str(), "tau_s", (std::string("dp_") + axis_unit(c.axis)).c_str(), "95 %",
              "windows");
  const size_t step = std::max<size_t>(1, c.tau_s.size() / 24);
  for (size_t i = 0; i < c.tau_s.size(); i += step)
    std::printf("%10g %12s %12s %12s %9ld\n", c.tau_s[i], digits_of(c.dp_dph[i], ci[i]).c_str(),
                digits_of(ci[i].lo, ci[i]).c_str(), digits_of(ci[i].hi, ci[i]).c_str(), c.n[i]);
  const auto few = std::find(intervals.blocks.begin(), intervals.blocks.end(), 0);
  if (few != intervals.blocks.end())
    say(stdout,
        format("95 %%: from %g s on fewer than %ld blocks fit into the record: %s is assumed (known better: "
               "--ci-model)\n",
               c.tau_s[static_cast<size_t>(few - intervals.blocks.begin())], kFewestBlocks, assumed_noise(c.type)));
}

// What the options name, read, and the result as it grows.
struct Session {
  const Options& o;
  Detrend detrend;
  std::optional<ErrorModel> nominal, ci_model;
  Json json = {{"curves", Json::array()}, {"ratios", Json::array()}, {"quantization", Json::array()}};
  std::vector<DpCurve> first_estimator = {};

  // Every model is of the sensor that the axis is of.
  void check_units(const std::string& axis) const {
    if (nominal) check_unit(*nominal, o.nominal, axis);
    if (ci_model) check_unit(*ci_model, o.ci_model, axis);
  }
  std::vector<NoiseComponent> components(double dt_s) const {
    return ci_model ? noise_components(*ci_model, dt_s) : std::vector<NoiseComponent>();
  }
};

// Curves of one log in bounded memory: once through for lengths and means, once for the curves.
void stream_log(const Session& session, const std::string& log,
                const std::function<void(const DpCurve&, const DpOperator&)>& done) {
  const Options& o = session.o;
  std::vector<double> sum, base;
  std::vector<long> count;
  std::vector<char> varies;
  long size = 0;
  const SeriesHeader header = scan_series(
      log, o.axes,
      [&](const SeriesHeader& h) {
        sum.assign(h.axes.size(), 0), base.assign(h.axes.size(), NAN), count.assign(h.axes.size(), 0),
            varies.assign(h.axes.size(), 0);
      },
      [&](size_t a, double rate, double, bool) {
        size += a == 0;
        if (std::isnan(rate)) return;
        if (count[a]++ == 0) base[a] = rate;
        sum[a] += rate - base[a];
        varies[a] = varies[a] || rate != base[a];
      });
  DpOperator op = make_dp_operator(dp_type_from_text(o.type), header.dt_s, session.nominal, o.estimation_s);
  op.min_fill = o.min_fill;
  const auto tau_s = parse_tau(o.tau, header.dt_s, std::max(header.dt_s, static_cast<double>(size) * header.dt_s / 10));
  std::vector<long> n;
  for (double t : tau_s) n.push_back(std::lround(t / header.dt_s));
  for (size_t a = 0; a < header.axes.size(); ++a) {
    session.check_units(header.axes[a]);
    if (!varies[a])
      throw data_error(log + ": axis " + header.axes[a] + " is constant: nothing to analyse (is the sensor alive?)");
    base[a] = session.detrend.kind == Detrend::Kind::kMean ? base[a] + sum[a] / static_cast<double>(count[a]) : 0;
  }
  if (n.back() + op.history_n(n.back()) > size)
    throw data_error(log + ": tau " + std::to_string(tau_s.back()) + " s is beyond the record of " +
                     std::to_string(size) + " samples");
  std::vector<DpStream> streams(header.axes.size(), DpStream(op, n));
  scan_series(
      log, o.axes, [](const SeriesHeader&) {},
      [&](size_t a, double rate, double, bool) { streams[a].push(rate - base[a]); });
  for (size_t a = 0; a < streams.size(); ++a) {
    DpCurve c;
    c.log = log, c.axis = header.axes[a], c.type = op.type, c.tau_s = tau_s;
    c.moments = streams[a].finish();
    for (const auto& m : c.moments) {
      if (m.n_windows() == 0)
        throw data_error(log + ": axis " + c.axis + ": no window free of missing samples at some tau; see --min-fill");
      c.dp_dph.push_back(std::sqrt(0.5 * m.mean_square())), c.n.push_back(m.n_windows());
    }
    done(c, op);
  }
}

Session make_session(const Options& o) {
  Session session{o, Detrend::parse(o.detrend), {}, {}};
  if (!o.nominal.empty()) session.nominal = read_model(o.nominal);
  if (!o.ci_model.empty()) session.ci_model = read_model(o.ci_model);
  if (o.stream && (session.detrend.order > 0 || o.estimators != std::vector<std::string>{"rms"}))
    throw usage_error("--stream gives rms curves with --detrend none or mean only");
  if (o.stream && std::count(o.logs.begin(), o.logs.end(), "-") > 0)
    throw usage_error(
        "--stream reads a log twice, and standard input is gone then: name a file, or leave --stream out");
  return session;
}

void add_curve(const DpCurve& c, const CurveIntervals& ci, Session* session) {
  session->json["curves"].push_back(curve_json(c, ci));
  if (c.estimator == dp_estimator_from_text(session->o.estimators[0])) session->first_estimator.push_back(c);
  if (session->o.common.talks()) print_curve(c, ci);
}

// Says so where the values of a log are multiples of a quantum.
void add_quantization(const DpCurve& c, double quantum, Session* session) {
  if (!(quantum > 0)) return;
  const double sigma_dph = quantum / std::sqrt(12.0);
  session->json["quantization"].push_back(
      {{"log", c.log}, {"axis", c.axis}, {"lsb_dph", quantum}, {"sigma_dph", sigma_dph}, {"unit", axis_unit(c.axis)}});
  if (session->o.common.talks())
    tell("%s %s: values are multiples of %.4g %s: rounding adds %.3g %s of white noise per sample\n", c.log.c_str(),
         c.axis.c_str(), quantum, axis_unit(c.axis), sigma_dph, axis_unit(c.axis));
}

// Degrees of freedom at each tau: of the model for the intervals, else of white noise.
std::vector<double> dof_of(const DpCurve& c, const DpOperator& op, std::vector<NoiseComponent> components) {
  if (components.empty()) components = {white_component(1)};
  std::vector<double> dof;
  for (size_t i = 0; i < c.tau_s.size(); ++i)
    dof.push_back(model_dof(components, op, std::lround(c.tau_s[i] / op.dt_s), c.n[i]));
  return dof;
}

void add_ratios(const DpRatios& r, Session* session) {
  session->json["ratios"].push_back(ratios_json(r));
  if (session->o.common.talks()) say(stdout, "distribution: " + r.verdict + ": " + r.statement + "\n\n");
}

// What is found of one axis.
struct AxisResult {
  double quantum_dph = 0;
  std::vector<DpCurve> curves; // one for each estimator
  std::vector<CurveIntervals> intervals;
  std::optional<DpRatios> ratios;
};

// Curves by each estimator and ratios of one axis of one log.
AxisResult analyse(Series s, const std::vector<double>& temp_degc, const Session& session) {
  const Options& o = session.o;
  DpOperator op = make_dp_operator(dp_type_from_text(o.type), s.dt_s, session.nominal, o.estimation_s);
  op.min_fill = o.min_fill;
  const double usable_s = static_cast<double>(s.size()) * s.dt_s;
  const auto tau_s = parse_tau(o.tau, s.dt_s, std::max(s.dt_s, usable_s / 10));
  AxisResult out;
  out.quantum_dph = quantum_dph(s);
  remove_trend(session.detrend, &s);
  const DpRecord record(s, op);
  const std::vector<NoiseComponent> components = session.components(s.dt_s);
  for (const std::string& estimator : o.estimators) {
    out.curves.push_back(dp_curve(s, record, tau_s, dp_estimator_from_text(estimator)));
    out.intervals.push_back(curve_intervals(out.curves.back(), op, components));
  }
  if (o.no_ratios) return out;
  const DpCurve& last = out.curves.back();
  out.ratios = dp_ratios(s, s.temp_degc.empty() ? temp_degc : s.temp_degc, record, last, dof_of(last, op, components),
                         o.false_alarm_rate);
  return out;
}

// The temperatures of the axes where they are the same and nothing is detrended by them: one copy instead of one for each
// axis, a third of the memory.  Empty where every axis keeps its own.
std::vector<double> shared_temperature(const Detrend& detrend, std::vector<Series>* axes) {
  if (detrend.kind == Detrend::Kind::kPolyTemperature) return {};
  const std::vector<double>& first = axes->front().temp_degc;
  if (first.empty()) return {};
  for (const Series& s : *axes) // bits: a missing temperature is not a number
    if (s.temp_degc.size() != first.size() ||
        std::memcmp(s.temp_degc.data(), first.data(), first.size() * sizeof first[0]) != 0)
      return {};
  std::vector<double> shared = std::move(axes->front().temp_degc);
  for (Series& s : *axes) s.temp_degc = std::vector<double>();
  return shared;
}

void note_twins(const std::vector<Series>& axes) {
  for (size_t i = 0; i < axes.size(); ++i)
    for (size_t j = 0; j < i; ++j)
      if (axes[i].axis != axes[j].axis && same_values(axes[i].rate_dph, axes[j].rate_dph))
        notice(twin_axes_text(axes[i].log, axes[j].axis, axes[i].axis));
}

// The axes of one log, side by side; told in their order.
void analyse_log(const std::string& log, Session* session) {
  std::vector<Series> axes = load_series(log, session->o.axes, true);
  for (const Series& s : axes) session->check_units(s.axis);
  note_twins(axes);
  const std::vector<double> temp_degc = shared_temperature(session->detrend, &axes);
  std::vector<AxisResult> results(axes.size());
  parallel_for(static_cast<long>(axes.size()), session->o.common.thread_count(), [&](long a) {
    const auto i = static_cast<size_t>(a);
    results[i] = analyse(std::move(axes[i]), temp_degc, *session);
  });
  for (const AxisResult& r : results) {
    add_quantization(r.curves.front(), r.quantum_dph, session);
    for (size_t e = 0; e < r.curves.size(); ++e) add_curve(r.curves[e], r.intervals[e], session);
    if (r.ratios) add_ratios(*r.ratios, session);
  }
}

Exit run(const Options& o) {
  Session session = make_session(o);
  for (const std::string& log : o.logs) {
    if (o.stream) {
      stream_log(session, log, [&](const DpCurve& c, const DpOperator& op) {
        add_curve(c, curve_intervals(c, op, session.components(op.dt_s)), &session);
      });
      continue;
    }
    analyse_log(log, &session);
  }
  Json& json = session.json;
  json["across"] = across_json(session.first_estimator);
  json["ci_method"] = session.ci_model ? std::string("model")
                                       : "blocks (ci_blocks; where 0, fewer than " + std::to_string(kFewestBlocks) +
                                             ": " + assumed_noise(dp_type_from_text(o.type)) + ")";
  json["detrend"] = session.detrend.text();
  json["false_alarm_rate"] = o.false_alarm_rate;
  if (o.common.wants_json()) write_json(o.common.json_path, json);
  return Exit::kDone;
}

} // namespace

int main(int argc, char** argv) {
  Options o;
  cli::App app("Allan deviation and Direct Predictor of logs: curves, intervals, distribution ratios", "dp");
  app.add_option("logs", o.logs, "logs (CSV)")->required()->type_name("LOG");
  app.add_option("--type", o.type, "av, dp1, dp2 or dp3; default dp2 with --nominal, else av, the Allan deviation");
  app.add_option("--axis", o.axes, "axis (column name), repeatable; default all")
      ->type_name("NAME")
      ->allow_extra_args(false);
  app.add_option(
      "--tau", o.tau,
      "FIRST:LAST[:STEP], log:FIRST:LAST[:PER_DECADE], octave or a list; default log to a tenth of the record");
  app.add_option("--estimator", o.estimators, "rms, max or p95, repeatable")
      ->capture_default_str()
      ->allow_extra_args(false);
  app.add_option("--nominal", o.nominal, "model whose filter predicts (dp2, dp3)")->type_name("MODEL.json");
  app.add_option("--estimation-s", o.estimation_s, "estimation time of dp1")->capture_default_str();
  app.add_option("--detrend", o.detrend, "none, mean, poly:N (in temperature) or time:N")->capture_default_str();
  app.add_option("--min-fill", o.min_fill,
                 "part of a window's samples that must be present; below 1, windows may miss some")
      ->check(cli::Range(0.01, 1.0))
      ->capture_default_str();
  app.add_option("--ci-model", o.ci_model,
                 "model for the confidence intervals; default: blocks of the data; where fewer than 8 fit, the nominal "
                 "model (dp2, dp3) or the wider of white noise and random walk (av, dp1)")
      ->type_name("MODEL.json");
  app.add_option("--false-alarm-rate", o.false_alarm_rate, "of the distribution's verdict")
      ->check(cli::Range(1e-9, 0.5))
      ->capture_default_str();
  app.add_flag("--stream", o.stream,
               "read the log twice instead of holding it: memory bounded by the longest tau; rms curves only");
  app.add_flag("--no-ratios", o.no_ratios, "curves only");
  add_common_options(&app, &o.common, kWithThreads);
  return run_program(&app, argc, argv, [&] {
    // DP2 where a nominal model predicts, else the Allan deviation, which needs none.
    if (o.type.empty()) o.type = o.nominal.empty() ? "av" : "dp2";
    return run(o);
  });
}
