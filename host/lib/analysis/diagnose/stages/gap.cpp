// SPDX-License-Identifier: MIT
#include "analysis/diagnose/stages/gap.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/evidence/reduction.h"
#include "analysis/diagnose/stages/drawn_minutes.h"
#include "base/rng.h"
#include "base/units.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kLeast_h = 1e-9;     // of held-out data: a divisor
constexpr double kLeastErrors = 1;    // above the noise from which the interval holds what the minutes show
constexpr double kClearlyLess = 0.95; // of a residual: the polynomial of least squares is what there was before

// Data with the places of what is learned from and what is predicted.
struct Split {
  SlowData data;
  std::vector<char> train, all; // per run
  std::vector<size_t> units;    // runs
};

// What one hypothesis makes of the held-out units of a split.
struct Prediction {
  std::vector<double> nats; // per unit
  std::vector<std::vector<VectorXd>>
      mean;                             // per split and unit: what it predicts there, constants and start states fitted
  std::vector<VectorXd> left;           // per unit: the rates less that
  std::vector<MatrixXd> starts, shapes; // per unit: columns with a coefficient of the run, and those common to all
  std::vector<MatrixXd> columns;        // per unit: those of the coefficients that were fitted elsewhere,
  std::vector<MatrixXd> covariances;    // and how well these are known
};
MatrixXd side_by_side(const std::vector<const MatrixXd*>& parts) {
  long cols = 0;
  for (const MatrixXd* m : parts) cols += m->cols();
  MatrixXd out(parts.front()->rows(), cols);
  long at = 0;
  for (const MatrixXd* m : parts) out.middleCols(at, m->cols()) = *m, at += m->cols();
  return out;
}
void keep_columns(const SlowData& data, const std::vector<MeanPart>& parts, const RunGrams::Posterior& at, size_t run,
                  Prediction* out) {
  const MatrixXd none(data.y[run].size(), 0);
  std::vector<const MatrixXd*> starts{&none}, shapes{&data.powers[run]}, fitted{&data.powers[run]};
  for (const MeanPart& part : parts) {
    starts.push_back(&part.local[run]), shapes.push_back(&part.common[run]), fitted.push_back(&part.common[run]);
    if (!part.powers.empty()) shapes.push_back(&part.powers[run]), fitted[0] = &part.powers[run];
  }
  out->starts.push_back(side_by_side(starts)), out->shapes.push_back(side_by_side(shapes));
  out->columns.push_back(side_by_side(fitted)), out->covariances.push_back(at.common_covariance);
}
// What differs from run to run by chance: other runs foretell nothing of it.
bool is_by_chance(const SlowSearch& search, const SlowModel::Name& name) {
  return search.candidates()[name.candidate].scan.estimator->form() == Form::kRunRandom;
}
bool has_chance(const SlowSearch& search, const SlowModel& model) {
  return std::any_of(model.names.begin(), model.names.end(),
                     [&](const auto& name) { return is_by_chance(search, name); });
}
enum class Chance { kFree, kLeft }; // in a run that was not fitted

// Jumps in time of the units: no other run foretells them, and the level after each is the unit's own.
void free_steps(const std::vector<size_t>& units, MeanPart* steps) {
  steps->local.clear();
  for (const MatrixXd& x : steps->common) steps->local.emplace_back(MatrixXd::Zero(x.rows(), x.cols()));
  for (size_t unit : units) std::swap(steps->common[unit], steps->local[unit]);
  steps->local_precision = steps->common_precision;
}

Prediction predict(const SlowSearch& search, const Split& split, const SlowModel& model, Chance chance) {
  Prediction out;
  out.mean.emplace_back();
  std::vector<MeanPart> parts = search.parts_on(split.data, model); // jumps in time, and then the names, last
  if (!model.steps.empty()) free_steps(split.units, &parts[parts.size() - model.names.size() - 1]);
  for (size_t i = 0; chance == Chance::kLeft && i < model.names.size(); ++i)
    if (is_by_chance(search, model.names[i]))
      for (size_t unit : split.units) parts[parts.size() - model.names.size() + i].local[unit].setZero();
  const RunGrams grams(split.data, pointers_of(parts), search.noise_of(model));
  const double trained = grams.log_marginal(1, split.train);
  const RunGrams::Posterior at = grams.posterior(split.train);
  for (size_t unit : split.units) {
    std::vector<char> with = split.train;
    with[unit] = 1;
    out.nats.push_back(grams.log_marginal(1, with) - trained);
    const VectorXd rest = residual_of(split.data, parts, at, unit);
    out.mean.back().push_back(split.data.y[unit] - rest);
    out.left.push_back(rest);
    keep_columns(split.data, parts, at, unit, &out);
  }
  return out;
}

