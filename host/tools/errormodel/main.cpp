// SPDX-License-Identifier: MIT
// errormodel: closed-form curves, fits from logs, checks of bounds, and studies of the methods themselves.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "analysis/dp/tau_grid.h"
#include "analysis/errormodel/sanity.h"
#include "analysis/errormodel/study.h"
#include "base/axis_unit.h"
#include "base/digits.h"
#include "base/error.h"
#include "base/format.h"
#include "base/suggest.h"
#include "base/units.h"
#include "cli/program.h"
#include "cli/text.h"
#include "errormodel/trend.h"
#include "io/log.h"

using namespace imucal;

namespace {

constexpr size_t kMostRows = 30; // of a curve on a terminal

struct Options {
  CommonOptions common;
  std::vector<std::string> logs, axes, types, accept;
  std::string model, versus, nominal, type, tau, detrend, criterion = "bound", across = "rms", output;
  double estimation_s = 20, duration_s = 0, dt_s = 1, confidence = 0;
  int markov = -1, bootstrap = 40, runs = 5, draws = 200;
};

// Models that meet in one figure are of one sensor; one that does not state its unit is taken for what it meets.
void require_unit(const ErrorModel& model, const std::string& path, const std::string& unit) {
  if (!model.unit.empty() && model.unit != unit)
    throw data_error(path + ": a model in " + model.unit + ", what it is compared with is in " + unit +
                     ": give models of one sensor");
}

// DP2 with a nominal model, else the Allan deviation: which needs none.  unit: of what is predicted.
DpOperator operator_of(const Options& o, double dt_s, const std::string& unit, const std::string& type = "") {
  std::optional<ErrorModel> nominal;
  if (!o.nominal.empty()) nominal = read_model(o.nominal);
  if (nominal) require_unit(*nominal, o.nominal, unit);
  const std::string wanted = !type.empty() ? type : !o.type.empty() ? o.type : nominal ? "dp2" : "av";
  return make_dp_operator(dp_type_from_text(wanted), dt_s, nominal, o.estimation_s);
}

// One record given twice, as it was read.
bool are_same(const Series& a, const Series& b) {
  return std::equal(a.rate_dph.begin(), a.rate_dph.end(), b.rate_dph.begin(), b.rate_dph.end(),
                    [](double x, double y) { return x == y || (std::isnan(x) && std::isnan(y)); });
}

// All logs and axes, detrended unless raw is wanted; one sampling time.
std::vector<Series> load_all(const Options& o, bool raw) {
  const Detrend detrend = Detrend::parse(o.detrend);
  std::vector<Series> all;
  for (const std::string& log : o.logs)
    for (Series& s : load_one_kind(log, o.axes, detrend.kind == Detrend::Kind::kPolyTemperature)) {
      if (!all.empty() && std::fabs(s.dt_s / all[0].dt_s - 1) > 1e-3)
        throw data_error(log + ": sampling time " + std::to_string(s.dt_s) + " s, but " + all[0].log + " has " +
                         std::to_string(all[0].dt_s) + " s: fit them apart");
      for (const Series& before : all)
        if (before.log == s.log && before.axis != s.axis && same_values(before.rate_dph, s.rate_dph))
          throw data_error(twin_axes_text(log, before.axis, s.axis));
      for (const Series& before : all)
        if (before.axis == s.axis && are_same(before, s))
          throw data_error(log + ": the same data as " + before.log +
                           ": the errors would be too small; give every log once");
      if (!raw) remove_trend(detrend, &s);
      all.push_back(std::move(s));
      if (std::string(axis_unit(all[0].axis)) != axis_unit(all.back().axis))
        throw data_error(log + ": axis " + all[0].axis + " is in " + axis_unit(all[0].axis) + ", axis " +
                         all.back().axis + " in " + axis_unit(all.back().axis) +
                         ": one model has one unit; choose axes with --axis");
    }
  return all;
}

// Default: from two samples to a tenth of the shortest record, 40 per decade.
std::vector<double> taus_for(const Options& o, const std::vector<Series>& all) {
  double shortest = 1e300;
  for (const Series& s : all) shortest = std::min(shortest, static_cast<double>(s.size()) * s.dt_s);
  const double dt_s = all[0].dt_s;
  char text[80];
  std::snprintf(text, sizeof text, "log:%.9g:%.9g:40", 2 * dt_s, std::max(3 * dt_s, shortest / 10));
  return parse_tau(o.tau.empty() ? text : o.tau, dt_s, shortest / 10);
}

Across across_of(const Options& o) {
  if (o.across == "rms") return Across::kRms;
  if (o.across == "max") return Across::kMax;
  throw usage_error("--across " + o.across + ": expected rms or max");
}

Json excess_json(const Excess& e) {
  return {{"worst", e.worst}, {"mean", e.mean}};
}

Json spread_json(const Spread& s) {
  return {{"mean", s.mean}, {"sd", s.sd}, {"q05", s.q05}, {"median", s.median}, {"q95", s.q95}};
}

Json number_or_null(double x) {
  return std::isfinite(x) ? Json(x) : Json();
}

std::vector<double> tau_of(const CurveData& d) {
  std::vector<double> out;
  for (long n : d.n) out.push_back(static_cast<double>(n) * d.op.dt_s);
  return out;
}

std::vector<double> dp_of(const std::vector<double>& square) {
  std::vector<double> out;
  for (double s : square) out.push_back(std::sqrt(0.5 * s));
  return out;
}

// An accelerometer's figures stand in the model's members as they are: mg for dph, and the 1-s mean's mg over 60 for
// deg/sqrt(h).  People read them in mg.
void print_model(const ErrorModel& m) {
  const bool accel = m.unit == "mg";
  tell("white noise %.4g %s\n", accel ? white_sigma_dph(m.arw_deg_rt_h) : m.arw_deg_rt_h,
       accel ? "mg/sqrt(Hz)" : "deg/sqrt(h)");
  for (const Markov& t : m.markov) tell("Markov      %.4g %s, %.4g s\n", t.sigma_dph, accel ? "mg" : "dph", t.tau_s);
  if (accel)
    tell("accelerometer: the model file says \"unit\": \"mg\"; its arw_deg_rt_h is this white noise over 60\n");
}

// The name of a parameter for people; JSON keeps the contract's.
std::string shown(const ParameterError& e, bool accel, double* factor) {
  *factor = accel && e.name == "arw_deg_rt_h" ? 60 : 1;
  if (!accel) return e.name;
  return e.name == "arw_deg_rt_h" ? "white_mg_rt_hz" : name_in_unit(e.name, "mg");
}

void finish(const Options& o, const Json& json) {
  if (o.common.wants_json()) write_json(o.common.json_path, json);
}

// Few rows, evenly over the logarithm of tau, where there are many; the JSON has all.
void print_curve(const DpOperator& op, const std::string& unit, const std::vector<double>& tau_s,
                 const std::vector<double>& dp) {
  tell("%10s %14s   (%s)\n", "tau_s", ("dp_" + unit).c_str(), to_text(op.type).c_str());
  double next_s = 0;
  for (size_t i = 0; i < tau_s.size(); ++i) {
    const bool is_last = i + 1 == tau_s.size();
    if (tau_s.size() > kMostRows && tau_s[i] < next_s && !is_last) continue;
    next_s = tau_s[i] * std::pow(tau_s.back() / tau_s.front(), 1.0 / static_cast<double>(kMostRows - 1));
    tell("%10g %14s\n", tau_s[i], in_digits(dp[i], 4).c_str());
  }
}

Exit expect(const Options& given) {
  Options o = given;
  if (o.detrend.empty()) o.detrend = "mean";
  const ErrorModel model = read_model(o.model);
  std::vector<Series> like;
  if (!o.logs.empty()) like = load_series(o.logs[0], o.axes, true);
  const DpOperator op = operator_of(o, like.empty() ? o.dt_s : like[0].dt_s, model.unit_or_dph());
  const Detrend detrend = Detrend::parse(o.detrend);
  const auto tau_s = parse_tau(o.tau.empty() ? "2:600" : o.tau, op.dt_s, 600);
  std::vector<double> dp;
  if (o.duration_s > 0) {
    if (detrend.kind == Detrend::Kind::kPolyTemperature && detrend.order > 0 && o.logs.empty())
      throw usage_error("--detrend " + o.detrend + " needs temperatures: give a log with --like");
    const auto n = static_cast<long>(std::lround(o.duration_s / o.dt_s));
    dp = expected_record_dp_dph(model, op, empty_record(n, o.dt_s), detrend, tau_s);
  } else if (!like.empty()) {
    dp = expected_record_dp_dph(model, op, like[0], detrend, tau_s);
  } else {
    dp = expected_dp_dph(model, op, tau_s);
  }
  if (o.common.talks()) print_curve(op, model.unit_or_dph(), tau_s, dp);
  finish(o, {{"type", to_text(op.type)},
             {"tau_s", tau_s},
             {"dp_dph", dp},
             {"unit", model.unit_or_dph()},
             {"record", o.duration_s > 0 || !o.logs.empty() ? Json{{"detrend", detrend.text()}} : Json()}});
  return Exit::kDone;
}

Json errors_json(const std::vector<ParameterError>& errors, Json* std_errors, Json* identifiable) {
  Json detail = Json::array();
  for (const ParameterError& e : errors) {
    (*std_errors)[e.name] = number_or_null(e.std_error);
    (*identifiable)[e.name] = {{"verdict", e.verdict}, {"reason", e.reason}};
    detail.push_back({{"name", e.name},
                      {"value", e.value},
                      {"std_error", number_or_null(e.std_error)},
                      {"ci95", {number_or_null(e.ci95_lo), number_or_null(e.ci95_hi)}},
                      {"vanished_frac", e.vanished_frac},
                      {"verdict", e.verdict},
                      {"reason", e.reason}});
  }
  return detail;
}

void check_fit_options(const Options& o) {
  if (o.criterion != "bound" && o.criterion != "ls" && o.criterion != "ml")
    throw usage_error("--criterion " + o.criterion + ": expected bound, ls or ml");
}

// The logs and the curve to fit.
struct FitInput {
  std::vector<Series> raw, detrended;
  DpOperator op;
  FitSettings settings;
  CurveData data;   // refers to `detrended`
  std::string unit; // of all of them
};

// A prediction that never fails is no noise: values that a program wrote over and over.
void refuse_repeating(const FitInput& in) {
  const double largest = *std::max_element(in.data.mean_square_dph2.begin(), in.data.mean_square_dph2.end());
  const auto exact = std::find_if(in.data.mean_square_dph2.begin(), in.data.mean_square_dph2.end(),
                                  [&](double square) { return !(square > 1e-24 * largest); });
  if (exact == in.data.mean_square_dph2.end()) return;
  const double tau_s = in.settings.tau_s[static_cast<size_t>(exact - in.data.mean_square_dph2.begin())];
  char text[160];
  std::snprintf(text, sizeof text,
                "the means over %g s never change: the values repeat themselves exactly, as no sensor's "
                "do; nothing to fit",
                tau_s);
  throw data_error(in.raw[0].log + ": axis " + in.raw[0].axis + ": " + text);
}

long longest_whole_stretch(const Series& s) {
  long longest = 0, here = 0;
  for (double rate : s.rate_dph) {
    here = std::isnan(rate) ? 0 : here + 1;
    longest = std::max(longest, here);
  }
  return longest;
}

// The likelihood takes every sample that is there and needs no curve: the curve ends where missing samples leave no whole
// window.
void end_curve_at_whole_windows(const std::vector<Series>& all, const DpOperator& op, std::vector<double>* tau_s) {
  long whole = all[0].size();
  for (const Series& s : all) whole = std::min(whole, longest_whole_stretch(s));
  const auto needs_more = [&](double tau) {
    const long n = std::lround(tau / op.dt_s);
    return op.history_n(n) + n > whole;
  };
  const auto end = std::find_if(tau_s->begin(), tau_s->end(), needs_more);
  if (end == tau_s->end() || end == tau_s->begin()) return;
  tau_s->erase(end, tau_s->end());
  warn("errormodel: samples are missing: the curve ends at %g s, beyond it no window is whole; the likelihood "
       "takes every sample that is there\n",
       tau_s->back());
}

FitInput read_fit_input(const Options& o) {
  FitInput in;
  in.raw = in.detrended = load_all(o, true);
  in.unit = axis_unit(in.raw[0].axis);
  const Detrend detrend = Detrend::parse(o.detrend);
  for (Series& s : in.detrended) remove_trend(detrend, &s);
  in.op = operator_of(o, in.detrended[0].dt_s, in.unit);
  in.settings = {o.criterion, o.markov, across_of(o), detrend, taus_for(o, in.detrended), o.confidence};
  if (o.criterion == "ml" && o.tau.empty()) end_curve_at_whole_windows(in.detrended, in.op, &in.settings.tau_s);
  in.data = make_curve_data(in.detrended, in.op, detrend, in.settings.tau_s, in.settings.across);
  refuse_repeating(in);
  in.data.basis = std::make_shared<CurveBasis>(in.data);
  return in;
}

void require_rules(const std::vector<std::string>& names) {
  const std::vector<std::string> rules = sanity_rules();
  for (const std::string& name : names)
    if (std::find(rules.begin(), rules.end(), name) == rules.end())
      throw usage_error("--accept " + name + ": there is no such rule" + did_you_mean(name, rules));
}

// What speaks against the data that are fitted.
struct Judgement {
  std::vector<SanityReason> reasons;
  std::vector<std::string> accept;

