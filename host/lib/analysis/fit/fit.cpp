// SPDX-License-Identifier: MIT
#include "analysis/fit/fit.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "analysis/fit/expected.h"
#include "analysis/fit/judge.h"
#include "analysis/fit/parts.h"
#include "analysis/fit/residual_shape.h"
#include "base/digits.h"
#include "base/error.h"
#include "base/format.h"
#include "base/range.h"
#include "base/repeats.h"
#include "base/temperature_step.h"
#include "base/units.h"

namespace imucal {

namespace {

constexpr size_t kTemperatures = IMUCAL_TABLE_SIGMA_N;
constexpr size_t kStand_rows = 128; // as the core's rule on a thermometer that is stuck
constexpr double kUnused = std::numeric_limits<double>::quiet_NaN();

// By its name, or by its name without the unit where one axis alone has it: x_dph and x_mg are two sensors.
const LogAxis& find_axis(const Log& log, const std::string& name) {
  const LogAxis* of_stem = nullptr;
  size_t n_of_stem = 0;
  for (const LogAxis& axis : log.axes) {
    if (axis.name == name) return axis;
    if (axis_stem(axis.name) == name) of_stem = &axis, ++n_of_stem;
  }
  return n_of_stem == 1 ? *of_stem : log.axis(name); // throws with the list
}

// In the units inside.
std::string name_of(const LogAxis& axis) {
  return axis_stem(axis.name) + (axis.is_gyro ? "_dph" : "_mg");
}

std::vector<std::string> axes_of(const Log& log, const FitOptions& options) {
  if (!options.axes.empty()) return options.axes;
  const bool has_gyro = std::any_of(log.axes.begin(), log.axes.end(), [](const LogAxis& a) { return a.is_gyro; });
  const bool is_accel_only = options.model && options.model->unit == "mg";
  std::vector<std::string> names;
  for (const LogAxis& axis : log.axes)
    if (axis.is_gyro ? !is_accel_only : !has_gyro || is_accel_only || options.accel_model) names.push_back(axis.name);
  if (names.empty())
    throw data_error(log.path + ": no accelerometer (columns ending in _mg or _ms2), but the model is one (\"unit\": "
                                "\"mg\")");
  return names;
}

// A model of the other kind of sensor is refused; one that does not say is taken, and that is said.
void check_units(const FitOptions& options, const std::string& axis, FitResult* result) {
  const std::optional<ErrorModel>& model = options.model_of(axis);
  if (!model) return;
  model->require_unit_of(axis);
  const std::string note = model->note_of_unit(axis);
  if (!note.empty()) result->warnings.push_back(axis + ": " + note);
}

// Of each model that an axis has.
void note_merged(const std::vector<std::string>& axes, const Log& log, const FitOptions& options, FitResult* result) {
  for (const std::optional<ErrorModel>* model : {&options.model, &options.accel_model}) {
    const bool is_used = std::any_of(axes.begin(), axes.end(), [&](const std::string& axis) {
      return &options.model_of(name_of(find_axis(log, axis))) == model;
    });
    if (is_used && *model && (*model)->markov.size() > 1)
      result->warnings.push_back("the filter has one Markov state: the model's " +
                                 std::to_string((*model)->markov.size()) +
                                 " terms were merged into one of the same variance and low-frequency density");
  }
}

struct Span {
  double lo = std::numeric_limits<double>::infinity(), hi = -std::numeric_limits<double>::infinity();
  void take(double value) {
    if (!std::isfinite(value)) return;
    lo = std::min(lo, value);
    hi = std::max(hi, value);
  }
};

// The log's rows on a regular grid of its own steps.
FitRun grid_of(const Log& log, const LogAxis& axis, double dt_s) {
  FitRun run;
  for (size_t k = 0; k < log.size(); ++k) {
    const auto at = static_cast<size_t>(std::llround((log.t_s[k] - log.t_s[0]) / dt_s));
    run.rate_dph.resize(std::max(at + 1, run.rate_dph.size()), kUnused);
    run.temp_degc.resize(run.rate_dph.size(), kUnused);
    run.noise_ratio.resize(run.rate_dph.size(), 1.0F);
    run.has_row.resize(run.rate_dph.size(), false);
    run.flags.resize(run.rate_dph.size(), 0);
    run.has_row[at] = true;
    run.temp_degc[at] = log.temp_degc[k];
    if (!axis.flags.empty()) run.flags[at] = static_cast<uint32_t>(axis.flags[k]);
    if ((run.flags[at] & (kSaturated | kSensorFault)) != 0 || !std::isfinite(log.temp_degc[k])) continue;
    run.rate_dph[at] = axis.rate_dph[k];
    if (!axis.noise_ratio.empty()) run.noise_ratio[at] = axis.noise_ratio[k];
  }
  return run;
}

// Logs of two devices make no table.
void check_same_device(const std::vector<Log>& logs) {
  for (const char* key : {"device", "serial"})
    for (const Log& log : logs) {
      const auto first = logs[0].metadata.find(key), here = log.metadata.find(key);
      if (first == logs[0].metadata.end() || here == log.metadata.end() || first->second == here->second) continue;
      throw data_error(log.path + ": # " + key + " = " + here->second + ", but " + logs[0].path + " has " +
                       first->second +
                       ": logs of different devices make no table; fit them apart, or insist with --ignore-metadata");
    }
}

// A log that does not say whose it is, beside one that does, may be of another device.
void note_nameless(const std::vector<Log>& logs, FitResult* result) {
  for (const char* key : {"device", "serial"}) {
    const auto named =
        std::find_if(logs.begin(), logs.end(), [&](const Log& log) { return log.metadata.count(key) > 0; });
    if (named == logs.end()) continue;
    for (const Log& log : logs)
      if (log.metadata.count(key) == 0)
        result->warnings.push_back(log.path + ": no # " + key + " in its metadata, but " + named->path + " has " +
                                   named->metadata.at(key) + ": is it a log of the same device?");
  }
}

void check_logs(const std::vector<Log>& logs, bool ignore_metadata) {
  if (logs.empty()) throw usage_error("no log given");
  if (!ignore_metadata) check_same_device(logs);
  for (const Log& log : logs) {
    if (!log.has_temperature())
      throw data_error(log.path + ": column temp_degc is empty: a thermal calibration needs the temperature");
    if (std::abs(log.dt_s() / logs[0].dt_s() - 1) > 0.01)
      throw data_error(log.path + ": rows are " + std::to_string(log.dt_s()) + " s apart, those of " + logs[0].path +
                       " " + std::to_string(logs[0].dt_s()) + " s: decimate them to the same interval");
  }
  for (size_t i = 0; i < logs.size(); ++i)
    for (size_t j = 0; j < i; ++j) {
      if (same_rows(logs[i], logs[j]))
        throw data_error(logs[i].path + ": the same data as " + logs[j].path +
                         ": the predicted error would be too small; give every log once");
      if (const std::string text = shared_rows_text(logs[j], logs[i]); !text.empty()) throw data_error(text);
    }
}

// An axis has one place in a table, whatever it is called (gx, gx_dph) and in whatever units the log has it.
void require_different(const Log& log, const std::vector<std::string>& names) {
  for (size_t i = 0; i < names.size(); ++i)
    for (size_t j = 0; j < i; ++j)
      if (const std::string name = name_of(find_axis(log, names[i])); name == name_of(find_axis(log, names[j])))
        throw usage_error("axes " + names[j] + " and " + names[i] + " are one, " + name + ": name it once (--axis)");
}

void check_twins(const Log& log, const std::vector<std::string>& names) {
  for (size_t i = 0; i < names.size(); ++i)
    for (size_t j = 0; j < i; ++j) {
      const LogAxis &a = find_axis(log, names[j]), &b = find_axis(log, names[i]);
      if (a.name != b.name && same_values(a.rate_dph, b.rate_dph))
        throw data_error(twin_axes_text(log.path, a.name, b.name));
    }
}

// Normalisation of temperature: asked for, the model's, or the logs' own span.
void normalise(const FitOptions& options, const Span& seen, FitAxis* axis) {
  const std::optional<ErrorModel>& model = options.model_of(axis->axis);
  const bool from_model = model && model->bias;
  axis->t0_degc = options.t0_degc.value_or(from_model ? model->bias->t0_degc : (seen.lo + seen.hi) / 2);
  axis->range_degc = options.range_degc.value_or(from_model ? model->bias->range_degc : (seen.hi - seen.lo) / 2);
  if (options.range_degc && !(axis->range_degc > 0)) throw usage_error("the temperature range must be positive");
}

void judge_span(const std::string& path, const Span& seen, FitAxis* axis, FitResult* result) {
  if (!(seen.hi - seen.lo >= kMinSpanDegc)) {
    const double span = std::isfinite(seen.hi - seen.lo) ? std::max(0.0, seen.hi - seen.lo) : 0.0;
    throw data_error(path + ": the temperature never moves (" + std::to_string(span) +
                     " degC in all): a thermal calibration needs a profile that does");
  }
  const double lo = axis->t0_degc - axis->range_degc, hi = axis->t0_degc + axis->range_degc;
  axis->span_lo_degc = std::max(seen.lo, lo);
  axis->span_hi_degc = std::min(seen.hi, hi);
  if (!(axis->span_hi_degc - axis->span_lo_degc >= kMinSpanDegc))
    throw data_error(path + ": temperatures " + std::to_string(seen.lo) + ".." + std::to_string(seen.hi) +
                     " degC lie outside t0 +- range = " + std::to_string(lo) + ".." + std::to_string(hi) + " degC");
  if (seen.lo < lo - 0.1 || seen.hi > hi + 0.1)
    result->warnings.push_back(axis->axis +
                               ": temperatures reach beyond t0 +- range; the table is valid inside it only");
}

void take_fit(const ChebyshevFit& fit, FitAxis* axis) {
  const Eigen::MatrixXd to_power = power_from_chebyshev(axis->order);
  const Eigen::VectorXd b = to_power * fit.coeff;
  const Eigen::MatrixXd covariance = to_power * fit.covariance * to_power.transpose();
  axis->coeff_dph.assign(b.data(), b.data() + b.size());
  if (!fit.core_coeff.empty()) axis->coeff_dph = fit.core_coeff;
  axis->covariance_dph2.assign(covariance.data(), covariance.data() + covariance.size());
  axis->sigma_basis = fit.sigma_basis;
  axis->mean_nis = fit.mean_nis;
  axis->lag1 = fit.lag1;
  if (fit.constant.size() > 1)
    for (const double c : fit.constant) axis->turn_on_dph.push_back(c - fit.coeff[0]);
  for (size_t i = 0; i < kTemperatures; ++i) {
    const double part = static_cast<double>(i) / (kTemperatures - 1);
    const double temp = axis->span_lo_degc + part * (axis->span_hi_degc - axis->span_lo_degc);
    // In Chebyshev's polynomials: there the covariance has no large cancelling entries.
    const Eigen::VectorXd row = chebyshev_row(axis->order, (temp - axis->t0_degc) / axis->range_degc);
    axis->temp_degc.push_back(temp);
    axis->sigma_dph.push_back(std::sqrt(std::max(0.0, row.dot(fit.covariance * row))));
  }
}

// Rate less the polynomial and the run's constant; NaN where the rate is unused.
std::vector<std::vector<double>> residuals_of(const std::vector<FitRun>& runs, const FitAxis& axis) {
  std::vector<std::vector<double>> out(runs.size());
  for (size_t l = 0; l < runs.size(); ++l)
    for (size_t k = 0; k < runs[l].rate_dph.size(); ++k) {
      const double turn_on = axis.turn_on_dph.empty() ? 0.0 : axis.turn_on_dph[l];
      out[l].push_back(runs[l].rate_dph[k] - axis.bias_dph(runs[l].temp_degc[k]) - turn_on);
    }
  return out;
}

void take_residuals(const std::vector<FitRun>& runs, FitAxis* axis) {
  const std::vector<std::vector<double>> residual = residuals_of(runs, *axis);
  double sum = 0, n_lossy = 0;
  for (size_t l = 0; l < runs.size(); ++l)
    for (size_t k = 0; k < runs[l].rate_dph.size(); ++k) {
      if (!std::isfinite(runs[l].rate_dph[k])) {
        ++axis->n_missing;
        continue;
      }
      sum += residual[l][k] * residual[l][k];
      ++axis->n_used;
      n_lossy += (runs[l].flags[k] & kSamplesMissing) != 0;
    }
  if (axis->n_used == 0) return;
  axis->residual_rms_dph = std::sqrt(sum / static_cast<double>(axis->n_used));
  axis->lossy_frac = n_lossy / static_cast<double>(axis->n_used);
}

// One axis of every log; data_error where a log has nothing of it.
std::vector<FitRun> runs_of(const std::vector<Log>& logs, const std::string& name, const FitOptions& options,
                            double dt_s) {
  std::vector<FitRun> runs;
  size_t n_used = 0;
  for (const Log& log : logs) {
    runs.push_back(grid_of(log, find_axis(log, name), dt_s));
    const std::vector<double>& rate = runs.back().rate_dph;
    const auto n_here = std::count_if(rate.begin(), rate.end(), [](double r) { return std::isfinite(r); });
    if (n_here == 0)
      throw data_error(log.path + ": axis " + name + " has no usable second (empty, flagged, or without temperature)");
    n_used += static_cast<size_t>(n_here);
  }
  if (n_used < static_cast<size_t>(options.order) + logs.size() + 1)
    throw data_error(logs[0].path + ": " + std::to_string(n_used) + " usable seconds are too few for order " +
                     std::to_string(options.order));
  return runs;
}

// Temperatures seen: by the core's robust rule; all of them where a log is too short for it.
Span span_of(std::vector<FitRun> runs, const imucal_health_config_t& expected) {
  Span seen;
  const Checked checked = check_runs(expected, nullptr, false, &runs);
  if (checked.has_span) {
    seen.take(static_cast<double>(checked.lo_degc));
    seen.take(static_cast<double>(checked.hi_degc));
    return seen;
  }
  for (const FitRun& run : runs)
    for (size_t k = 0; k < run.rate_dph.size(); ++k)
      if (std::isfinite(run.rate_dph[k])) seen.take(run.temp_degc[k]);
  return seen;
}

void take_health(const imucal_health_t& health, FitAxis* axis) {
  imucal_health_judge(&health, &axis->health);
  axis->n_rejected = health.config.is_ungated ? 0 : health.n_rejected;
  axis->n_bad_temperature = health.n_spikes;
  axis->error_factor = static_cast<double>(imucal_health_error_factor(&health));
}

// Where the gate would leave out more than bumps, the model is wrong and not the seconds: then all of them are learnt, and
// judged.
imucal_health_t check_through_gate(imucal_health_config_t* expected, const std::optional<imucal_kf_config_t>& config,
                                   bool shared_turn_on, std::vector<FitRun>* runs) {
  std::vector<FitRun> gated = *runs;
  imucal_health_t health = check_runs(*expected, config ? &*config : nullptr, shared_turn_on, &gated).health;
  imucal_health_verdict_t verdict;
  imucal_health_judge(&health, &verdict);
  expected->is_ungated = (verdict.bits >> IMUCAL_HEALTH_REJECTS & 1U) != 0;
  if (!expected->is_ungated) {
    *runs = gated;
    return health;
  }
  imucal_health_t all = check_runs(*expected, &*config, shared_turn_on, runs).health;
  all.n_rejected = health.n_rejected; // a filter that learns the step contradicts itself less
  all.has_opened = health.has_opened;
  return all;
}

// Beyond |Tn| = 1.5 the core refuses and a polynomial has no meaning: left out for both methods.
void leave_out_beyond(const FitAxis& axis, std::vector<FitRun>* runs) {
  for (FitRun& run : *runs)
    for (size_t k = 0; k < run.rate_dph.size(); ++k)
      if (std::abs((run.temp_degc[k] - axis.t0_degc) / axis.range_degc) > static_cast<double>(IMUCAL_KF_MAX_TN))
        run.rate_dph[k] = kUnused;
}

// Where the thermometer stands, or has frozen: there the rate shows more than noise if it has.
void leave_out_stands(std::vector<FitRun>* runs) {
  for (FitRun& run : *runs) {
    size_t begin = 0;
    for (size_t k = 1; k <= run.temp_degc.size(); ++k) {
      if (k < run.temp_degc.size() && run.temp_degc[k] == run.temp_degc[begin]) continue;
      if (k - begin >= kStand_rows) std::fill_n(run.rate_dph.begin() + static_cast<long>(begin), k - begin, kUnused);
      begin = k;
    }
  }
}

// What a polynomial without a model is judged by: the noise of its own residuals, as a filter would believe it.
struct OwnNoise {
  std::optional<imucal_kf_config_t> config; // empty: nothing that a filter could believe
  NoiseModel noise;
  bool is_of_moving = false; // found where the temperature moves: judges what is seen where it stands
};

OwnNoise own_noise(std::vector<FitRun> runs, const imucal_health_config_t& expected, const FitOptions& options,
                   double dt_s, const FitAxis& axis) {
  check_runs(expected, nullptr, options.shared_turn_on, &runs);
  leave_out_beyond(axis, &runs);
  leave_out_far_off(options.order, axis.t0_degc, axis.range_degc, options.shared_turn_on, &runs);
  OwnNoise own;
  std::vector<FitRun> moving = runs;
  leave_out_stands(&moving);
  for (const bool is_of_moving : {true, false}) try {
      const NoiseModel noise = noise_of_residuals(is_of_moving ? moving : runs, options.order, axis.t0_degc,
                                                  axis.range_degc, dt_s, options.shared_turn_on)
                                   .noise[0];
      ErrorModel model;
      model.arw_deg_rt_h = arw_from_white_sigma(noise.white_sigma_dph);
      model.markov = noise.markov;
      own.config = kf_config(model, options.order, axis.t0_degc, axis.range_degc, options.prior_sigma_dph, dt_s);
      own.noise = noise;
      own.is_of_moving = is_of_moving;
      return own;
    } catch (const Error&) { // too few rows, or no noise
    }
  return own;
}

void forget_rule(uint32_t rule, FitAxis* axis) {
  axis->health.judged &= ~(1U << rule);
  axis->health.bits &= ~(1U << rule);
}

// The core counts 64 rows; of rows that are no second apart the same rule by their times.
void judge_ramp_by_time(const std::vector<FitRun>& runs, const imucal_health_config_t& expected, double dt_s,
                        FitAxis* axis) {
  if (std::abs(dt_s - 1) < 0.01 || !(axis->health.judged >> IMUCAL_HEALTH_TEMP_RAMP & 1U)) return;
  forget_rule(IMUCAL_HEALTH_TEMP_RAMP, axis);
  if (2 * dt_s > 64) return; // fewer than two rows
  const double part = fastest_ramp_degc(runs, dt_s) / static_cast<double>(expected.hi_degc - expected.lo_degc);
  axis->health.value[IMUCAL_HEALTH_TEMP_RAMP] = static_cast<float>(part);
  axis->health.judged |= 1U << IMUCAL_HEALTH_TEMP_RAMP;
  if (part > static_cast<double>(axis->health.limit[IMUCAL_HEALTH_TEMP_RAMP]))
    axis->health.bits |= 1U << IMUCAL_HEALTH_TEMP_RAMP;
}

// Without a model: no verdict on the innovations, for the noise of the residuals always fits them.
void name_what_is_not_judged(bool has_model, FitAxis* axis) {
  if (!has_model) {
    for (const uint32_t rule : {IMUCAL_HEALTH_NIS, IMUCAL_HEALTH_LAG1, IMUCAL_HEALTH_SLOW}) forget_rule(rule, axis);
    axis->error_factor = 1;
  }
  for (uint32_t rule = 0; rule < IMUCAL_HEALTH_N_RULES; ++rule)
    if (!(axis->health.judged >> rule & 1U)) axis->not_judged.emplace_back(imucal_health_rule_name(rule));
}

// The first second that the rules or the gate left out.
std::string first_left_out(const std::vector<Log>& logs, const std::vector<FitRun>& before,
                           const std::vector<FitRun>& after, double dt_s) {
  for (size_t l = 0; l < logs.size(); ++l)
    for (size_t k = 0; k < before[l].rate_dph.size(); ++k) {
      if (std::isnan(before[l].rate_dph[k]) || !std::isnan(after[l].rate_dph[k])) continue;
      char time[32];
      std::snprintf(time, sizeof time, "%.10g", logs[l].t_s[0] + static_cast<double>(k) * dt_s);
      return logs[l].path + " at " + time + " s";
    }
  return "";
}

// Rules that single wrong seconds can break, whatever else they are meant for.
constexpr uint32_t kOfRate =
    1U << IMUCAL_HEALTH_TEMP_STUCK | 1U << IMUCAL_HEALTH_NIS | 1U << IMUCAL_HEALTH_SLOW | 1U << IMUCAL_HEALTH_REJECTS;
constexpr size_t kMostAlone = 2; // wrong seconds in a row that are still single ones

// Are single seconds to blame, each far off the polynomial of all others?
void find_far_off(const std::vector<Log>& logs, const FitOptions& options, const std::vector<FitRun>& runs, double dt_s,
                  FitAxis* axis) {
  if ((axis->health.bits & kOfRate) == 0) return;
  std::vector<FitRun> inside = runs;
  leave_out_beyond(*axis, &inside);
  std::vector<FitRun> left = inside;
  try {
    leave_out_far_off(options.order, axis->t0_degc, axis->range_degc, options.shared_turn_on, &left);
  } catch (const Error&) { // the logs do not determine a polynomial
    return;
  }
  long n = 0;
  for (size_t l = 0; l < left.size(); ++l)
    for (size_t k = 0, in_a_row = 0; k < left[l].rate_dph.size(); ++k) {
      const bool is_off = std::isfinite(inside[l].rate_dph[k]) && std::isnan(left[l].rate_dph[k]);
      in_a_row = is_off ? in_a_row + 1 : 0;
      n += is_off;
      if (in_a_row > kMostAlone) return;
    }
  axis->n_far_off = n;
  if (n > 0) axis->first_far_off = first_left_out(logs, inside, left, dt_s);
}

// Over all runs; nothing is compared across their ends.
double repeated_frac(const std::vector<FitRun>& runs) {
  std::vector<double> rates;
  for (const FitRun& run : runs) {
    rates.insert(rates.end(), run.rate_dph.begin(), run.rate_dph.end());
    rates.push_back(kUnused);
  }
  return repeated_share(rates);
}

// Every second through the rules and the gate, by the model's noise or by the residuals' own.
void check_axis(const std::vector<Log>& logs, const FitOptions& options, imucal_health_config_t expected,
                std::optional<imucal_kf_config_t> config, std::vector<FitRun>* runs, FitAxis* axis) {
  const double dt_s = logs[0].dt_s();
  const bool has_model = config.has_value();
  bool judges_stands = true;
  NoiseModel noise;
  if (has_model) noise = noise_of(*options.model_of(axis->axis));
  if (!has_model) {
    const OwnNoise own = own_noise(*runs, expected, options, dt_s, *axis);
    config = own.config;
    noise = own.noise;
    judges_stands = own.is_of_moving;
  }
  if (config) expected.r = config->r, expected.markov_variance = config->markov_variance;
  const std::vector<FitRun> before = *runs;
  const imucal_health_t health = check_through_gate(&expected, config, options.shared_turn_on, runs);
  take_health(health, axis);
  if (noise.markov.size() > 1)
    judge_by_expected(expected_innovations(*config, noise, dt_s), static_cast<long>(health.n_innovations), axis);
  if (!judges_stands) forget_rule(IMUCAL_HEALTH_TEMP_STUCK, axis);
  judge_ramp_by_time(*runs, expected, dt_s, axis);
  name_what_is_not_judged(has_model, axis);
  if (axis->n_rejected + axis->n_bad_temperature > 0) axis->first_left_out = first_left_out(logs, before, *runs, dt_s);
  find_far_off(logs, options, before, dt_s, axis);
  leave_out_beyond(*axis, runs);
}

ChebyshevFit fit_polynomial(const std::vector<FitRun>& runs, const FitOptions& options, double dt_s, FitAxis* axis) {
  const std::optional<ErrorModel>& model = options.model_of(axis->axis);
  const NoiseBelief belief =
      model ? NoiseBelief{{noise_of(*model)}, {1}}
            : noise_of_residuals(runs, options.order, axis->t0_degc, axis->range_degc, dt_s, options.shared_turn_on);
  if (!model) axis->residual_noise = belief.noise[0];
  ChebyshevFit fit =
      fit_polynomial_qr(runs, options.order, axis->t0_degc, axis->range_degc, belief, dt_s, options.shared_turn_on);
  fit.sigma_basis = model ? "model" : "residuals";
  if (!model) axis->expected_residual_dph = fit.expected_residual_dph;
  return fit;
}

// Without a model no rule compares the residual with its noise: what anybody would see in it is told.
void note_shape(const std::vector<Log>& logs, const std::vector<FitRun>& runs, const FitAxis& axis, FitResult* result) {
  const ResidualShape shape = shape_of(residuals_of(runs, axis), axis.dt_s);
  const double mean_s = shape.mean_s;
  if (shape.jump_times > kJump_times)
    result->warnings.push_back(format(
        "%s: the residual jumps by about %s %s at %.0f s of %s, %.0f times what its means over %.0f s usually do: no "
        "polynomial holds that; ask diagnose, or cut the log there",
        axis.axis.c_str(), in_digits(shape.jump_dph, 2).c_str(), axis.unit(),
        logs[shape.jump_run].t_s[0] + static_cast<double>(shape.jump_row) * axis.dt_s,
        logs[shape.jump_run].path.c_str(), shape.jump_times, mean_s));
  if (shape.warm_up_times > kWarmUp_times)
    result->warnings.push_back(
        format("%s: the first %.0f s of %s lie %s %s off the polynomial, %.0f times what is usual: a "
               "warm-up? let the device warm up before, or cut the start off",
               axis.axis.c_str(), mean_s, logs[shape.warm_up_run].path.c_str(), in_digits(shape.warm_up_dph, 2).c_str(),
               axis.unit(), shape.warm_up_times));
}

// The delay of a thermometer that is renewed seldom, by the log where it costs most.  Its quantum is what `calibrate record`
// notes.
void take_renewal(const std::vector<Log>& logs, FitAxis* axis, FitResult* result) {
  if (std::abs(axis->dt_s - 1) > 0.01) return;
  for (const Log& log : logs) {
    const auto noted = log.metadata.find("temp_counts_scale_degc");
    const double quantum_degc = noted == log.metadata.end() ? 0 : std::atof(noted->second.c_str());
    if (!(quantum_degc > 0)) continue;
    std::vector<double> t_s, temp_degc;
    for (size_t k = 0; k < log.size(); ++k)
      if (std::isfinite(log.temp_degc[k])) t_s.push_back(log.t_s[k]), temp_degc.push_back(log.temp_degc[k]);
    const Renewal renewal = thermometer_renewal(t_s, temp_degc, quantum_degc);
    const double cost = renewal_cost(renewal, t_s, temp_degc, axis->coeff_dph, axis->t0_degc, axis->range_degc);
    if (cost > axis->renewal_cost_dph) axis->renewal = renewal, axis->renewal_cost_dph = cost;
  }
  if (const std::string note = axis->renewal_note(); !note.empty()) result->warnings.push_back(note);
}

double temperature_step(const std::vector<FitRun>& runs, double dt_s) {
  double least = std::numeric_limits<double>::infinity();
  for (const FitRun& run : runs) least = std::min(least, smallest_temperature_step(run.temp_degc));
  return expected_temperature_step(least, dt_s);
}

FitAxis fit_axis(const std::vector<Log>& logs, const std::string& name, const FitOptions& options, FitResult* result) {
  const double dt_s = logs[0].dt_s();
  FitAxis axis;
  axis.dt_s = dt_s;
  axis.axis = name_of(find_axis(logs[0], name));
  const std::optional<ErrorModel>& model = options.model_of(axis.axis);
  check_units(options, axis.axis, result);
  axis.order = options.order;
  std::vector<FitRun> runs = runs_of(logs, name, options, dt_s);
  axis.repeated_frac = repeated_frac(runs);
  imucal_health_config_t expected{};
  expected.temp_step_degc = static_cast<float>(temperature_step(runs, dt_s));
  const Span seen = span_of(runs, expected);
  normalise(options, seen, &axis);
  judge_span(logs[0].path, seen, &axis, result);
  expected.lo_degc = static_cast<float>(axis.t0_degc - axis.range_degc);
  expected.hi_degc = static_cast<float>(axis.t0_degc + axis.range_degc);
  std::optional<imucal_kf_config_t> config;
  if (model) config = kf_config(*model, options.order, axis.t0_degc, axis.range_degc, options.prior_sigma_dph, dt_s);
  check_axis(logs, options, expected, config, &runs, &axis);
  const ChebyshevFit fit = options.method == FitOptions::Method::kKalman
                               ? fit_kalman(runs, *config, options.shared_turn_on)
                               : fit_polynomial(runs, options, dt_s, &axis);
  take_fit(fit, &axis);
  take_residuals(runs, &axis);
  if (!model) note_shape(logs, runs, axis, result);
  if (is_beyond_own_noise(axis)) axis.error_factor = axis.residual_rms_dph / axis.expected_residual_dph;
  take_renewal(logs, &axis, result);
  if (fit.n_refused > 0)
    result->warnings.push_back(axis.axis + ": the filter refused " + std::to_string(fit.n_refused) +
                               " seconds as out of range");
  const double worst = axis.worst_sigma_dph();
  if (options.method == FitOptions::Method::kKalman && worst > 0.1 * options.prior_sigma_dph)
    throw data_error(logs[0].path + ": axis " + name + ": the logs do not determine order " +
                     std::to_string(options.order) + " (predicted error " + std::to_string(worst) + " " + axis.unit() +
                     "): record a wider span or lower --order");
  return axis;
}

} // namespace

const std::optional<ErrorModel>& FitOptions::model_of(const std::string& axis) const {
  return accel_model && is_accelerometer(axis) ? accel_model : model;
}

double FitAxis::bias_dph(double at_degc) const {
  const double tn = (at_degc - t0_degc) / range_degc;
  double sum = 0;
  for (size_t i = coeff_dph.size(); i-- > 0;) sum = sum * tn + coeff_dph[i];
  return sum;
}

std::string FitAxis::renewal_note() const {
  const double worst = worst_sigma_dph();
  if (renewal.every_s <= 0 || renewal_cost_dph > worst) return "";
  return axis + ": " + renewal_text(renewal, renewal_cost_dph, worst, unit());
}

double FitAxis::bias_sigma_dph(double at_degc) const {
  const double tn = (at_degc - t0_degc) / range_degc;
  const size_t n = coeff_dph.size();
  double sum = 0;
  for (size_t i = 0; i < n; ++i)
    for (size_t j = 0; j < n; ++j)
      sum += covariance_dph2[i * n + j] * std::pow(tn, static_cast<double>(i)) * std::pow(tn, static_cast<double>(j));
  return std::sqrt(std::max(0.0, sum));
}

imucal_kf_config_t kf_config(const ErrorModel& model, int order, double t0_degc, double range_degc,
                             double prior_sigma_dph, double dt_s, double other_white_dph2) {
  double variance = 0, density = 0;
  for (const Markov& m : model.markov) {
    variance += m.sigma_dph * m.sigma_dph;
    density += m.sigma_dph * m.sigma_dph * m.tau_s;
  }
  const double tau_s = variance > 0 ? density / variance : 1.0;
  const double white = white_sigma_dph(model.arw_deg_rt_h, dt_s);
  imucal_kf_config_t config{};
  config.order = static_cast<uint8_t>(order);
  config.t0_degc = static_cast<float>(t0_degc);
  config.range_degc = static_cast<float>(range_degc);
  const MarkovStep step(dt_s, tau_s);
  config.m = static_cast<float>(step.m());
  config.q = static_cast<float>(variance * step.q());
  config.r = static_cast<float>(white * white + other_white_dph2);
  config.markov_variance = static_cast<float>(variance);
  config.prior_sigma = static_cast<float>(prior_sigma_dph);
  if (!(white > 0))
    throw data_error("model: arw_deg_rt_h is 0: the filter needs white noise; state the sensor's angle random walk");
  imucal_kf_t trial;
  const imucal_status status = imucal_kf_init(&trial, &config);
  if (status != IMUCAL_OK) throw data_error(std::string("the filter refuses the model: ") + imucal_status_text(status));
  return config;
}

FitResult fit_logs(const std::vector<Log>& logs, const FitOptions& options) {
  if (options.order < 1 || options.order > IMUCAL_MAX_ORDER)
    throw usage_error("order " + std::to_string(options.order) + " is not in 1.." + std::to_string(IMUCAL_MAX_ORDER));
  require_rules(options.accept);
  if (options.method == FitOptions::Method::kKalman && !options.model)
    throw usage_error("the Kalman filter needs an error model: give --model, or use --method poly");
  check_logs(logs, options.ignore_metadata);
  FitResult result;
  result.method = options.method;
  result.model = options.model;
  result.accel_model = options.accel_model;
  result.metadata = logs[0].metadata;
  for (const Log& log : logs) result.logs.push_back(log.path);
  if (!options.ignore_metadata) note_nameless(logs, &result);
  const std::vector<std::string> names = axes_of(logs[0], options);
  require_different(logs[0], names);
  if (options.method == FitOptions::Method::kKalman) note_merged(names, logs[0], options, &result);
  for (const Log& log : logs) check_twins(log, names);
  for (const std::string& name : names) result.axes.push_back(fit_axis(logs, name, options, &result));
  judge_fit(options, logs[0].dt_s(), &result);
  return result;
}

} // namespace imucal