std::vector<Split> splits_of(const SlowData& training, const Campaign* held_out, HeldOut* method) {
  std::vector<Split> out;
  const size_t n = training.campaign.runs.size();
  if (held_out) {
    *method = HeldOut::kLogs;
    Split split{with_held_out(training, *held_out), {}, {}, {}};
    const size_t n_all = split.data.campaign.runs.size();
    split.train.assign(n_all, 0);
    std::fill_n(split.train.begin(), n, 1);
    for (size_t r = n; r < n_all; ++r) split.units.push_back(r);
    out.push_back(std::move(split));
    return out;
  }
  *method = HeldOut::kEachLog;
  for (size_t r = 0; r < n; ++r) {
    Split split{training, std::vector<char>(n, 1), {}, {r}};
    split.train[r] = 0;
    out.push_back(std::move(split));
  }
  return out;
}

// One log: its quarters.  The likelihood of a quarter is that of the whole less that of the rest.
Prediction predict_quarters(const SlowSearch& search, const SlowData& training, const SlowModel& model) {
  Prediction out;
  const auto grams_on = [&](const SlowData& data, const std::vector<MeanPart>& parts) {
    return RunGrams(data, pointers_of(parts), search.noise_of(model));
  };
  const std::vector<MeanPart> parts = search.parts_on(training, model);
  const double whole = grams_on(training, parts).log_marginal(1);
  for (size_t q = 0; q < kQuarters; ++q) {
    Campaign rest = training.campaign;
    rest.runs[0] = only_quarter(training.campaign.runs[0], q, false);
    const SlowData data(rest, training);
    std::vector<MeanPart> rest_parts; // the polynomial of a name keeps its normalisation, as the nominal one does
    for (const MeanPart& part : parts) rest_parts.push_back(rows_of(part, training, data));
    const RunGrams grams = grams_on(data, rest_parts);
    const RunGrams::Posterior at = grams.posterior();
    out.nats.push_back(whole - grams.log_marginal(1));
    out.left.push_back(residual_of(training, parts, at, 0));
    keep_columns(training, parts, at, 0, &out);
  }
  return out;
}

// The quarters as a hypothesis fitted to all of them leaves them: what a table would be that was made from the only log.
Prediction fitted_quarters(const SlowSearch& search, const SlowData& training, const SlowModel& model) {
  Prediction out;
  const std::vector<MeanPart> parts = search.parts_on(training, model);
  const RunGrams::Posterior at = RunGrams(training, pointers_of(parts), search.noise_of(model)).posterior();
  for (size_t q = 0; q < kQuarters; ++q) {
    out.left.push_back(residual_of(training, parts, at, 0));
    keep_columns(training, parts, at, 0, &out);
  }
  return out;
}

Prediction predict_all(const SlowSearch& search, const SlowData& training, const std::vector<Split>& splits,
                       const SlowModel& model, Chance chance = Chance::kFree) {
  if (splits.empty()) return predict_quarters(search, training, model);
  Prediction out;
  for (const Split& split : splits) {
    const Prediction one = predict(search, split, model, chance);
    out.nats.insert(out.nats.end(), one.nats.begin(), one.nats.end());
    out.mean.insert(out.mean.end(), one.mean.begin(), one.mean.end());
    out.left.insert(out.left.end(), one.left.begin(), one.left.end());
    out.starts.insert(out.starts.end(), one.starts.begin(), one.starts.end());
    out.shapes.insert(out.shapes.end(), one.shapes.begin(), one.shapes.end());
    out.columns.insert(out.columns.end(), one.columns.begin(), one.columns.end());
    out.covariances.insert(out.covariances.end(), one.covariances.begin(), one.covariances.end());
  }
  return out;
}
// The held-out units as a hypothesis predicts them.
std::vector<Split> as_predicted(std::vector<Split> splits, const Prediction& by) {
  for (size_t s = 0; s < splits.size(); ++s)
    for (size_t u = 0; u < splits[s].units.size(); ++u) splits[s].data.y[splits[s].units[u]] = by.mean[s][u];
  return splits;
}