  bool accepts(const SanityReason& reason) const {
    return std::find(accept.begin(), accept.end(), reason.rule) != accept.end();
  }
  bool is_accepted() const {
    return std::all_of(reasons.begin(), reasons.end(), [&](const SanityReason& r) { return accepts(r); });
  }
};

// Temperatures of the series, which the fit may have read without.
void take_temperatures(const Options& o, std::vector<Series>* all) {
  size_t at = 0;
  for (const std::string& log : o.logs) {
    if (log == "-") return; // cannot be read twice
    for (Series& s : load_one_kind(log, o.axes, true)) {
      Series& into = (*all)[at++];
      if (into.temp_degc.empty()) into.temp_degc = std::move(s.temp_degc);
    }
  }
}

// Every axis by itself; told on standard error, also with --quiet: it may be the answer.
Judgement judge_data(const Options& o, const FitInput& in) {
  Judgement out{{}, o.accept};
  std::vector<Series> raw = in.raw;
  take_temperatures(o, &raw);
  for (size_t i = 0; i < raw.size(); ++i) {
    const Sanity sanity = sanity_of(raw[i], in.detrended[i]);
    const std::string place = printable(raw[i].log) + ": axis " + raw[i].axis + ": ";
    for (const SanityReason& r : sanity.reasons) {
      say(stderr,
          std::string("errormodel: ") + (out.accepts(r) ? "accepted: " : "") + place + r.rule + ": " + r.text + "\n");
      out.reasons.push_back(r);
    }
    if (!sanity.note.empty()) say(stderr, "errormodel: note: " + place + sanity.note + "\n");
  }
  if (!out.is_accepted())
    say(stderr,
        format("errormodel: not accepted%s: mend or cut the log, or choose axes with --axis; to insist: --accept "
               "RULE\n",
               o.output.empty() ? "" : ", as the model that is written says"));
  return out;
}

Json judgement_json(const Judgement& judgement) {
  Json reasons = Json::array();
  for (const SanityReason& r : judgement.reasons)
    reasons.push_back({{"log", r.log},
                       {"axis", r.axis},
                       {"rule", r.rule},
                       {"value", r.value},
                       {"limit", r.limit},
                       {"text", r.text},
                       {"accepted", judgement.accepts(r)}});
  return {{"accepted", judgement.is_accepted()}, {"reasons", reasons}};
}

// A model of data that are not accepted says so itself: the status is gone when somebody else reads it.
Json model_json(const ErrorModel& model, const Judgement& judgement) {
  Json json = to_json(model);
  std::string why;
  for (const SanityReason& r : judgement.reasons)
    if (!judgement.accepts(r)) why += (why.empty() ? "" : "; ") + r.axis + ": " + r.rule + ": " + r.text;
  if (!why.empty()) json["comment"] = "the data are not accepted: " + why;
  return json;
}

// What a criterion finds, and how well each number of Markov terms did.
struct Fitted {
  ErrorModel model;
  std::vector<ParameterError> errors;
  Json by_terms = Json::array(), grid;
  double log_likelihood = std::nan("");
};

Fitted fit_to_samples(const Options& o, const FitInput& in) {
  const MlFit ml = fit_maximum_likelihood(Likelihood(in.raw, in.settings.detrend), o.markov);
  Fitted out;
  out.model = ml.model;
  out.errors = likelihood_errors(ml);
  out.log_likelihood = ml.log_likelihood;
  for (size_t k = 0; k < ml.bic_by_terms.size(); ++k)
    out.by_terms.push_back(
        {{"markov", k}, {"log_likelihood", ml.log_likelihood_by_terms[k]}, {"bic", ml.bic_by_terms[k]}});
  return out;
}

// Ctrl-C ends the refits; what is known by then is told.
std::vector<ParameterError> errors_by_refits(const Options& o, const FitInput& in, const ErrorModel& model) {
  Progress progress("refits of simulated records", o.bootstrap, !o.common.talks());
  auto errors = bootstrap_errors(in.detrended, in.op, in.settings, model, o.bootstrap, o.common.seed,
                                 o.common.thread_count(), in.data.basis, [&](long done) {
                                   progress.update(static_cast<double>(done));
                                   return !interrupted();
                                 });
  progress.finish();
  if (errors.front().n_refits < o.bootstrap)
    warn("errormodel: ended after %ld of %d refits: the errors are of those\n", errors.front().n_refits, o.bootstrap);
  return errors;
}

Fitted fit_to_curve(const Options& o, const FitInput& in) {
  const CurveFit curve = o.criterion == "ls" ? fit_least_squares(in.data, o.markov)
                                             : fit_bound(raised_to_confidence(in.data, o.confidence), o.markov);
  Fitted out;
  out.model = curve.model;
  for (size_t k = 0; k < curve.objective_by_terms.size(); ++k)
    if (std::isfinite(curve.objective_by_terms[k]))
      out.by_terms.push_back(
          {{"markov", k}, {"objective", curve.objective_by_terms[k]}, {"mean_excess", curve.mean_excess_by_terms[k]}});
  if (o.criterion == "bound") out.grid = {{"objective", curve.grid_objective}, {"model", to_json(curve.grid_model)}};
  if (o.bootstrap > 0) out.errors = errors_by_refits(o, in, out.model);
  return out;
}

// The model's curve beside that of the data.
struct Comparison {
  std::vector<double> model_square_dph2;
  Excess excess;
  bool bounded() const { return excess.worst_ratio >= 1 - 1e-9; }
};

Comparison compare(const CurveData& data, const ErrorModel& model) {
  Comparison c;
  c.model_square_dph2 = (data.basis ? *data.basis : CurveBasis(data)).model(model);
  c.excess = excess_of(data, c.model_square_dph2);
  return c;
}

Json information_json(const CurveData& data, const ErrorModel& model) {
  Json json = Json::array();
  for (const Information& i : curve_information(data, model))
    json.push_back({{"parameter", i.parameter}, {"tau_s", {i.tau_lo_s, i.tau_hi_s}}, {"largest", i.largest}});
  return json;
}

long refits_of(const Fitted& fitted) {
  return fitted.errors.empty() ? 0 : fitted.errors.front().n_refits;
}

Json fit_json(const Options& o, const FitInput& in, const Fitted& fitted, const Comparison& c) {
  Json std_errors = Json::object(), identifiable = Json::object();
  const Json detail = errors_json(fitted.errors, &std_errors, &identifiable);
  Json json;
  if (!fitted.grid.is_null()) json["grid"] = fitted.grid;
  json.update(
      {{"model", to_json(fitted.model)},
       {"criterion", o.criterion},
       {"bounded", c.bounded()},
       {"excess", excess_json(c.excess)},
       {"worst_ratio", c.excess.worst_ratio},
       {"at_tau_s", c.excess.at_tau_s},
       {"active_tau_s", c.excess.active_tau_s},
       {"std_errors", std_errors},
       {"identifiable", identifiable},
       {"parameters", detail},
       {"error_method", o.criterion == "ml" ? "observed information"
                                            : "parametric bootstrap, " + std::to_string(refits_of(fitted)) + " refits"},
       {"log_likelihood", number_or_null(fitted.log_likelihood)},
       {"by_terms", fitted.by_terms},
       {"information", information_json(in.data, fitted.model)},
       {"type", to_text(in.op.type)},
       {"detrend", in.settings.detrend.text()},
       {"across", o.across},
       {"unit", in.unit},
       {"confidence", o.confidence},
       {"n_records", in.detrended.size()},
       {"tau_s", tau_of(in.data)},
       {"data_dp_dph", dp_of(in.data.mean_square_dph2)},
       {"model_dp_dph", dp_of(c.model_square_dph2)},
       {"seed", o.common.seed}});
  return json;
}

// How the model's curve lies to that of the logs.  Only a fit that was asked to bound it bounds it or does not.
std::string curve_text(const FitInput& in, const Comparison& c, bool was_asked_to_bound) {
  const std::vector<double> tau_s = tau_of(in.data);
  const std::string curve =
      format("the %s curve over %g ... %g s: ", to_text(in.op.type).c_str(), tau_s.front(), tau_s.back());
  if (!was_asked_to_bound)
    return format(
        "%sthe model is %.4g times the logs at least (at %g s), %.4g times at most, and %+.1f %% off on average\n",
        curve.c_str(), c.excess.worst_ratio, c.excess.at_tau_s, 1 + c.excess.worst, 100 * c.excess.mean);
  return (c.bounded() ? "bounds " : "does not bound ") + curve +
         format("excess %.2f %% at most, %.2f %% on average", 100 * c.excess.worst, 100 * c.excess.mean) +
         (c.bounded() ? "" : format("; smallest ratio %.4f at %g s", c.excess.worst_ratio, c.excess.at_tau_s)) + "\n";
}

void print_fit(const FitInput& in, const Fitted& fitted, const Comparison& c, bool was_asked_to_bound) {
  const std::string& axis = in.detrended.front().axis;
  print_model(fitted.model);
  say(stdout, curve_text(in, c, was_asked_to_bound));
  for (const ParameterError& e : fitted.errors) {
    double factor = 1;
    const std::string name = shown(e, is_accelerometer(axis), &factor);
    say(stdout,
        format("%-20s %-18s identifiable: %s (%s)\n", name.c_str(),
               with_error(factor * e.value, factor * e.std_error).c_str(), e.verdict.c_str(), e.reason.c_str()));
  }
}

Exit fit(const Options& given) {
  Options o = given;
  choose_detrend(o.logs, o.axes, &o.detrend);
  check_fit_options(o);
  require_rules(o.accept);
  const FitInput in = read_fit_input(o);
  const Judgement judgement = judge_data(o, in);
  Fitted fitted = o.criterion == "ml" ? fit_to_samples(o, in) : fit_to_curve(o, in);
  fitted.model.unit = in.unit == "dph" ? "" : in.unit; // a gyro's file stays as it always was
  judge_parameters(in.data.record_s, in.op.dt_s, &fitted.errors);
  const Comparison c = compare(in.data, fitted.model);
  Json json = fit_json(o, in, fitted, c);
  json["judgement"] = judgement_json(judgement);
  if (o.common.talks()) print_fit(in, fitted, c, o.criterion == "bound");
  if (!o.output.empty()) write_json(o.output, model_json(fitted.model, judgement));
  finish(o, json);
  return !judgement.is_accepted() || (o.criterion == "bound" && !c.bounded()) ? Exit::kNegative : Exit::kDone;
}

// The check of one log and axis alone.
Json check_json(const Series& s, const Comparison& c) {
  return {{"log", s.log},
          {"axis", s.axis},
          {"unit", axis_unit(s.axis)},
          {"bounded", c.bounded()},
          {"worst_ratio", c.excess.worst_ratio},
          {"at_tau_s", c.excess.at_tau_s},
          {"excess", excess_json(c.excess)}};
}

// Every tau at which the model is below the data.
Json fails_json(const CurveData& data, const Comparison& c) {
  const std::vector<double> tau_s = tau_of(data);
  Json fails = Json::array();
  for (size_t i = 0; i < data.n.size(); ++i) {
    const double ratio = std::sqrt(c.model_square_dph2[i] / data.mean_square_dph2[i]);
    if (ratio < 1 - 1e-9) fails.push_back({{"tau_s", tau_s[i]}, {"ratio", ratio}});
  }
  return fails;
}

Exit check(const Options& given) {
  Options o = given;
  choose_detrend(o.logs, o.axes, &o.detrend);
  const std::vector<Series> all = load_all(o, false);
  const ErrorModel model = read_model(o.model);
  check_unit(model, o.model, all[0].axis);
  const DpOperator op = operator_of(o, all[0].dt_s, axis_unit(all[0].axis));
  const Detrend detrend = Detrend::parse(o.detrend);
  const auto tau_s = taus_for(o, all);
  Json each = Json::array();
  for (const Series& s : all)
    each.push_back(check_json(s, compare(make_curve_data({s}, op, detrend, tau_s, Across::kRms), model)));
  const CurveData data = make_curve_data(all, op, detrend, tau_s, across_of(o));
  const Comparison c = compare(data, model);
  if (o.common.talks())
    tell("%s: smallest ratio of model to data %.4f at %g s; excess %.2f %% at most, %.2f %% on average\n",
         c.bounded() ? "bounded" : "not bounded", c.excess.worst_ratio, c.excess.at_tau_s, 100 * c.excess.worst,
         100 * c.excess.mean);
  finish(o, {{"bounded", c.bounded()},
             {"worst_ratio", c.excess.worst_ratio},
             {"at_tau_s", c.excess.at_tau_s},
             {"excess", excess_json(c.excess)},
             {"fails", fails_json(data, c)},
             {"type", to_text(op.type)},
             {"across", o.across},
             {"detrend", detrend.text()},
             {"unit", axis_unit(all[0].axis)},
             {"tau_s", tau_of(data)},
             {"data_dp_dph", dp_of(data.mean_square_dph2)},
             {"model_dp_dph", dp_of(c.model_square_dph2)},
             {"curves", each}});
  return c.bounded() ? Exit::kDone : Exit::kNegative;
}

std::vector<std::string> types_of(const Options& o) {
  return o.types.empty() ? std::vector<std::string>{"av", "dp2", "dp3"} : o.types;
}

Exit sensitivity(const Options& o) {
  const ErrorModel model = read_model(o.model), versus = read_model(o.versus);
  require_unit(versus, o.versus, model.unit_or_dph());
  const auto tau_s = parse_tau(o.tau.empty() ? "10:200" : o.tau, o.dt_s, 600);
  Json json = {{"tau_s", tau_s},
               {"sensitivity", Json::object()},
               {"model_dp_dph", Json::object()},
               {"versus_dp_dph", Json::object()}};
  for (const std::string& type : types_of(o)) {
    const DpOperator op = operator_of(o, o.dt_s, model.unit_or_dph(), type);
    const auto a = expected_dp_dph(model, op, tau_s), b = expected_dp_dph(versus, op, tau_s);
    std::vector<double> relative;
    double square = 0;
    for (size_t i = 0; i < a.size(); ++i) {
      relative.push_back(std::fabs(b[i] - a[i]) / a[i]);
      square += relative[i] * relative[i] / static_cast<double>(a.size());
    }
    json["sensitivity"][type] = relative;
    json["model_dp_dph"][type] = a;
    json["versus_dp_dph"][type] = b;
    json["rms"][type] = std::sqrt(square);
    if (o.common.talks()) {
      tell("%s (rms %.4f)\n", type.c_str(), std::sqrt(square));
      for (size_t i = 0; i < tau_s.size(); i += std::max<size_t>(1, tau_s.size() / 10))
        tell("%10g s %8.4f\n", tau_s[i], relative[i]);
    }
  }
  finish(o, json);
  return Exit::kDone;
}

Exit separate(const Options& o) {
  SeparationSettings s;
  s.model = read_model(o.model), s.versus = read_model(o.versus);
  require_unit(s.versus, o.versus, s.model.unit_or_dph());
  s.duration_s = o.duration_s > 0 ? o.duration_s : 6000;
  s.dt_s = o.dt_s, s.runs = o.runs, s.draws = o.draws, s.seed = o.common.seed, s.threads = o.common.thread_count();
  s.tau_s = parse_tau(o.tau.empty() ? "2:600" : o.tau, o.dt_s, 600);
  Json json = {{"seed", s.seed},   {"draws", s.draws},       {"runs", s.runs}, {"duration_s", s.duration_s},
               {"tau_s", s.tau_s}, {"types", Json::object()}};
  for (const std::string& type : types_of(o)) {
    const Separation r = separation(s, operator_of(o, o.dt_s, s.model.unit_or_dph(), type));
    json["types"][type] = {{"longest_s", r.longest_s},
                           {"spread", spread_json(r.spread)},
                           {"separated_frac", r.separated_frac},
                           {"model_curves", r.model_curves},
                           {"versus_curves", r.versus_curves}};
    if (o.common.talks())
      tell("%-4s longest separated stretch: mean %.1f s, sd %.1f, 5 %% %.0f, median %.0f, 95 %% %.0f (%d draws "
           "of %d+%d runs)\n",
           type.c_str(), r.spread.mean, r.spread.sd, r.spread.q05, r.spread.median, r.spread.q95, s.draws, s.runs,
           s.runs);
  }
  finish(o, json);
  return Exit::kDone;
}

Exit validate_fit(const Options& given) {
  Options o = given;
  if (o.detrend.empty()) o.detrend = "mean";
  ValidateSettings v;
  v.truth = read_model(o.model);
  v.duration_s = o.duration_s > 0 ? o.duration_s : 6000;
  v.dt_s = o.dt_s, v.runs = o.runs, v.seed = o.common.seed, v.threads = o.common.thread_count();
  v.fit = {o.criterion,
           o.markov,
           Across::kRms,
           Detrend::parse(o.detrend),
           parse_tau(o.tau.empty() ? "2:600" : o.tau, o.dt_s, 600),
           o.confidence};
  const DpOperator op = operator_of(o, o.dt_s, v.truth.unit_or_dph());
  const Validation r = validate(v, op);
  Json parameters = Json::array();
  for (size_t p = 0; p < r.names.size(); ++p)
    parameters.push_back({{"name", r.names[p]},
                          {"log_error", spread_json(r.parameters[p])},
                          {"rms_log_error", r.rms_log_error[p]},
                          {"coverage95", number_or_null(r.coverage[p])}});
  finish(o, {{"runs", r.runs},
             {"seed", v.seed},
             {"criterion", o.criterion},
             {"type", to_text(op.type)},
             {"duration_s", v.duration_s},
             {"bounded_frac", r.bounded_frac},
             {"bounds_truth_frac", r.bounds_truth_frac},
             {"bounds_new_frac", r.bounds_new_frac},
             {"new_worst_ratio", spread_json(r.new_worst_ratio)},
             {"excess_mean", spread_json(r.excess_mean)},
             {"excess_worst", spread_json(r.excess_worst)},
             {"objective_over_grid", spread_json(r.objective_over_grid)},
             {"fit_ms", spread_json(r.fit_ms)},
             {"terms_frac", r.terms_frac},
             {"parameters", parameters}});
  if (!o.common.talks()) return Exit::kDone;
  tell("%d tests of %g s, criterion %s, %s\n", r.runs, v.duration_s, o.criterion.c_str(), to_text(op.type).c_str());
  tell("bounds its own test %.1f %%, the truth's curve %.1f %%, a new test %.1f %% (smallest ratio: median "
       "%.3f, 5 %% %.3f)\n",
       100 * r.bounded_frac, 100 * r.bounds_truth_frac, 100 * r.bounds_new_frac, r.new_worst_ratio.median,
       r.new_worst_ratio.q05);
  tell("mean excess: median %.2f %% (5 ... 95 %%: %.2f ... %.2f); worst excess: median %.2f %% (%.2f ... %.2f)\n",
       100 * r.excess_mean.median, 100 * r.excess_mean.q05, 100 * r.excess_mean.q95, 100 * r.excess_worst.median,
       100 * r.excess_worst.q05, 100 * r.excess_worst.q95);
  tell("fit %.1f ms (median)\n", r.fit_ms.median);
  for (size_t p = 0; p < r.names.size(); ++p)
    tell("%-20s ln(estimate/truth): mean %+.3f, rms %.3f%s\n", r.names[p].c_str(), r.parameters[p].mean,
         r.rms_log_error[p],
         std::isfinite(r.coverage[p])
             ? (", 95 % interval covers " + std::to_string(100 * r.coverage[p]).substr(0, 5) + " %").c_str()
             : "");
  return Exit::kDone;
}

void add_operator_options(cli::App* app, Options* o) {
  app->add_option("--type", o->type, "av, dp1, dp2 or dp3; default dp2 with --nominal, else av");
  app->add_option("--nominal", o->nominal, "model whose filter predicts (dp2, dp3)")->type_name("MODEL.json");
  app->add_option("--estimation-s", o->estimation_s, "estimation time of dp1")->capture_default_str();
  app->add_option("--tau", o->tau, "FIRST:LAST[:STEP], log:FIRST:LAST[:PER_DECADE], octave:FIRST:LAST or a list");
}

void add_log_options(cli::App* app, Options* o) {
  app->add_option("logs", o->logs, "logs (CSV)")->required()->type_name("LOG");
  app->add_option("--axis", o->axes, "axis (column name), repeatable; default all gyros (all axes where there is none)")
      ->type_name("NAME")
      ->allow_extra_args(false);
  app->add_option("--detrend", o->detrend,
                  "none, mean, poly:N (in temperature) or time:N; expectations allow for it, ml marginalises it; "
                  "default mean, or poly:3 where the rate follows the temperature");
  app->add_option("--across", o->across, "several logs and axes: rms or max of their curves")->capture_default_str();
}

void add_model(cli::App* app, Options* o, bool positional) {
  app->add_option(positional ? "model" : "--model", o->model, "error model")->required()->type_name("MODEL.json");
}

void add_confidence(cli::App* app, Options* o) {
  app->add_option("--confidence", o->confidence,
                  "bound: of the data's upper limit at each tau, so that further tests are bounded too (0: bound the "
                  "data themselves)")
      ->check(cli::Range(0.0, 0.9999))
      ->capture_default_str();
}

void add_dt(cli::App* app, Options* o) {
  app->add_option("--dt-s", o->dt_s, "sampling time")->check(FinitePositive)->capture_default_str();
}

void add_expect(cli::App* app, Options* o) {
  add_model(app, o, true);
  add_operator_options(app, o);
  app->add_option("--duration-s", o->duration_s,
                  "expect a record of this length, detrended (needed for random walk and ramp under dp2, dp3)")
      ->check(FinitePositive);
  app->add_option("--like", o->logs, "expect a record like this log: its length, gaps and temperatures")
      ->type_name("LOG")
      ->expected(1);
  app->add_option("--axis", o->axes, "with --like: the axis whose gaps count; default the first")
      ->type_name("NAME")
      ->expected(1);
  app->add_option("--detrend", o->detrend, "with --duration-s or --like: none, mean (default), poly:N or time:N");
  add_dt(app, o);
  add_common_options(app, &o->common);
}

void add_fit(cli::App* app, Options* o) {
  add_log_options(app, o);
  add_operator_options(app, o);
  app->add_option("--criterion", o->criterion, "bound (tightest bound), ls (least squares) or ml (maximum likelihood)")
      ->capture_default_str();
  app->add_option("--markov", o->markov, "number of Markov terms; default: chosen")->check(cli::Range(0, 4));
  add_confidence(app, o);
  app->add_option("--bootstrap", o->bootstrap, "refits of simulated records for the errors of bound and ls (0: none)")
      ->check(cli::Range(0, 100000))
      ->capture_default_str();
  std::string rules;
  for (const std::string& rule : sanity_rules()) rules += (rules.empty() ? "" : ", ") + rule;
  app->add_option("--accept", o->accept, "make a model although this rule speaks against the data (repeat): " + rules)
      ->allow_extra_args(false)
      ->type_name("RULE");
  app->add_option("-o,--output", o->output, "model to write")->writes()->type_name("MODEL.json");
  add_common_options(app, &o->common, kWithSeed | kWithThreads);
}

void add_check(cli::App* app, Options* o) {
  add_log_options(app, o);
  add_model(app, o, false);
  add_operator_options(app, o);
  add_common_options(app, &o->common);
}

// The studies that compare two models.
void add_comparison(cli::App* app, Options* o) {
  add_model(app, o, false);
  app->add_option("--versus", o->versus, "the other model")->required()->type_name("MODEL.json");
  add_operator_options(app, o);
  app->add_option("--types", o->types, "operators to compare; default av dp2 dp3");
  add_dt(app, o);
}

void add_sensitivity(cli::App* app, Options* o) {
  add_comparison(app, o);
  add_common_options(app, &o->common);
}

void add_separation(cli::App* app, Options* o) {
  add_comparison(app, o);
  app->add_option("--duration-s", o->duration_s, "of a test; default 6000")->check(FinitePositive);
  app->add_option("--runs", o->runs, "tests of each model per draw")->check(cli::Range(1, 1000))->capture_default_str();
  app->add_option("--draws", o->draws, "draws")->check(cli::Range(1, 100000))->capture_default_str();
  add_common_options(app, &o->common, kWithSeed | kWithThreads);
}

void add_validate(cli::App* app, Options* o) {
  add_model(app, o, false);
  add_operator_options(app, o);
  add_dt(app, o);
  app->add_option("--duration-s", o->duration_s, "of a test; default 6000")->check(FinitePositive);
  app->add_option("--runs", o->runs, "tests")->check(cli::Range(1, 1000000))->capture_default_str();
  app->add_option("--criterion", o->criterion, "bound, ls or ml")->capture_default_str();
  app->add_option("--markov", o->markov, "number of Markov terms; default: chosen")->check(cli::Range(0, 4));
  app->add_option("--detrend", o->detrend, "none, mean (default) or time:N");
  add_confidence(app, o);
  add_common_options(app, &o->common, kWithSeed | kWithThreads);
}

struct Command {
  const char* name;
  const char* help;
  void (*add)(cli::App*, Options*);
  Exit (*run)(const Options&);
};

const Command kCommands[] = {
    {"expect", "closed-form curve of a model", add_expect, expect},
    {"fit", "error model from logs", add_fit, fit},
    {"check", "does a model bound these logs, and how tightly", add_check, check},
    {"sensitivity", "relative difference of the expected curves of two models, by operator", add_sensitivity,
     sensitivity},
    {"separation", "over what stretch of tau do simulated tests of two models stand apart", add_separation, separate},
    {"validate", "fits many simulated tests of a known model: bounds, errors, coverage", add_validate, validate_fit},
};

} // namespace

int main(int argc, char** argv) {
  Options o;
  cli::App app("Error models: expected curves, fits, checks, and what the methods can tell", "errormodel");
  app.require_subcommand(1);
  for (const Command& command : kCommands) command.add(app.add_subcommand(command.name, command.help), &o);
  return run_program(&app, argc, argv, [&] {
    const auto chosen = std::find_if(std::begin(kCommands), std::end(kCommands),
                                     [&](const Command& command) { return app.chosen() == command.name; });
    return chosen->run(o);
  });
}
