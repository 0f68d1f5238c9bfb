// SPDX-License-Identifier: MIT
#include "analysis/diagnose/diagnose.h"

#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <mutex>
#include <set>

#include "analysis/diagnose/believed.h"
#include "analysis/diagnose/checks.h"
#include "analysis/diagnose/evidence/shared.h"
#include "analysis/diagnose/logs/blocks.h"
#include "analysis/diagnose/logs/thermometer_noise.h"
#include "analysis/diagnose/logs/unlike.h"
#include "analysis/diagnose/search/null_draws.h"
#include "analysis/diagnose/stages/dp2.h"
#include "analysis/diagnose/where_told.h"
#include "analysis/diagnose/written_model.h"
#include "base/clock.h"
#include "base/error.h"
#include "base/parallel.h"
#include "base/units.h"
#include "io/kept_numbers.h"

namespace imucal {

namespace {

// What is known of the noise: a model, a line of a data sheet, or nothing.
NoiseBelief belief_of(const DiagnoseOptions& options, const ErrorModel& model, const std::string& axis) {
  NoiseBelief belief;
  belief.has_believed = !options.model_path.empty();
  belief.has_data_sheet = !belief.has_believed && (options.arw_deg_rt_h || options.instability);
  belief.model.white_sigma_dph = white_sigma_dph(options.arw_deg_rt_h.value_or(model.arw_deg_rt_h));
  belief.model.markov = model.markov;
  if (options.instability) belief.model.markov = {*options.instability};
  if (belief.has_believed && !(belief.model.white_sigma_dph > 0)) belief.model.white_sigma_dph = 1e-3;
  belief.model = known_noise(model, axis, belief.model);
  for (const EffectSpec& spec : model.effects) {
    const Effect& effect = find_effect(spec);
    const EffectEstimator* estimator = effect.estimator();
    if (!is_for(spec, axis) || !estimator || !estimator->is_repeatable()) continue;
    // The shape is what stands last among the numbers; what stands before are amplitudes.
    Theta shape = theta_of(effect, read_parameters(spec));
    const size_t n = estimator->shape_lo().size();
    shape.erase(shape.begin(), shape.end() - static_cast<long>(std::min(n, shape.size())));
    if (shape.size() == n) belief.known.push_back({estimator, shape});
  }
  return belief;
}

// Why an effect that the model holds stays in the rates.
std::string why_left(const EffectEstimator* estimator) {
  if (estimator && estimator->form() == Form::kStructural) return "what it did to the samples cannot be undone";
  if (estimator && estimator->form() == Form::kAxes)
    return "it is noise that axes share, and they are fitted one by one";
  return "it differs from run to run by chance";
}

// The column that an effect reads and a log lacks, which the simulator would make up; empty: all have it.
std::string missing_column(const Effect& effect, const Parameters& parameters, const Campaign& campaign) {
  for (const EffectParameter& p : effect.parameters()) {
    if (p.name != "channel") continue;
    const std::string column = parameters.text_or(p.name, "");
    for (const CampaignRun& run : campaign.runs)
      if (!run.input.auxiliary.count(column)) return column;
  }
  return "";
}

// Takes the deterministic effects that the model itself already holds out of the rates, by their own
// simulator. Returns those that cannot be taken out: name and reason.  The logs of the campaign count from `first_log` on: what a
// model holds of one log alone is of a fitted one, and held-out logs come behind these.
std::vector<std::pair<std::string, std::string>> take_out_known(const ErrorModel& model, const std::string& axis,
                                                                size_t first_log, Campaign* campaign) {
  std::vector<std::pair<std::string, std::string>> left;
  for (const EffectSpec& spec : model.effects) {
    if (!is_for(spec, axis)) continue;
    const Effect& effect = find_effect(spec);
    const EffectEstimator* estimator = effect.estimator();
    const bool is_mean = estimator && (estimator->form() == Form::kColumns || estimator->form() == Form::kSteps ||
                                       estimator->form() == Form::kTemperature);
    if (!is_mean) {
      if (!estimator || estimator->form() != Form::kNoise) left.push_back({spec.name, why_left(estimator)});
      continue;
    }
    const Parameters parameters = read_parameters(spec);
    if (const std::string column = missing_column(effect, parameters, *campaign); !column.empty()) {
      left.push_back({spec.name, "not every log has the column " + column});
      continue;
    }
    for (CampaignRun& run : campaign->runs) {
      RunInput& in = run.input;
      SimRun sim;
      sim.log = first_log + in.log;
      if (spec.log >= 0 && sim.log != static_cast<size_t>(spec.log)) continue;
      sim.model = &model;
      sim.start = StartState::kSettled; // what start states add is estimated beside it
      sim.bias = model.bias_or_none();
      for (double t : in.t_s) sim.t_s.push_back(time_in_log_s(run, t));
      sim.case_temp_degc = sim.gyro_temp_degc = sim.thermometer_degc = in.smooth_degc;
      sim.auxiliary = in.auxiliary;
      sim.rate_dph.assign(in.size(), 0.0);
      effect.simulate(SimStage::kTemperature, parameters, &sim, nullptr);
      effect.simulate(SimStage::kBias, parameters, &sim, nullptr);
      for (size_t i = 0; i < in.size(); ++i) {
        in.rate_dph[i] -= sim.rate_dph[i];
        if (estimator->form() == Form::kTemperature && campaign->has_temperature)
          in.tn[i] = in.normalised(sim.gyro_temp_degc[i]);
      }
    }
  }
  return left;
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

// Those asked for; else of one kind of sensor: what the model is of, gyros by default.
std::vector<std::string> axes_of(const Log& log, const std::vector<std::string>& wanted, const ErrorModel& model) {
  if (!wanted.empty()) {
    std::vector<std::string> names; // as the log has them: gx_dph where gx_dps is asked for
    std::set<std::string> seen;
    for (const std::string& name : wanted) {
      if (!seen.insert(log.axis(name).name).second)
        throw data_error(log.path + ": its axis " + name + " is asked for twice: name every axis once with --axis");
      names.push_back(log.axis(name).name);
    }
    return names;
  }
  std::vector<std::string> gyros, accels;
  for (const LogAxis& axis : log.axes) (axis.is_gyro ? gyros : accels).push_back(axis.name);
  const std::vector<std::string>& names = model.unit == "mg" || (gyros.empty() && model.unit.empty()) ? accels : gyros;
  if (names.empty())
    throw data_error(log.path + ": the model is one of " + (gyros.empty() ? "a gyro" : "an accelerometer") +
                     ", the log has no such axis; choose axes with --axis, or give another model");
  return names;
}

// All axes of a log that are of the same kind of sensor as this one.
std::vector<std::string> axes_like(const Log& log, const std::string& name) {
  std::vector<std::string> out;
  for (const LogAxis& axis : log.axes)
    if (axis.is_gyro == log.axis(name).is_gyro) out.push_back(axis.name);
  return out;
}

void make_folder(const std::string& folder) {
  for (size_t slash = 1; slash <= folder.size(); ++slash)
    if (slash == folder.size() || folder[slash] == '/') ::mkdir(folder.substr(0, slash).c_str(), 0777);
}

// Slow noise of a kind that is not believed, too little to be named, is in one device of ten: there chance may make a name ten times
// as often for the same rate over all devices.
constexpr double kInOtherNoise = 10;

// Gets the thresholds.  What draws of the fitted noise gain is kept by a hash of everything that they depend on.
struct Calibrated {
  Thresholds thresholds = {};
  bool is_cached = false;
};
Calibrated calibrate(SlowSearch* search, const DiagnoseOptions& options, double rate_per_axis, std::mutex* cache) {
  Calibrated out;
  const std::string key = search->null_key(options.nulls, options.seed);
  const std::string path = options.cache_folder.empty() ? "" : options.cache_folder + "/nulls-" + key + ".json";
  std::vector<double> gains;
  if (!path.empty()) {
    const std::lock_guard<std::mutex> lock(*cache);
    gains = read_kept_numbers(path, key).value_or(gains);
  }
  out.is_cached = gains.size() == options.nulls;
  if (!out.is_cached) {
    gains = search->null_gains(options.nulls, options.seed);
    try {
      const std::lock_guard<std::mutex> lock(*cache);
      if (!path.empty()) {
        make_folder(options.cache_folder);
        write_kept_numbers(path, key, gains);
      }
    } catch (const Error&) { // a cache that cannot be written is no reason to fail
    }
  }
  out.thresholds = {null_tail(gains, rate_per_axis, options.constants),
                    jump_threshold(rate_per_axis, options.constants)};
  return out;
}

// The effects of the model, taken out of an axis's fitted or held-out rates; what cannot be is told once.
void take_out_and_warn(const DiagnoseOptions& options, const ErrorModel& model, size_t first_log, Campaign* campaign,
                       AxisResult* axis) {
  for (const auto& [left, why] : take_out_known(model, axis->axis, first_log, campaign)) {
    const std::string text =
        options.model_path + ": its effect " + left + " is not taken out of axis " + axis->axis + ": " + why;
    if (std::find(axis->warnings.begin(), axis->warnings.end(), text) == axis->warnings.end())
      axis->warnings.push_back(text);
  }
}

// Slow noise bends the polynomial that is fitted beside it; nobody's table is fitted so.
Fit plain_fit(const Campaign& campaign, Hypothesis nominal) {
  NoiseModel white;
  white.white_sigma_dph = nominal.base_noise.white_sigma_dph;
  nominal.base_noise = white;
  return fit_hypothesis(campaign, nominal);
}

// The fitted logs of an axis.  What an engineer's slip made unlike the others is left out, and all settings are made anew.
Campaign fitted_campaign(const std::vector<Log>& logs, const std::string& name, const ErrorModel& model) {
  Campaign campaign = make_campaign(logs, name, model);
  std::vector<LeftOutLog> left_out;
  const std::vector<std::string> why = unlike_others(campaign);
  for (size_t r = 0; r < why.size(); ++r)
    if (!why[r].empty()) left_out.push_back({campaign.runs[r].input.log, why[r]});
  return left_out.empty() ? campaign : make_campaign(logs, name, model, left_out);
}

// What is odd with the readings of the thermometer.
void tell_readings(const Campaign& campaign, const std::vector<Log>& logs, std::vector<std::string>* warnings) {
  tell_impossible(campaign, logs, warnings);
  tell_stuck(campaign, logs, warnings);
  tell_frozen(campaign, logs, warnings);
}
// The noise of a thermometer that the gyro does not feel is nothing that the gyro does.
std::optional<ThermometerNoise> smooth_thermometer_noise(Campaign* campaign) {
  const std::optional<ThermometerNoise> noise = thermometer_noise(*campaign);
  if (noise) take_smoothed(noise->felt, campaign);
  return noise;
}

// The held-out logs of an axis; no runs: none can be used.  `thermometer`: what the fitted ones lack of its noise.
Campaign held_out_campaign(const ErrorModel& model, const std::vector<Log>& held_out,
                           const std::optional<ThermometerNoise>& thermometer, AxisResult* axis) {
  if (held_out.empty()) return {};
  Campaign unseen = make_campaign_like(axis->campaign, held_out, model);
  if (axis->campaign.has_temperature) require_temperature(unseen, held_out);
  drop_runs(unlike_those_of(axis->campaign, unseen), &unseen);
  if (thermometer) take_smoothed(thermometer->felt, &unseen);
  tell_readings(unseen, held_out, &axis->warnings);
  tell_beyond(axis->campaign, unseen, held_out, &axis->warnings);
  keep_common_columns({&axis->campaign, &unseen});
  return unseen;
}
// What is told beside the answer: the fits that are drawn, where the gap lies, what these profiles can show.
void add_pictures(const DiagnoseOptions& options, const std::vector<const Effect*>& library,
                  const std::vector<bool>& active, AxisResult* axis) {
  Selection& s = axis->study.selection;
  axis->nominal_fit = std::move(s.nominal_fit), axis->final_fit = std::move(s.final_fit);
  axis->plain_fit = plain_fit(axis->campaign, s.nominal);
  axis->where = where_told(*axis);
  axis->dp2 =
      compare_dp2(axis->campaign, s.nominal.noise(), s.final.noise(), axis->nominal_fit, axis->final_fit, options.seed);
  std::vector<double> beta;
  for (int i = 0; i < axis->campaign.order; ++i)
    beta.push_back(axis->nominal_fit.beta[static_cast<long>(axis->campaign.runs.size()) + i]);
  Hypothesis blocks = s.nominal;
  blocks.base_noise = block_equivalent(s.nominal.noise(), axis->study.data->campaign.dt_s);
  const Campaign& means = axis->study.data->campaign;
  axis->identifiability = identify(means, blocks, library, active, beta);
  if (means.has_temperature)
    axis->with_advised = identify(advised_campaign(means, kAdvisedRuns), blocks, library, active, beta);
}

// One axis from log to answer; `held_out` may be empty.
AxisResult diagnose_axis(const DiagnoseOptions& options, const ErrorModel& model, const std::vector<Log>& logs,
                         const std::vector<Log>& held_out, const std::string& name, double rate_per_axis,
                         std::mutex* cache) {
  const double start = now_s();
  AxisResult axis;
  axis.axis = name;
  model.require_unit_of(name);
  axis.campaign = fitted_campaign(logs, name, model);
  require_runs(axis.campaign, logs);
  keep_common_columns({&axis.campaign});
  check_rest(axis.campaign, &axis.warnings);
  check_steady(axis.campaign, &axis.warnings);
  tell_readings(axis.campaign, logs, &axis.warnings);
  const std::optional<ThermometerNoise> thermometer = smooth_thermometer_noise(&axis.campaign);
  if (thermometer && thermometer->is_notable()) tell_thermometer_noise(name, *thermometer, &axis.warnings);
  const NoiseBelief belief = belief_of(options, model, name);
  axis.is_believed = belief.has_believed;
  if (belief.has_believed) check_scale(axis.campaign, belief.model, &axis.warnings);
  Campaign unseen = held_out_campaign(model, held_out, thermometer, &axis);
  Campaign* held_out_runs = unseen.runs.empty() ? nullptr : &unseen;
  const std::vector<const Effect*>& library = effect_library();
  const std::vector<bool> active = active_effects(options);
  SelectOptions select;
  // What the recorder did shows in the rates as they are: less a known effect, a zero is no zero.
  select.structure = find_structure(&axis.campaign, held_out_runs, library, active);
  Record record(logs, held_out, name);
  record.leave_out(select.structure, axis.campaign, unseen);
  take_out_and_warn(options, model, 0, &axis.campaign, &axis);
  if (held_out_runs) take_out_and_warn(options, model, logs.size(), held_out_runs, &axis);
  select.constants = options.constants;
  select.calibrate = [&](SlowSearch* search) {
    const double from = now_s();
    const Calibrated found = calibrate(search, options, rate_per_axis, cache);
    axis.is_calibration_cached = found.is_cached;
    axis.calibration_s = now_s() - from;
    return found.thresholds;
  };
  select.threshold_under = [&](const SlowSearch& search, const SlowModel& noise) {
    return null_tail(search.gains_under(noise, options.nulls, options.seed), kInOtherNoise * rate_per_axis,
                     options.constants)
        .threshold_nats;
  };
  axis.study = study_axis(&axis.campaign, held_out_runs, belief, library, active, select);
  record.leave_out_rest(axis.campaign, unseen);
  axis.record = record.logs();
  tell_left_out(axis.campaign, logs, &axis);
  tell_held_out(unseen, held_out, &axis);
  if (belief.has_data_sheet && !axis.study.selection.cannot_judge)
    tell_data_sheet(name, belief.model, axis.study.selection.final.noise(), &axis.warnings);
  if (!axis.study.selection.cannot_judge) add_pictures(options, library, active, &axis);
  axis.seconds = now_s() - start - axis.calibration_s;
  return axis;
}

// What the noise of an axis has in common with another axis, named on that axis.  The size and the correlation of the
// additional noise can only be told apart where the axis's own white noise is believed: without, all of it is shared.
void name_shared(const Effect& effect, const SharedNoise& found, const AxisResult& other, double shared_nats,
                 AxisResult* axis) {
  Selection& s = axis->study.selection;
  const double white = s.nominal.noise().white_sigma_dph, fitted = s.fitted_noise.white_sigma_dph;
  const double shared = std::fabs(found.covariance_dph2);
  const double own = s.is_noise_retuned ? std::max(shared, fitted * fitted - white * white) : shared;
  SelectedEffect named;
  named.family = effect.family();
  named.term.effect = &effect, named.term.estimator = effect.estimator();
  named.term.fixed_parameters = effect.estimator()->values({{found.covariance_dph2 / own, std::sqrt(own)}, {}, {}, {}});
  named.gain_nats = found.gain_nats, named.evidence_nats = found.gain_nats - shared_nats;
  named.held_out_nats = std::nan(""), named.rms_dph = std::sqrt(shared);
  char text[200];
  std::snprintf(text, sizeof text, "noise shared with %s: measured correlation %.2g from second to second",
                other.axis.c_str(), found.correlation);
  named.statement = text;
  named.set = {evidence_for(effect, named.gain_nats, shared_nats)};
  s.effects.push_back(named);
  if (s.verdict == Verdict::kNoGap && !is_note(named, s.white_dph)) s.verdict = Verdict::kExplained;
}

// Every pair of axes; an axis names the partner that shares most with it.
void find_shared(const std::vector<bool>& active, double shared_nats, std::vector<AxisResult>* axes) {
  const Effect* effect = nullptr;
  const std::vector<const Effect*>& library = effect_library();
  for (size_t j = 0; j < library.size(); ++j)
    if (active[j] && library[j]->estimator()->form() == Form::kAxes) effect = library[j];
  if (!effect) return;
  const auto rest = [](const AxisResult& axis) {
    return AxisRest{&axis.campaign, &axis.final_fit, axis.study.selection.final.noise()};
  };
  std::vector<SharedNoise> strongest(axes->size());
  std::vector<size_t> partner(axes->size(), 0);
  for (size_t i = 0; i < axes->size(); ++i)
    for (size_t k = i + 1; k < axes->size(); ++k) {
      if (!is_judged((*axes)[i]) || !is_judged((*axes)[k])) continue;
      const SharedNoise found = shared_noise(rest((*axes)[i]), rest((*axes)[k]));
      if (found.gain_nats > strongest[i].gain_nats) strongest[i] = found, partner[i] = k;
      if (found.gain_nats > strongest[k].gain_nats) strongest[k] = found, partner[k] = i;
    }
  for (size_t i = 0; i < axes->size(); ++i)
    if (strongest[i].gain_nats > shared_nats)
      name_shared(*effect, strongest[i], (*axes)[partner[i]], shared_nats, &(*axes)[i]);
}

} // namespace

DiagnoseResult diagnose(const DiagnoseOptions& options) {
  ErrorModel model;
  if (!options.model_path.empty()) model = read_model(options.model_path);
  return diagnose_logs(options, model, read_all(options.logs), read_all(options.held_out));
}

DiagnoseResult diagnose_logs(const DiagnoseOptions& options, const ErrorModel& model, const std::vector<Log>& logs,
                             const std::vector<Log>& held_out) {
  DiagnoseResult out;
  out.has_model = !options.model_path.empty();
  check_logs(logs, held_out, model, &out.warnings);
  const std::vector<std::string> names = axes_of(logs.front(), options.axes, model);
  const double rate = 1 - std::pow(1 - options.false_alarm_rate, 1.0 / static_cast<double>(names.size()));
  out.model = model;
  if (const std::string note = model.note_of_unit(names.front()); !note.empty()) {
    out.model.unit = "mg";
    if (out.has_model) out.warnings.push_back(options.model_path + ": " + note);
  }
  out.axes.resize(names.size());
  std::mutex cache; // two axes may share a calibration
  parallel_for(static_cast<long>(names.size()), options.threads, [&](long i) {
    AxisResult& axis = out.axes[static_cast<size_t>(i)];
    const std::string& name = names[static_cast<size_t>(i)];
    try {
      require_own_channel(logs, names, name);
      axis = diagnose_axis(options, model, logs, held_out, name, rate, &cache);
    } catch (const Error& error) {
      axis = AxisResult();
      axis.axis = name, axis.refused = error.what();
      axis.study.selection.verdict = Verdict::kUnexplained;
      axis.record = Record(logs, held_out, name).logs();
    }
  });
  size_t n_refused = 0;
  std::string why;
  for (const AxisResult& axis : out.axes) {
    if (!axis.refused.empty()) why = axis.refused, ++n_refused;
    out.calibration_s += axis.calibration_s;
    for (const std::string& warning : axis.warnings)
      if (std::find(out.warnings.begin(), out.warnings.end(), warning) == out.warnings.end())
        out.warnings.push_back(warning);
  }
  if (n_refused == names.size()) throw data_error(why);
  find_shared(active_effects(options), options.constants.shared_nats, &out.axes);
  complete_model(axes_like(logs.front(), names.front()), &out);
  return out;
}

std::string default_cache_folder() {
  if (const char* xdg = std::getenv("XDG_CACHE_HOME"); xdg && *xdg) return std::string(xdg) + "/imucal";
  if (const char* home = std::getenv("HOME"); home && *home) return std::string(home) + "/.cache/imucal";
  return "";
}

} // namespace imucal