double hours_of(const Campaign& campaign) {
  return static_cast<double>(campaign.n()) * campaign.dt_s / kSecondsPerHour;
}
double sum_of(const std::vector<double>& x) {
  double sum = 0;
  for (double v : x) sum += v;
  return sum;
}
// Places among the used rows of a run that count.
std::vector<size_t> all_rows(const CampaignRun& run, size_t first, size_t end) {
  std::vector<size_t> out;
  for (size_t k = first; k < end && k < run.n(); ++k) out.push_back(k);
  return out;
}
// Of these those at temperatures that are passed, or nearly, by what was fitted: beyond, every answer is an extrapolated
// polynomial.
std::vector<size_t> rows_in(const FittedSpan& fitted, const CampaignRun& run, const std::vector<size_t>& rows) {
  std::vector<size_t> out;
  for (size_t k : rows)
    if (fitted.holds(run.input.smooth_degc[static_cast<size_t>(run.used[k])])) out.push_back(k);
  return out;
}
std::vector<size_t> rows_within(const Campaign& campaign, size_t unit, const std::vector<char>& is_fitted) {
  const CampaignRun& run = campaign.runs[unit];
  const std::vector<size_t> rows = all_rows(run, 0, run.n());
  if (!campaign.has_temperature) return rows;
  FittedSpan fitted;
  for (size_t r = 0; r < campaign.runs.size(); ++r)
    if (is_fitted[r]) fitted.add(campaign.runs[r], 0, campaign.runs[r].n());
  return rows_in(fitted, run, rows);
}
std::vector<size_t> rows_of_quarter(const Campaign& campaign, size_t quarter, bool only_within) {
  const CampaignRun& run = campaign.runs[0];
  const size_t first = quarter * run.n() / 4, end = (quarter + 1) * run.n() / 4;
  const std::vector<size_t> rows = all_rows(run, first, end);
  if (!only_within || !campaign.has_temperature) return rows;
  FittedSpan fitted;
  fitted.add(run, 0, first), fitted.add(run, end, run.n());
  return rows_in(fitted, run, rows);
}

HeldOutUnit held_out_unit(const CampaignRun& run, const std::vector<size_t>& rows, const Prediction& before,
                          const Prediction& after, size_t u) {
  HeldOutUnit out;
  out.run = run;
  std::fill(out.run.input.rate_dph.begin(), out.run.input.rate_dph.end(), std::nan(""));
  const long n = static_cast<long>(rows.size());
  out.left.resize(n), out.change.resize(n);
  out.starts.resize(n, after.starts[u].cols()), out.shapes.resize(n, after.shapes[u].cols());
  out.fitted.resize(n, after.columns[u].cols()), out.covariance = after.covariances[u];
  for (long i = 0; i < n; ++i) {
    const long k = static_cast<long>(rows[static_cast<size_t>(i)]);
    const size_t row = static_cast<size_t>(run.used[rows[static_cast<size_t>(i)]]);
    out.run.input.rate_dph[row] = run.input.rate_dph[row];
    out.left[i] = after.left[u][k], out.change[i] = before.left[u][k] - after.left[u][k];
    out.starts.row(i) = after.starts[u].row(k), out.shapes.row(i) = after.shapes[u].row(k);
    out.fitted.row(i) = after.columns[u].row(k);
  }
  find_used(&out.run);
  return out;
}

std::vector<HeldOutUnit> held_out_units(const SlowData& training, const std::vector<Split>& splits,
                                        const Prediction& before, const Prediction& after, bool only_within) {
  std::vector<HeldOutUnit> out;
  if (splits.empty()) {
    for (size_t q = 0; q < kQuarters; ++q)
      out.push_back(held_out_unit(training.campaign.runs[0], rows_of_quarter(training.campaign, q, only_within), before,
                                  after, out.size()));
    return out;
  }
  for (const Split& split : splits)
    for (size_t unit : split.units) {
      const CampaignRun& run = split.data.campaign.runs[unit];
      const std::vector<size_t> rows =
          only_within ? rows_within(split.data.campaign, unit, split.train) : all_rows(run, 0, run.n());
      out.push_back(held_out_unit(run, rows, before, after, out.size()));
    }
  return out;
}
size_t n_rows(const std::vector<HeldOutUnit>& units) {
  size_t n = 0;
  for (const HeldOutUnit& unit : units) n += unit.run.n();
  return n;
}

