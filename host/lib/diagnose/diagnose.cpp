// SPDX-License-Identifier: MIT
#include "diagnose/diagnose.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <sstream>

#include "base/error.h"
#include "base/units.h"

namespace imucal {

namespace {

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

bool same_rows(const Log& a, const Log& b) {
  if (a.size() != b.size() || a.axes.empty() || b.axes.empty()) return false;
  for (size_t i = 0; i < a.size(); ++i) {
    const double x = a.axes[0].rate_dph[i], y = b.axes[0].rate_dph[i];
    if (x != y && !(std::isnan(x) && std::isnan(y))) return false;
  }
  return true;
}

std::string identity(const Log& log) {
  std::string out;
  for (const char* key : {"device", "serial"}) {
    const auto it = log.metadata.find(key);
    out += (it == log.metadata.end() ? std::string("?") : it->second) + "/";
  }
  return out;
}

void check_logs(const std::vector<Log>& logs, const std::vector<Log>& held_out, const ErrorModel& model,
                std::vector<std::string>* warnings) {
  for (size_t i = 0; i < logs.size(); ++i) {
    for (size_t j = i + 1; j < logs.size(); ++j)
      if (same_rows(logs[i], logs[j]))
        throw data_error(logs[j].path + ": the same data as " + logs[i].path + ": give every log once");
    for (const Log& log : held_out)
      if (same_rows(logs[i], log))
        throw data_error(log.path + ": held out, but the same data as " + logs[i].path +
                         ", which is fitted: take it out of --log or --holdout");
  }
  std::vector<const Log*> all;
  for (const Log& log : logs) all.push_back(&log);
  for (const Log& log : held_out) all.push_back(&log);
  for (const Log* log : all)
    if (identity(*log) != identity(*all.front())) {
      warnings->push_back(
          log->path + " and " + all.front()->path +
          " name different devices or serial numbers in their metadata: all logs of one call have to "
          "be runs of one device");
      break;
    }
  double longest = 0;
  for (const Markov& m : model.markov) longest = std::max(longest, m.tau_s);
  for (const Log* log : all)
    if (log->t_s.back() - log->t_s.front() < 3 * longest)
      warnings->push_back(log->path + " is shorter than three of the model's longest time constant (" +
                          std::to_string(std::lround(longest)) + " s): slow noise cannot be judged on it");
  for (const Log* log : all)
    if (std::fabs(log->dt_s() - 1) > 0.05)
      warnings->push_back(log->path + " has a row every " + std::to_string(log->dt_s()) +
                          " s, not every second: rates are taken as means over that step");
}

// White noise of the log from second differences, robustly: another order of magnitude than the model's is
// most often a mistaken unit.
void check_scale(const Campaign& campaign, const NoiseModel& noise, std::vector<std::string>* warnings) {
  std::vector<double> jumps;
  for (const CampaignRun& run : campaign.runs)
    for (size_t k = 1; k < run.n(); ++k)
      if (run.steps[k] == 1)
        jumps.push_back(std::fabs(run.input.rate_dph[static_cast<size_t>(run.used[k])] -
                                  run.input.rate_dph[static_cast<size_t>(run.used[k - 1])]));
  if (jumps.empty()) return;
  std::nth_element(jumps.begin(), jumps.begin() + static_cast<long>(jumps.size() / 2), jumps.end());
  const double sigma = jumps[jumps.size() / 2] / 0.954;
  if (sigma > 0 && (sigma > 100 * noise.white_sigma_dph || sigma < 0.01 * noise.white_sigma_dph)) {
    std::ostringstream text;
    text.precision(3);
    text << "axis " << campaign.axis << ": its noise from second to second is " << sigma
         << " dph, the model's " << noise.white_sigma_dph
         << " dph: are the units of the model (deg/sqrt(h), dph) and of the log's column right?";
    warnings->push_back(text.str());
  }
}

Hypothesis nominal_hypothesis(const ErrorModel& model) {
  Hypothesis h;
  h.base_noise.white_sigma_dph = white_sigma_dph(model.arw_deg_rt_h);
  h.base_noise.markov = model.markov;
  if (!(h.base_noise.white_sigma_dph > 0)) h.base_noise.white_sigma_dph = 1e-3;
  return h;
}

std::vector<bool> active_effects(const DiagnoseOptions& options) {
  const auto& library = effect_library();
  for (const auto& name : options.without) find_effect(name);
  for (const auto& name : options.only) find_effect(name);
  std::vector<bool> active(library.size(), true);
  for (size_t j = 0; j < library.size(); ++j) {
    const auto named = [&](const std::vector<std::string>& list) {
      return std::find(list.begin(), list.end(), library[j]->name()) != list.end();
    };
    if (!library[j]->estimator() || named(options.without)) active[j] = false;
    if (!options.only.empty() && !named(options.only)) active[j] = false;
  }
  return active;
}

std::vector<Log> read_all(const std::vector<std::string>& paths) {
  std::vector<Log> logs;
  for (const std::string& path : paths) logs.push_back(read_log(path));
  return logs;
}

std::vector<std::string> axes_of(const Log& log, const std::vector<std::string>& wanted) {
  if (!wanted.empty()) {
    for (const std::string& name : wanted) log.axis(name);
    return wanted;
  }
  std::vector<std::string> names;
  for (const LogAxis& axis : log.axes)
    if (axis.is_gyro) names.push_back(axis.name);
  if (names.empty())
    throw data_error(log.path +
                     ": no gyro axis (columns ending in _dph, _dps or _radps); the model is one of a gyro");
  return names;
}

std::vector<std::string> advise(const AxisResult& axis, const Campaign& campaign) {
  std::vector<std::string> out;
  std::string hidden, alike;
  for (const Detectability& d : axis.identifiability.effects)
    if (!d.is_notable) hidden += (hidden.empty() ? "" : ", ") + d.name;
  for (const auto& pair : axis.identifiability.indistinguishable)
    alike += (alike.empty() ? "" : "; ") + pair.first + " and " + pair.second;
  if (!hidden.empty())
    out.push_back(
        "These profiles would not show " + hidden +
        " of a size that matters: an answer without them is not an answer that they are absent. Run the "
        "advised profile (half of the runs mirrored, starting hot).");
  if (!alike.empty())
    out.push_back("Not distinguishable on these profiles: " + alike +
                  ". Reversals inside a run, two ramp rates and soaks "
                  "on the way tell thermal effects apart.");
  if (!campaign.has_temperature)
    out.push_back("No temperatures in the log: only effects that need none were looked for.");
  if (campaign.runs.size() == 1)
    out.push_back("One log only: what differs from run to run cannot be seen; record at least four runs.");
  else if (campaign.runs.size() < 4)
    out.push_back("Fewer than four runs: run_to_run changes can hardly be told from the other effects.");
  out.push_back(
      "Constant offsets (earth rate, attitude) are absorbed by the constant of each log and cannot be seen.");
  return out;
}

} // namespace

DiagnoseResult diagnose(const DiagnoseOptions& options) {
  DiagnoseResult out;
  const ErrorModel model = read_model(options.model_path);
  const std::vector<Log> logs = read_all(options.logs), held_out = read_all(options.held_out);
  check_logs(logs, held_out, model, &out.warnings);
  const std::vector<std::string> names = axes_of(logs.front(), options.axes);
  const std::vector<const Effect*>& library = effect_library();
  const std::vector<bool> active = active_effects(options);
  const Hypothesis nominal = nominal_hypothesis(model);

  Json axes = Json::array();
  out.model = model;
  size_t nulls_from_cache = 0;
  double calibration_s = 0;
  Calibration calibration;
  std::ostringstream text;
  for (const std::string& name : names) {
    AxisResult axis;
    axis.axis = name;
    Campaign campaign = make_campaign(logs, name, model);
    check_scale(campaign, nominal.base_noise, &out.warnings);
    const double calibrate_from = now_s();
    CalibrationOptions how;
    how.nulls = options.nulls;
    how.seed = options.seed;
    how.threads = options.threads;
    how.cache_folder = options.cache_folder;
    how.quiet = options.quiet;
    const Calibration* known = calibration.named.empty() ? nullptr : &calibration;
    calibration = calibrate(campaign, nominal, library, how, known);
    nulls_from_cache += calibration.from_cache;
    const double start = now_s();
    calibration_s += start - calibrate_from;
    const Thresholds thr = thresholds(calibration, active, options.false_alarm_rate, names.size());
    SelectOptions select;
    if (options.model_seconds > 0)
      select.noise_discount =
          1 / (1 + static_cast<double>(campaign.n()) * campaign.dt_s / options.model_seconds);
    axis.selection = select_effects(&campaign, nominal, library, active, calibration, thr, select);
    const Fit nominal_fit = fit_hypothesis(campaign, axis.selection.nominal);
    const Fit final_fit = fit_hypothesis(campaign, axis.selection.final);
    axis.where = locate(campaign, nominal_fit);
    Campaign unseen;
    if (!held_out.empty()) unseen = make_campaign(held_out, name, model);
    axis.gap = measure_gap(campaign, held_out.empty() ? nullptr : &unseen, axis.selection, options.seed);
    std::vector<double> beta;
    for (int i = 0; i < campaign.order; ++i)
      beta.push_back(nominal_fit.beta[static_cast<long>(campaign.runs.size()) + i]);
    axis.identifiability = identify(campaign, axis.selection.nominal, library, active, beta);
    axis.advice = advise(axis, campaign);
    axis.seconds = now_s() - start;
    axes.push_back(axis_json(axis, campaign, nominal_fit, final_fit));
    text << axis_text(axis, campaign);
    for (const SelectedEffect& effect : axis.selection.effects) {
      EffectSpec spec;
      spec.name = effect.term.effect->name();
      for (const Json& found : axes.back()["effects"])
        if (found["name"] == spec.name) spec.parameters = found["parameters"];
      if (names.size() > 1) spec.axis = name;
      out.model.effects.push_back(spec);
    }
  }
  for (const std::string& warning : out.warnings) text << "warning: " << warning << "\n";
  out.text = text.str();
  out.json = {{"imucal_diagnosis", 1},
              {"model", options.model_path},
              {"logs", options.logs},
              {"held_out_logs", options.held_out},
              {"false_alarm_rate", options.false_alarm_rate},
              {"seed", options.seed},
              {"calibration",
               {{"nulls", options.nulls},
                {"from_cache", nulls_from_cache == names.size()},
                {"seconds", calibration_s},
                {"key", calibration.key}}},
              {"warnings", out.warnings},
              {"axes", axes}};
  return out;
}

Json library_json() {
  Json list = Json::array();
  for (const Effect* effect : effect_library()) {
    Json parameters = Json::array();
    for (const EffectParameter& p : effect->parameters()) {
      Json entry = {{"name", p.name}, {"meaning", p.meaning}};
      if (p.kind == EffectParameter::kNumber) entry["min"] = p.lo, entry["max"] = p.hi;
      parameters.push_back(entry);
    }
    list.push_back({{"name", effect->name()},
                    {"description", effect->description()},
                    {"parameters", parameters},
                    {"can_be_diagnosed", effect->estimator() != nullptr}});
  }
  return {{"imucal_effects", 1}, {"effects", list}};
}

} // namespace imucal
