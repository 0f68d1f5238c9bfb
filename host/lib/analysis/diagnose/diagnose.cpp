// SPDX-License-Identifier: MIT
#include "analysis/diagnose/diagnose.h"

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

bool is_for(const EffectSpec& spec, const std::string& axis) {
  return spec.axis.empty() || spec.axis == axis || spec.axis == axis.substr(0, axis.rfind('_'));
}

// Parameters in the order of the library, which is that of theta; the angle random walk as white noise of 1-s
// means.
Theta theta_of(const Effect& effect, const Parameters& parameters) {
  Theta theta;
  for (const EffectParameter& p : effect.parameters()) {
    if (p.is_optional || p.kind != EffectParameter::kNumber) continue;
    const double value = parameters.number(p.name);
    theta.push_back(p.name == "arw_deg_rt_h" ? white_sigma_dph(value) : value);
  }
  return theta;
}

// The noise with the effects that the model itself already holds.
NoiseModel known_noise(const ErrorModel& model, const std::string& axis, NoiseModel noise) {
  for (const EffectSpec& spec : model.effects) {
    const Effect& effect = find_effect(spec.name);
    if (is_for(spec, axis) && effect.estimator() && effect.estimator()->form() == Form::kNoise)
      noise = effect.estimator()->noise(noise, theta_of(effect, read_parameters(effect, spec.parameters)));
  }
  return noise;
}

// The state in which an effect that the model holds began this run is not known: takes what it adds out of
// the rates, by least squares beside a constant and the polynomial.
void take_out_start(const Effect& effect, const Parameters& parameters, int order, CampaignRun* run) {
  const EffectEstimator& estimator = *effect.estimator();
  Theta shape = theta_of(effect, parameters);
  if (estimator.form() == Form::kColumns) // coefficients come first
    shape.erase(shape.begin(),
                shape.begin() + static_cast<long>(std::min(shape.size(), estimator.n_columns())));
  const std::vector<Column> starts = estimator.start_columns(run->input, shape);
  if (starts.empty()) return;
  const long n = static_cast<long>(run->n()), n_starts = static_cast<long>(starts.size());
  Eigen::MatrixXd x(n, 1 + order + n_starts);
  x.col(0).setOnes();
  x.middleCols(1, order) = powers(*run, run->input.tn, order);
  x.rightCols(n_starts) = used_rows(*run, starts);
  const Eigen::VectorXd y = used_rows(*run, {run->input.rate_dph}).col(0);
  const Eigen::VectorXd size = x.colPivHouseholderQr().solve(y).tail(n_starts);
  for (size_t c = 0; c < starts.size(); ++c)
    for (size_t i = 0; i < run->input.size(); ++i)
      run->input.rate_dph[i] -= size[static_cast<long>(c)] * starts[c][i];
}