double mean_square_left(const std::vector<HeldOutUnit>& units, double dt_s) {
  std::vector<Minutes> minutes;
  for (const HeldOutUnit& unit : units) minutes.push_back(minutes_of(unit.left, dt_s));
  return mean_square(minutes);
}

// The same hypothesis with white noise alone: least squares.
SlowModel with_white_noise(SlowModel m) {
  m.noise_effect = nullptr, m.is_believed = false, m.is_noise_white = true;
  return m;
}

// What the errors of the fitted coefficients are expected to add to the mean square of the minutes, each unit about its mean, and
// the standard deviation of it: a quadratic form e'Ge of e ~ N(0, C) has mean tr(CG) and variance 2 tr(CGCG).  The deviations of
// units add up, as where one fit foretells all of them; where each has a fit of its own this is more than it is.  How noise and
// errors scatter together (4 tr of the product of both covariances) is left out.
void set_errors_of_fit(const std::vector<HeldOutUnit>& units, double dt_s, MinutesLeft* out) {
  double sum = 0, deviation = 0, n = 0;
  for (const HeldOutUnit& unit : units) {
    const long rows = rows_of_minute(dt_s), minutes = unit.left.size() / rows;
    n += static_cast<double>(minutes);
    if (minutes == 0 || unit.covariance.size() == 0) continue;
    MatrixXd means(minutes, unit.fitted.cols());
    for (long m = 0; m < minutes; ++m) means.row(m) = unit.fitted.middleRows(m * rows, rows).colwise().mean();
    means.rowwise() -= means.colwise().mean().eval();
    const MatrixXd product = unit.covariance * (means.transpose() * means);
    sum += product.trace(), deviation += std::sqrt(2 * std::max(0.0, (product * product).trace()));
  }
  if (n > 0) out->fit_ms_dph2 = sum / n, out->fit_ms_error_dph2 = deviation / n;
}

void set_residuals(const SlowSearch& search, const SlowModel& final, const std::vector<HeldOutUnit>& units, double dt_s,
                   MinutesLeft* out) {
  std::vector<Minutes> before, after;
  for (const HeldOutUnit& unit : units) {
    before.push_back(minutes_of(unit.left + unit.change, dt_s));
    after.push_back(minutes_of(unit.left, dt_s));
    after.back().strength = unit.run.own_strength;
    after.back().own_white_dph2 = unit.run.own_white_dph2 * dt_s;
  }
  out->rms_before_dph = std::sqrt(mean_square(before)), out->rms_after_dph = std::sqrt(mean_square(after));
  out->after = after, out->minute_s = minute_s(dt_s);
  const NoiseModel noise = gaussian_equivalent(search.seconds_noise_of(final));
  out->noise_rms_dph = out->rms_of_noise_dph(noise);
  set_errors_of_fit(units, dt_s, out);
  double error_dph2 = error_of_minutes(noise, out->minute_s, after);
  if (!noise.is_stationary()) { // another at every minute
    const MinutesOfNoise drawn = drawn_minutes(units, search.noise_of(final), dt_s);
    out->noise_rms_dph = std::sqrt(drawn.ms_dph2), error_dph2 = drawn.ms_error_dph2;
  }
  out->noise_error_dph = out->noise_rms_dph > 0 ? 0.5 * error_dph2 / out->noise_rms_dph : 0;
}

UnitMinutes unit_minutes(const HeldOutUnit& unit, double dt_s) {
  UnitMinutes out;
  out.log = unit.run.input.log;
  const long rows = rows_of_minute(dt_s), n = unit.left.size() / rows;
  const RunInput& in = unit.run.input;
  const auto mean_of = [&](const VectorXd& x) { // of each minute, about the mean of all rows
    std::vector<double> means;
    for (long m = 0; m < n; ++m) means.push_back(x.segment(m * rows, rows).mean() - x.mean());
    return means;
  };
  out.before_dph = mean_of(unit.left + unit.change), out.after_dph = mean_of(unit.left);
  for (long m = 0; m < n; ++m) {
    double rate = 0;
    for (long k = m * rows; k < (m + 1) * rows; ++k)
      rate += in.rate_dph[static_cast<size_t>(unit.run.used[static_cast<size_t>(k)])] / static_cast<double>(rows);
    const size_t middle = static_cast<size_t>(unit.run.used[static_cast<size_t>(m * rows + rows / 2)]);
    out.rate_dph.push_back(rate), out.t_s.push_back(time_in_log_s(unit.run, in.t_s[middle]));
    out.temp_degc.push_back(in.smooth_degc[middle]), out.slope_degc_min.push_back(in.rate_degc_min[middle]);
  }
  return out;
}

