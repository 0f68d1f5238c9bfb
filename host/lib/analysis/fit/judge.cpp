// SPDX-License-Identifier: MIT
// Is what was learnt to be trusted: the core's rules over the logs of one axis, and what only a whole log shows.
#include <algorithm>
#include <cmath>
#include <limits>

#include "analysis/fit/judge.h"
#include "analysis/fit/parts.h"
#include "base/error.h"
#include "base/format.h"
#include "base/repeats.h"
#include "base/suggest.h"
#include "base/units.h"
#include "learn.h"

namespace imucal {

namespace {

constexpr double kMaxResidualVariance = 1.5;    // of what the model predicts, beyond its own scatter
constexpr double kMaxOwnResidualVariance = 1.5; // of what the noise makes that the residuals themselves show
constexpr double kMinMeasurements = 0.9;        // of the best axis' seconds
constexpr double kManyLossy = 0.1;              // of the seconds: more noise than the model's may be their doing

// A second that the filter refuses stays: fit_kalman counts it.
bool is_left_out_by(imucal_learn_outcome_t outcome) {
  return outcome == IMUCAL_LEARN_TEMPERATURE || outcome == IMUCAL_LEARN_KNOCK;
}

// One run through the rules, with the filter where there is one (learn->kf is ready).
void check_run(imucal_health_t* health, imucal_learn_t* learn, FitRun* run) {
  uint32_t gap_s = 0;
  for (size_t k = 0; k < run->rate_dph.size(); ++k) {
    if (!run->has_row[k]) {
      ++gap_s;
      continue;
    }
    const bool is_measured = std::isfinite(run->rate_dph[k]);
    const imucal_learn_input_t input = {static_cast<float>(run->rate_dph[k]), static_cast<float>(run->temp_degc[k]),
                                        run->noise_ratio[k], gap_s,
                                        is_measured ? IMUCAL_LEARN_USED : IMUCAL_LEARN_MISSING};
    const bool is_left_out =
        learn == nullptr
            ? !imucal_health_second(health, input.value, input.temp_degc, run->flags[k], is_measured, gap_s)
            : is_left_out_by(imucal_learn_checked(learn, health, &input, run->flags[k]));
    if (is_left_out) run->rate_dph[k] = std::numeric_limits<double>::quiet_NaN();
    gap_s = 0;
  }
}

std::string number(double value) {
  return format("%.3g", value);
}

std::string far_off_text(const FitAxis& axis) {
  return std::to_string(axis.n_far_off) + (axis.n_far_off == 1 ? " second lies" : " seconds lie") +
         " far off the polynomial (the first: " + axis.first_far_off + ")";
}

// What to do where there is more noise than the model has.
std::string remedy_of_noise(const FitAxis& axis) {
  if (axis.n_far_off > 0) return "mend or cut first the seconds that lie far off";
  if (axis.lossy_frac <= kManyLossy) return "identify the model anew";
  return format("samples are missing in %.3g %% of the seconds: mend that first (losses between sensor and board, or a "
                "rate_hz that is not the sensor's), no model will",
                100 * axis.lossy_frac);
}

// What a rule of the core means, with its figure.
std::string text_of(uint32_t rule, const FitAxis& axis) {
  const std::string value = number(static_cast<double>(axis.health.value[rule]));
  const std::string percent = number(100 * static_cast<double>(axis.health.value[rule])) + " %";
  const double worst = axis.worst_sigma_dph();
  const std::string honest = ": the predicted error is at least " + number(axis.error_factor) + " times too small (" +
                             number(worst) + " claimed, " + number(worst * axis.error_factor) + " by what was seen); " +
                             remedy_of_noise(axis);
  switch (rule) {
  case IMUCAL_HEALTH_NO_NOISE:
    return "no noise: steps between seconds have " + value + " of the variance expected; is the sensor alive?";
  case IMUCAL_HEALTH_REPEATED:
    return value + " seconds in a row have the same value: the output is frozen, or far coarser than its noise";
  case IMUCAL_HEALTH_SATURATED:
    return "at its rail in " + percent + " of the seconds: what is left of them is no bias";
  case IMUCAL_HEALTH_FAULTY:
    return "the sensor reports a fault in " + percent + " of the seconds";
  case IMUCAL_HEALTH_TEMP_STUCK:
    return "while the temperature stands the rate moves by " + value + " standard deviations: " +
           (axis.n_far_off > 0 ? far_off_text(axis) + ", which do that" : "is the thermometer stuck?");
  case IMUCAL_HEALTH_TEMP_JUMP:
    return "the temperature jumps to another level " + value + " times: no sensor does that";
  case IMUCAL_HEALTH_TEMP_SPIKES:
    return percent + " of the temperatures are out of reach of their neighbours: is the thermometer's line good?";
  case IMUCAL_HEALTH_TEMP_RAMP:
    return "the temperature crosses " + percent +
           " of the range in 64 s: sensor and thermometer do not follow; ramp more slowly";
  case IMUCAL_HEALTH_SPAN:
    return "only " + percent +
           " of the range asked for was seen: the rest is a guess; widen the profile or narrow --range";
  case IMUCAL_HEALTH_NIS:
    return "innovations have " + value + " times the variance that the model predicts" +
           (axis.health.value[rule] > 1 ? honest : "");
  case IMUCAL_HEALTH_LAG1:
    return "innovations are correlated from one second to the next by " + value +
           ": the model's noise is not the sensor's";
  case IMUCAL_HEALTH_SLOW:
    return "slow noise (blocks of 256 s) has " + value + " times the variance that the model predicts" + honest;
  case IMUCAL_HEALTH_REJECTS:
    if (axis.n_far_off > 0) return far_off_text(axis) + ": bit errors, resets or knocks? mend or cut them";
    return "knocks" +
           (axis.health.value[rule] >= 1 ? std::string(" of a minute and more")
                                         : " in " + percent + " of the seconds") +
           " (innovations beyond 6 sigma): the model is wrong, or the device was moved";
  default:
    return "rule " + std::to_string(rule);
  }
}

// rms of rate - B(T) over what the model predicts.  Scatter of the variance: white r sqrt(2/n), Markov sigma^2 sqrt(2 tau/T).
void judge_residual(const ErrorModel& model, double dt_s, const FitAxis& axis, std::vector<FitReason>* reasons) {
  const double white = white_sigma_dph(model.arw_deg_rt_h, dt_s), n = static_cast<double>(axis.n_used);
  double variance = white * white, scatter2 = 2 * std::pow(white, 4) / n;
  for (const Markov& m : model.markov) {
    variance += m.sigma_dph * m.sigma_dph;
    scatter2 += std::pow(m.sigma_dph, 4) * 2 * m.tau_s / (n * dt_s);
  }
  const double limit =
      std::sqrt(kMaxResidualVariance * (variance + static_cast<double>(IMUCAL_HEALTH_Z) * std::sqrt(scatter2)));
  if (axis.residual_rms_dph <= limit) return;
  reasons->push_back({axis.axis, "residual", axis.residual_rms_dph, limit,
                      "residual " + number(axis.residual_rms_dph) + " rms, but noise of the model makes " +
                          number(std::sqrt(variance)) + " (limit " + number(limit) + "): " +
                          (axis.n_far_off > 0 ? "the seconds that lie far off do that"
                                              : "the polynomial misses something, or the model does")});
}

// Without a model.
void judge_own_residual(const FitAxis& axis, std::vector<FitReason>* reasons) {
  if (!is_beyond_own_noise(axis)) return;
  const double worst = axis.worst_sigma_dph(), noise = axis.expected_residual_dph;
  reasons->push_back({axis.axis, "residual", axis.residual_rms_dph, std::sqrt(kMaxOwnResidualVariance) * noise,
                      "residual " + number(axis.residual_rms_dph) + " rms, but the noise that it shows makes " +
                          number(noise) + ": the polynomial misses something, and the predicted error is about " +
                          number(axis.error_factor) + " times too small (" + number(worst) + " claimed, " +
                          number(worst * axis.error_factor) +
                          " by what was seen); imucal diagnose tells what it may be"});
}

void judge_axis(const JudgeOptions& options, const ErrorModel* model, double dt_s, const FitAxis& axis, long best_n,
                std::vector<FitReason>* reasons) {
  for (uint32_t rule = 0; rule < IMUCAL_HEALTH_N_RULES; ++rule) {
    if (axis.health.bits >> rule & 1U)
      reasons->push_back({axis.axis, imucal_health_rule_name(rule), static_cast<double>(axis.health.value[rule]),
                          static_cast<double>(axis.health.limit[rule]), text_of(rule, axis)});
  }
  if (axis.repeated_frac > kMostRepeatedShare && !(axis.health.bits >> IMUCAL_HEALTH_REPEATED & 1U))
    reasons->push_back({axis.axis, imucal_health_rule_name(IMUCAL_HEALTH_REPEATED), axis.repeated_frac,
                        kMostRepeatedShare, repeated_text(axis.repeated_frac, dt_s)});
  if (model) judge_residual(*model, dt_s, axis, reasons);
  judge_own_residual(axis, reasons);
  const double part = static_cast<double>(axis.n_used) / static_cast<double>(best_n);
  if (part < kMinMeasurements)
    reasons->push_back(
        {axis.axis, "measurements", part, kMinMeasurements,
         "only " + number(100 * part) + " % of the seconds that the best axis has: what became of the others?"});
  const double worst = axis.worst_sigma_dph();
  if (axis.renewal_cost_dph > worst)
    reasons->push_back({axis.axis, "temp-held", axis.renewal_cost_dph, worst,
                        renewal_text(axis.renewal, axis.renewal_cost_dph, worst, axis.unit())});
  const double by_unit = is_accelerometer(axis.axis) ? kMaxErrorMg : kMaxErrorDph;
  const double limit = options.max_error_dph > 0 ? options.max_error_dph : by_unit;
  if (worst > limit)
    reasons->push_back({axis.axis, "error", worst, limit,
                        "predicted error " + number(worst) + " " + axis.unit() + ", above --max-error " +
                            number(limit) + ": record longer or over a wider span, or lower --order"});
}

} // namespace

Checked check_runs(const imucal_health_config_t& expected, const imucal_kf_config_t* config, bool shared_turn_on,
                   std::vector<FitRun>* runs) {
  Checked checked;
  imucal_learn_t learn;
  if (config != nullptr && imucal_learn_init(&learn, config) != IMUCAL_OK)
    throw data_error("the filter refuses its configuration");
  const imucal_status status = imucal_health_init(&checked.health, &expected);
  if (status != IMUCAL_OK)
    throw data_error(std::string("the rules refuse what is expected: ") + imucal_status_text(status));
  for (size_t l = 0; l < runs->size(); ++l) {
    if (l > 0) imucal_health_new_run(&checked.health);
    if (l > 0 && config != nullptr &&
        imucal_kf_new_run(&learn.kf, shared_turn_on ? 0.0F : config->prior_sigma) != IMUCAL_OK)
      throw data_error("the filter refuses a new run");
    check_run(&checked.health, config != nullptr ? &learn : nullptr, &(*runs)[l]);
  }
  checked.has_span = imucal_health_span(&checked.health, &checked.lo_degc, &checked.hi_degc);
  return checked;
}

bool is_beyond_own_noise(const FitAxis& axis) {
  const double noise = axis.expected_residual_dph;                         // 0: a model was given
  if ((axis.health.bits >> IMUCAL_HEALTH_NO_NOISE & 1) != 0) return false; // what is left is rounding
  return noise > 0 && axis.residual_rms_dph * axis.residual_rms_dph > kMaxOwnResidualVariance * noise * noise;
}

double fastest_ramp_degc(const std::vector<FitRun>& runs, double dt_s) {
  const auto window = static_cast<size_t>(64 / dt_s) + 1;
  double most = 0;
  for (const FitRun& run : runs)
    for (size_t begin = 0; begin < run.rate_dph.size(); begin += window) {
      double lo = std::numeric_limits<double>::infinity(), hi = -lo;
      for (size_t k = begin; k < std::min(begin + window, run.rate_dph.size()); ++k)
        if (std::isfinite(run.rate_dph[k])) lo = std::min(lo, run.temp_degc[k]), hi = std::max(hi, run.temp_degc[k]);
      most = std::max(most, hi - lo); // none: -inf
    }
  return most;
}

std::vector<std::string> fit_rules() {
  std::vector<std::string> names;
  for (uint32_t rule = 0; rule < IMUCAL_HEALTH_N_RULES; ++rule) names.emplace_back(imucal_health_rule_name(rule));
  names.insert(names.end(), {"residual", "temp-held", "measurements", "error", "units"});
  return names;
}

void require_rules(const std::vector<std::string>& names) {
  const std::vector<std::string> rules = fit_rules();
  for (const std::string& name : names)
    if (std::find(rules.begin(), rules.end(), name) == rules.end())
      throw usage_error("--accept " + name + ": there is no such rule" + did_you_mean(name, rules));
}

static void mark_accepted(const std::vector<std::string>& accept, std::vector<FitReason>* reasons) {
  for (FitReason& reason : *reasons)
    reason.is_accepted = std::find(accept.begin(), accept.end(), reason.rule) != accept.end();
}

bool is_accepted(const std::vector<FitReason>& reasons) {
  return std::all_of(reasons.begin(), reasons.end(), [](const FitReason& r) { return r.is_accepted; });
}

std::vector<TableNote> table_notes(const std::vector<FitReason>& reasons,
                                   const std::map<std::string, double>& error_factor) {
  std::vector<TableNote> notes;
  for (const auto& [axis, factor] : error_factor) {
    TableNote note{axis, {}, factor};
    for (const FitReason& reason : reasons)
      if (reason.is_accepted && reason.axis == axis &&
          std::find(note.accepted.begin(), note.accepted.end(), reason.rule) == note.accepted.end())
        note.accepted.push_back(reason.rule);
    if (!note.accepted.empty()) notes.push_back(note);
  }
  return notes;
}

std::vector<TableNote> table_notes(const FitResult& result) {
  std::map<std::string, double> error_factor;
  for (const FitAxis& axis : result.axes) error_factor[axis.axis] = axis.error_factor;
  return table_notes(result.reasons, error_factor);
}

bool FitResult::is_accepted() const {
  return imucal::is_accepted(reasons);
}

std::vector<FitReason> judge_axes(const std::vector<FitAxis>& axes, const std::vector<const ErrorModel*>& models,
                                  double dt_s, const JudgeOptions& options) {
  std::vector<FitReason> reasons;
  long best_n = 1;
  for (const FitAxis& axis : axes) best_n = std::max(best_n, axis.n_used);
  for (size_t i = 0; i < axes.size(); ++i) judge_axis(options, models[i], dt_s, axes[i], best_n, &reasons);
  mark_accepted(options.accept, &reasons);
  return reasons;
}

namespace {

// A table of a device that nobody has: it would be in other units than the device's.
void judge_units(const FitAxis& axis, std::vector<FitReason>* reasons) {
  if (axis.span_lo_degc > kWarmerThanAnySensor_degc)
    reasons->push_back({axis.axis, "units", axis.span_lo_degc, kWarmerThanAnySensor_degc,
                        "temperatures of " + number(axis.span_lo_degc) + ".." + number(axis.span_hi_degc) +
                            ": are they in kelvin? temp_degc is in degrees Celsius: take 273.15 off"});
  if (std::abs(axis.dt_s / 1000 - 1) < 0.01)
    reasons->push_back({axis.axis, "units", axis.dt_s, 1000,
                        "rows are 1000 s apart: are these milliseconds? t_s is in seconds: divide by 1000"});
}

} // namespace

void judge_fit(const FitOptions& options, double dt_s, FitResult* result) {
  std::vector<const ErrorModel*> models;
  for (const FitAxis& axis : result->axes) {
    const std::optional<ErrorModel>& model = options.model_of(axis.axis);
    models.push_back(model ? &*model : nullptr);
  }
  result->reasons = judge_axes(result->axes, models, dt_s, {options.accept, options.max_error_dph});
  for (const FitAxis& axis : result->axes) judge_units(axis, &result->reasons);
  mark_accepted(options.accept, &result->reasons);
}

} // namespace imucal