// Takes the deterministic effects that the model itself already holds out of the rates, by their own
// simulator. Returns the names of those that cannot be taken out: they differ from run to run by chance.
std::vector<std::string> take_out_known(const ErrorModel& model, const std::string& axis,
                                        Campaign* campaign) {
  std::vector<std::string> left;
  for (const EffectSpec& spec : model.effects) {
    if (!is_for(spec, axis)) continue;
    const Effect& effect = find_effect(spec.name);
    const EffectEstimator* estimator = effect.estimator();
    const bool is_mean =
        estimator && (estimator->form() == Form::kColumns || estimator->form() == Form::kSteps ||
                      estimator->form() == Form::kTemperature);
    if (!is_mean) {
      if (!estimator || estimator->form() != Form::kNoise) left.push_back(spec.name);
      continue;
    }
    const Parameters parameters = read_parameters(effect, spec.parameters);
    for (CampaignRun& run : campaign->runs) {
      RunInput& in = run.input;
      SimRun sim;
      sim.log = in.log;
      sim.model = &model;
      sim.start = StartState::kSettled;
      if (model.bias) sim.bias = *model.bias;
      for (double t : in.t_s) sim.t_s.push_back(t + run.start_s);
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
      take_out_start(effect, parameters, campaign->order, &run);
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
  const std::string hidden = axis.identifiability.not_detectable();
  std::string alike;
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

constexpr double kOwnShare = 0.75; // of the false-alarm rate: what the axes may use each for itself
constexpr double kSharedThreshold_nats = 2.5; // of an axis for a cause that the axes together have shown

struct AxisState {
  AxisResult result;
  Hypothesis nominal;
  Campaign campaign, whole; // as masked by structural effects; as read
  Thresholds thresholds;
  SelectOptions select;
};

bool is_repeatable(const Effect& effect) {
  return effect.estimator() && effect.estimator()->is_repeatable();
}

// A cause that acts on all axes alike may show only in their sum: the strongest such candidate is then looked
// for again on the axes that said nothing, with a threshold that takes its presence as given.
void name_shared_causes(std::vector<AxisState>* states, const std::vector<const Effect*>& library,
                        const std::vector<bool>& active, const Calibration& calibration, double rate) {
  const size_t n = states->size(), nulls = calibration.nulls;
  Calibration pooled = calibration;
  pooled.generic.assign(generic_names().size(), std::vector<double>(nulls, 0.0));
  std::vector<bool> repeatable = active;
  std::vector<double> gain(library.size(), 0.0);
  for (size_t j = 0; j < library.size(); ++j) {
    repeatable[j] = active[j] && is_repeatable(*library[j]);
    for (size_t i = 0; i < nulls; ++i) {
      double sum = 0; // different nulls for the axes: their noise is independent
      for (size_t a = 0; a < n; ++a) sum += calibration.named[j][(i + a * (nulls / n + 1)) % nulls];
      pooled.named[j][i] = sum;
    }
    for (const AxisState& state : *states)
      if (j < state.result.selection.first_scan.size())
        gain[j] += state.result.selection.first_scan[j].gain_nats;
  }
  const Thresholds thr = thresholds(pooled, repeatable, rate, 1);
  int best = -1;
  for (size_t j = 0; j < library.size(); ++j)
    if (repeatable[j] && gain[j] > thr.named[j] &&
        (best < 0 ||
         gain[j] - thr.named[j] > gain[static_cast<size_t>(best)] - thr.named[static_cast<size_t>(best)]))
      best = static_cast<int>(j);
  if (best < 0) return;
  const size_t b = static_cast<size_t>(best);
  for (AxisState& state : *states) {
    if (state.result.selection.verdict != Verdict::kNoGap) continue;
    if (state.result.selection.first_scan[b].gain_nats < kSharedThreshold_nats) continue;
    Thresholds lower = state.thresholds;
    lower.named[b] = kSharedThreshold_nats;
    state.campaign = state.whole;
    state.result.selection =
        select_effects(&state.campaign, state.nominal, library, active, calibration, lower, state.select);
    std::ostringstream note;
    note.precision(3);
    note << library[b]->name() << " is named here because the axes together show it (" << gain[b]
         << " nats, threshold " << thr.named[b] << ")";
    state.result.selection.notes.push_back(note.str());
  }
}

// Correlation of the innovations of two axes at the same seconds.
void name_common_mode(std::vector<AxisState>* states, const std::vector<const Effect*>& library,
                      const std::vector<bool>& active, double rate) {
  size_t place = library.size();
  for (size_t j = 0; j < library.size(); ++j)
    if (library[j]->estimator() && library[j]->estimator()->form() == Form::kAxes) place = j;
  if (place == library.size() || !active[place]) return;
  const size_t n = states->size();
  std::vector<Fit> fits;
  for (const AxisState& state : *states)
    fits.push_back(fit_hypothesis(state.campaign, state.result.selection.final));
  const double threshold = std::log(static_cast<double>(n * (n - 1) / 2) / rate);
  for (size_t a = 0; a < n; ++a) {
    double best_gain = 0, best_r = 0, sigma = 0;
    std::string other;
    for (size_t b = 0; b < n; ++b) {
      if (a == b) continue;
      double cross = 0, first = 0, second = 0, count = 0;
      for (size_t r = 0; r < fits[a].e.size(); ++r) {
        const CampaignRun &x = (*states)[a].campaign.runs[r], &y = (*states)[b].campaign.runs[r];
        for (size_t i = 0, k = 0; i < x.n() && k < y.n();) {
          if (x.used[i] < y.used[k])
            ++i;
          else if (x.used[i] > y.used[k])
            ++k;
          else {
            const double u = fits[a].e[r][static_cast<long>(i++)], v = fits[b].e[r][static_cast<long>(k++)];
            cross += u * v, first += u * u, second += v * v, count += 1;
          }
        }
      }
      const double correlation = cross / std::sqrt(std::max(1e-300, first * second)),
                   gain = 0.5 * correlation * correlation * count;
      if (gain > best_gain) {
        best_gain = gain, best_r = correlation, other = (*states)[b].result.axis;
        const double s1 = (*states)[a].result.selection.final.noise().white_sigma_dph;
        const double s2 = (*states)[b].result.selection.final.noise().white_sigma_dph;
        sigma = std::sqrt(std::fabs(correlation) * s1 * s2);
      }
    }
    if (best_gain <= threshold) continue;
    SelectedEffect effect;
    effect.term.effect = library[place];
    effect.term.estimator = library[place]->estimator();
    effect.term.fixed_parameters =
        effect.term.estimator->values({{best_r > 0 ? 1.0 : -1.0, sigma}, {}, {}, {}});
    effect.gain_nats = best_gain;
    effect.evidence_nats = best_gain - threshold;
    effect.p_value = rate * std::exp(-effect.evidence_nats);
    effect.set = {{library[place]->name(), best_gain, threshold, effect.evidence_nats, std::nan("")}};
    std::ostringstream note;
    note.precision(3);
    note << "innovations correlate with those of " << other << " by " << best_r
         << "; the held-out figures of single axes do not count this";
    effect.statement = note.str();
    Selection& selection = (*states)[a].result.selection;
    selection.effects.push_back(effect);
    selection.notes.push_back(note.str());
    if (selection.verdict == Verdict::kNoGap) selection.verdict = Verdict::kExplained;
  }
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
  const Hypothesis plain = nominal_hypothesis(model);

  Json axes = Json::array();
  out.model = model;
  size_t nulls_from_cache = 0;
  double calibration_s = 0;
  Calibration calibration;
  std::ostringstream text;
  // Several axes have two chances to be wrong: each for itself, and together.
  const double own_rate = names.size() > 1 ? kOwnShare * options.false_alarm_rate : options.false_alarm_rate;
  std::vector<AxisState> states;
  for (const std::string& name : names) {
    AxisState state;
    state.result.axis = name;
    state.campaign = make_campaign(logs, name, model);
    for (const std::string& left : take_out_known(model, name, &state.campaign))
      out.warnings.push_back(options.model_path + ": its effect " + left + " is not taken out of axis " +
                             name + ": it differs from run to run by chance");
    Hypothesis nominal = plain;
    nominal.base_noise = known_noise(model, name, plain.base_noise);
    state.nominal = nominal;
    check_scale(state.campaign, nominal.base_noise, &out.warnings);
    const double calibrate_from = now_s();
    CalibrationOptions how;
    how.nulls = options.nulls;
    how.seed = options.seed;
    how.threads = options.threads;
    how.cache_folder = options.cache_folder;
    how.quiet = options.quiet;
    const Calibration* known = calibration.named.empty() ? nullptr : &calibration;
    calibration = calibrate(state.campaign, nominal, library, how, known);
    nulls_from_cache += calibration.from_cache;
    const double start = now_s();
    calibration_s += start - calibrate_from;
    const Thresholds thr = thresholds(calibration, active, own_rate, names.size());
    SelectOptions select;
    if (options.model_seconds > 0)
      select.noise_discount =
          1 / (1 + static_cast<double>(state.campaign.n()) * state.campaign.dt_s / options.model_seconds);
    state.whole = state.campaign;
    state.result.selection =
        select_effects(&state.campaign, nominal, library, active, calibration, thr, select);
    state.thresholds = thr;
    state.select = select;
    state.result.seconds = now_s() - start;
    states.push_back(std::move(state));
  }
  if (names.size() > 1) {
    name_shared_causes(&states, library, active, calibration, options.false_alarm_rate * (1 - kOwnShare));
    name_common_mode(&states, library, active, options.false_alarm_rate * (1 - kOwnShare));
  }
  for (AxisState& state : states) {
    AxisResult& axis = state.result;
    Campaign& campaign = state.campaign;
    const std::string& name = axis.axis;
    const double start = now_s();
    const Fit nominal_fit = fit_hypothesis(campaign, axis.selection.nominal);
    const Fit final_fit = fit_hypothesis(campaign, axis.selection.final);
    axis.where = locate(campaign, nominal_fit);
    Campaign unseen;
    if (!held_out.empty()) {
      unseen = make_campaign(held_out, name, model);
      take_out_known(model, name, &unseen);
    }
    axis.gap = measure_gap(campaign, held_out.empty() ? nullptr : &unseen, axis.selection, options.seed);
    std::vector<double> beta;
    for (int i = 0; i < campaign.order; ++i)
      beta.push_back(nominal_fit.beta[static_cast<long>(campaign.runs.size()) + i]);
    axis.identifiability = identify(campaign, axis.selection.nominal, library, active, beta);
    axis.advice = advise(axis, campaign);
    axis.seconds += now_s() - start;
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
  // What the profiles cannot tell, once for all axes and on a line each.
  std::vector<std::string> said;
  for (const Json& axis : axes)
    for (const Json& advice : axis["advice"]) {
      const std::string sentence = advice.get<std::string>();
      if (sentence.rfind("Constant offsets", 0) == 0 ||
          std::find(said.begin(), said.end(), sentence) != said.end())
        continue;
      said.push_back(sentence);
      text << "advice    " << sentence << "\n";
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
              {"library", library_json()},
              {"axes", axes}};
  return out;
}

static Json properties_json(const EffectEstimator* e) {
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
    Json causes = Json::array();
    for (const HardwareCause& cause : effect->hardware_causes())
      causes.push_back({{"what", cause.what}, {"source", cause.source}});
    list.push_back({{"name", effect->name()},
                    {"label", effect->label()},
                    {"description", effect->description()},
                    {"family", family_name(effect->family())},
                    {"parameters", parameters},
                    {"hardware_causes", causes},
                    {"properties", properties_json(effect->estimator())},
                    {"can_be_diagnosed", effect->estimator() != nullptr}});
  }
  Json families = Json::array();
  for (Family family : all_families())
    families.push_back({{"name", family_name(family)}, {"label", family_label(family)}});
  return {{"imucal_effects", 1}, {"effects", list}, {"families", families}};
}

} // namespace imucal