void set_shrinkage(const SlowSearch& search, const SlowModel& final, const std::vector<HeldOutUnit>& units,
                   GapResult* out) {
  if (!out->minutes.has_residual()) {
    out->ci_lo = -1, out->ci_hi = 1;
    return;
  }
  const Reduction found = reduction_of(units, search.noise_of(final));
  out->before = found.before_dph2, out->after = found.after_dph2;
  out->shrinkage = found.shrinkage, out->ci_lo = found.lo, out->ci_hi = found.hi;
}

} // namespace

CampaignRun only_quarter(const CampaignRun& run, size_t quarter, bool is_inside) {
  CampaignRun out = run;
  const size_t n = run.n();
  for (size_t k = 0; k < n; ++k)
    if ((k * kQuarters / n == quarter) != is_inside)
      out.input.rate_dph[static_cast<size_t>(run.used[k])] = std::nan("");
  find_used(&out);
  return out;
}

void FittedSpan::add(const CampaignRun& run, size_t first, size_t end) {
  for (size_t k = first; k < end; ++k) {
    const double temp_degc = run.input.smooth_degc[static_cast<size_t>(run.used[k])];
    lo_degc_ = std::min(lo_degc_, temp_degc), hi_degc_ = std::max(hi_degc_, temp_degc);
  }
}
bool FittedSpan::holds(double temp_degc) const {
  const double beyond = beyond_degc(lo_degc_, hi_degc_);
  return temp_degc > lo_degc_ - beyond && temp_degc < hi_degc_ + beyond;
}

const std::vector<double>& GapResult::gain_by_unit() const {
  return gain_of_seconds_by_unit.empty() ? foretold.delta_by_unit : gain_of_seconds_by_unit;
}
double GapResult::gain() const {
  return sum_of(gain_by_unit()) / foretold.hours;
}
void GapResult::hold_what_minutes_show() {
  const double removed = std::max(-1.0, 1 - minutes.part_left());
  // Where the scatter of the noise is not known, all that is above it counts.
  if (!has_mean || minutes.errors_above_noise() <= kLeastErrors || (removed > ci_lo && removed < ci_hi)) return;
  ci_lo = std::min(ci_lo, removed), ci_hi = std::max(ci_hi, removed);
  shrinkage = 0.5 * (shrinkage + removed);
}

SlowData with_held_out(const SlowData& training, const Campaign& held_out) {
  Campaign both = training.campaign;
  both.runs.insert(both.runs.end(), held_out.runs.begin(), held_out.runs.end());
  SlowData out(std::move(both));
  out.spread_dph = training.spread_dph;
  return out;
}

double predicted_nats(const SlowSearch& search, const SlowData& training, const Campaign* held_out,
                      const SlowModel& model) {
  HeldOut method;
  const bool is_single = !held_out && training.campaign.runs.size() == 1;
  const std::vector<Split> splits = is_single ? std::vector<Split>() : splits_of(training, held_out, &method);
  return sum_of(predict_all(search, training, splits, model).nats);
}

namespace {

// What one measurement asks, and what both hypotheses predict.
struct Measurement {
  const SlowSearch& search;
  const SlowData& training;
  const Campaign& campaign; // that is predicted
  const SlowModel &null, &final;
  std::vector<Split> splits = {}; // none: quarters of the only log
  Prediction before = {}, after = {};

  Prediction predict(const SlowModel& m, Chance chance = Chance::kFree) const {
    return predict_all(search, training, splits, m, chance);
  }
};

// Of the minutes of logs by the answer, over what a lesser one leaves.
double growth_by(const Measurement& m, const Prediction& less) {
  if (m.splits.empty()) return 1;
  const std::vector<HeldOutUnit> units = held_out_units(m.training, m.splits, less, m.after, true);
  return growth_of_minutes(units, m.campaign.dt_s);
}

// What each name is worth to the held-out data, and to data just as they are predicted.
void set_support(const Measurement& m, Foretold* out) {
  const std::vector<Split> ideal = as_predicted(m.splits, m.after);
  const auto ideal_nats = [&](const SlowModel& model) {
    return ideal.empty() ? std::nan("") : sum_of(predict_all(m.search, m.training, ideal, model).nats);
  };
  const double found = sum_of(m.after.nats), ideal_found = ideal_nats(m.final);
  const auto support = [&](const SlowModel& less, const Prediction& by_less) {
    return Support{found - sum_of(by_less.nats), ideal_found - ideal_nats(less)};
  };
  for (size_t i = 0; i < m.final.names.size(); ++i) {
    SlowModel starts = m.final;
    starts.names[i].is_start_only = true; // what is free in every run predicts none
    out->beyond_start.push_back(support(starts, m.predict(starts)));
    const SlowModel less = m.final.without(i);
    const Prediction by_less = m.predict(less);
    out->at_all.push_back(support(less, by_less));
    out->growth.push_back(growth_by(m, by_less));
  }
}

// Residuals and shrinkage: of what other data foretell.  Jumps in time are free before and after.
void set_figures(const Measurement& m, GapResult* out) {
  SlowModel null = m.null;
  null.steps = m.final.steps;
  const Prediction before = null.steps.empty() ? m.before : m.predict(null);
  const bool only_within = out->minutes.has_residual();
  const auto units_less = [&](const Prediction& less) {
    return held_out_units(m.training, m.splits, before, less, only_within);
  };
  const auto rms_less = [&](const Prediction& less) {
    return std::sqrt(mean_square_left(units_less(less), m.campaign.dt_s));
  };
  const bool leaves_chance = has_chance(m.search, m.final);
  const Prediction after = leaves_chance ? m.predict(m.final, Chance::kLeft) : m.after;
  std::vector<HeldOutUnit> units = units_less(after);
  // Slow noise can bend the polynomial away from what a table would hold: an answer is worth what it does better than the
  // plain polynomial, which needs no noise model.  Of one log it is that of the whole: one of three quarters goes astray in the
  // fourth by itself.
  const SlowModel white = with_white_noise(null);
  const Prediction plain = m.splits.empty() ? fitted_quarters(m.search, m.training, white) : m.predict(white);
  out->minutes.is_before_least_squares = rms_less(plain) < kClearlyLess * rms_less(before);
  if (out->minutes.is_before_least_squares) units = held_out_units(m.training, m.splits, plain, after, only_within);
  set_residuals(m.search, m.final, units, m.campaign.dt_s, &out->minutes);
  for (const HeldOutUnit& unit : units) out->units.push_back(unit_minutes(unit, m.campaign.dt_s));
  if (leaves_chance)
    out->minutes.run_to_run_rms_dph =
        std::sqrt(std::max(0.0, std::pow(out->minutes.rms_after_dph, 2) - std::pow(rms_less(m.after), 2)));
  out->has_mean = std::any_of(m.final.names.begin(), m.final.names.end(),
                              [&](const auto& name) { return !is_by_chance(m.search, name); });
  if (out->has_mean) set_shrinkage(m.search, m.final, units, out);
}

} // namespace

GapResult measure_gap(const SlowSearch& search, const SlowData& training, const Campaign* held_out,
                      const SlowModel& null, const SlowModel& final) {
  GapResult out;
  const bool is_single = !held_out && training.campaign.runs.size() == 1;
  Measurement m{search, training, held_out ? *held_out : training.campaign, null, final};
  if (is_single)
    out.method = HeldOut::kQuarters;
  else
    m.splits = splits_of(training, held_out, &out.method);
  m.before = m.predict(null), m.after = m.predict(final);
  Foretold& foretold = out.foretold;
  for (size_t u = 0; u < m.before.nats.size(); ++u) {
    foretold.delta_by_unit.push_back(2 * (m.after.nats[u] - m.before.nats[u]));
    foretold.log_by_unit.push_back(m.campaign.runs[is_single ? 0 : u].input.log);
  }
  foretold.delta_deviance = sum_of(foretold.delta_by_unit);
  foretold.hours = std::max(kLeast_h, hours_of(m.campaign));
  out.gain_mean_s = training.campaign.dt_s;
  set_support(m, &out.foretold);
  out.minutes.part_within = static_cast<double>(n_rows(held_out_units(training, m.splits, m.before, m.after, true))) /
                            static_cast<double>(m.campaign.n());
  if (held_out && !final.is_believed) out.minutes.per_hour_fitted = foretold.hours / hours_of(training.campaign);
  set_figures(m, &out);
  return out;
}

} // namespace imucal
