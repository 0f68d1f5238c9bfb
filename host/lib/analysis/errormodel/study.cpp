// SPDX-License-Identifier: MIT
#include "analysis/errormodel/study.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

#include "analysis/errormodel/simulate.h"
#include "base/error.h"
#include "base/parallel.h"
#include "base/quantile.h"
#include "physics/effects/closed_forms.h"

namespace imucal {

Spread spread_of(std::vector<double> v) {
  Spread s;
  v.erase(std::remove_if(v.begin(), v.end(), [](double x) { return !std::isfinite(x); }), v.end());
  if (v.empty()) return s;
  std::sort(v.begin(), v.end());
  for (double x : v) s.mean += x / static_cast<double>(v.size());
  for (double x : v) s.sd += (x - s.mean) * (x - s.mean);
  s.sd = v.size() > 1 ? std::sqrt(s.sd / static_cast<double>(v.size() - 1)) : 0;
  const auto at = [&](double p) { return v[static_cast<size_t>(std::lround(p * static_cast<double>(v.size() - 1)))]; };
  s.q05 = at(0.05), s.median = at(0.5), s.q95 = at(0.95);
  return s;
}

namespace {

Series simulated(const std::vector<NoiseComponent>& components, long n, double dt_s, uint64_t seed, uint64_t run,
                 uint32_t axis, const Detrend& detrend) {
  Series s = empty_record(n, dt_s);
  s.log = "simulated run " + std::to_string(run);
  s.axis = "rate_dph";
  s.rate_dph = simulate_noise(components, n, seed, run, axis);
  remove_trend(detrend, &s);
  return s;
}

} // namespace

Separation separation(const SeparationSettings& o, const DpOperator& op) {
  const std::vector<NoiseComponent> components[2] = {noise_components(o.model, o.dt_s),
                                                     noise_components(o.versus, o.dt_s)};
  const auto n = static_cast<long>(std::lround(o.duration_s / o.dt_s));
  Separation out;
  out.longest_s.resize(static_cast<size_t>(o.draws));
  std::vector<std::vector<char>> apart(static_cast<size_t>(o.draws));
  std::vector<std::vector<double>> first[2];
  parallel_for(o.draws, o.threads, [&](long draw) {
    std::vector<double> lo[2], hi[2];
    for (uint32_t which = 0; which < 2; ++which)
      for (int run = 0; run < o.runs; ++run) {
        const Series s = simulated(components[which], n, o.dt_s, o.seed, static_cast<uint64_t>(draw * o.runs + run),
                                   which, Detrend{});
        const auto dp = dp_curve(s, DpRecord(s, op), o.tau_s, DpEstimator::kRms).dp_dph;
        if (run == 0) lo[which] = hi[which] = dp;
        for (size_t i = 0; i < dp.size(); ++i)
          lo[which][i] = std::min(lo[which][i], dp[i]), hi[which][i] = std::max(hi[which][i], dp[i]);
        if (draw == 0) first[which].push_back(dp);
      }
    auto& flags = apart[static_cast<size_t>(draw)];
    double longest = 0;
    size_t start = 0;
    for (size_t i = 0; i < o.tau_s.size(); ++i) {
      flags.push_back(lo[0][i] > hi[1][i] || lo[1][i] > hi[0][i]);
      if (!flags[i])
        start = i + 1;
      else
        longest = std::max(longest, o.tau_s[i] - o.tau_s[start]);
    }
    out.longest_s[static_cast<size_t>(draw)] = longest;
  });
  out.spread = spread_of(out.longest_s);
  out.separated_frac.assign(o.tau_s.size(), 0.0);
  for (const auto& flags : apart)
    for (size_t i = 0; i < flags.size(); ++i) out.separated_frac[i] += flags[i] / static_cast<double>(o.draws);
  out.model_curves = first[0], out.versus_curves = first[1];
  return out;
}

ErrorModel fit_model(const std::vector<Series>& series, const DpOperator& op, const FitSettings& o) {
  if (o.criterion == "ml") return fit_maximum_likelihood(Likelihood(series, o.detrend), o.n_markov).model;
  const CurveData data = make_curve_data(series, op, o.detrend, o.tau_s, o.across);
  return (o.criterion == "ls" ? fit_least_squares(data, o.n_markov)
                              : fit_bound(raised_to_confidence(data, o.confidence), o.n_markov))
      .model;
}

namespace {

struct Named {
  std::string name;
  double value;
};

std::vector<Named> named_parameters(const ErrorModel& m) {
  std::vector<Named> out = {{"arw_deg_rt_h", m.arw_deg_rt_h}};
  for (size_t k = 0; k < m.markov.size(); ++k) {
    const std::string head = "markov[" + std::to_string(k) + "].";
    out.push_back({head + "sigma_dph", m.markov[k].sigma_dph});
    out.push_back({head + "tau_s", m.markov[k].tau_s});
  }
  return out;
}

// Student's t that is exceeded with probability `tail`, below 1/2.
double student_t(double tail, double dof) {
  const double x = beta_quantile(2 * tail, 0.5 * dof, 0.5);
  return std::sqrt(dof * (1 - x) / x);
}

// The fit's error is one more draw of what the errors of the refits are drawn from.  Of m normal draws the next one lies
// within mean +- t(m - 1) s sqrt(1 + 1/m) with the stated probability, whatever m: quantiles of a few draws are narrower (of
// 40: 1.76 standard deviations instead of 1.96), and leave out that their mean and spread are known so and so well.
void set_interval(const std::vector<double>& log_refits, ParameterError* e) {
  const Spread spread = spread_of(log_refits);
  const auto m = static_cast<double>(log_refits.size());
  e->log_std_error = spread.sd;
  e->std_error = e->value * spread.sd;
  const double reach = student_t(0.025, m - 1) * spread.sd * std::sqrt(1 + 1 / m);
  const double log_value = std::log(e->value), bias = spread.mean - log_value;
  e->ci95_lo = std::exp(log_value - bias - reach);
  e->ci95_hi = std::exp(log_value - bias + reach);
}

} // namespace

namespace {

// Simulated records of one model, of the shapes of others, refitted.
class Refitting {
public:
  Refitting(const std::vector<Series>& series, const DpOperator& op, const FitSettings& settings,
            const ErrorModel& fitted, uint64_t seed, std::shared_ptr<const CurveBasis> basis)
      : series_(series), op_(op), settings_(settings), components_(noise_components(fitted, op.dt_s)), seed_(seed),
        basis_(std::move(basis)) {
    settings_.n_markov = static_cast<int>(fitted.markov.size());
    if (settings.criterion == "ml") return;
    for (const Series& s : series) trends_.emplace_back(s, settings.detrend);
    if (!basis_)
      basis_ = std::make_shared<CurveBasis>(
          make_curve_data(series, op, settings.detrend, settings.tau_s, settings.across, Windows::kSome));
  }

  // Runs whose random numbers are drawn together.
  long together() const {
    const size_t streams = std::max<size_t>(1, components_.size() * series_.size());
    return static_cast<long>(std::max<size_t>(1, kStreamsAbreast / streams));
  }

  // The records of some runs, one after the other.
  std::vector<std::vector<Series>> simulated(long first_run, long runs) const {
    std::vector<NoiseRecord> wanted;
    for (size_t a = 0; a < series_.size(); ++a)
      for (long k = 0; k < runs; ++k)
        wanted.push_back({series_[a].size(), static_cast<uint64_t>(first_run + k), static_cast<uint32_t>(a)});
    std::vector<std::vector<double>> rates = simulate_noises(components_, seed_, wanted);
    std::vector<std::vector<Series>> out(static_cast<size_t>(runs));
    for (size_t i = 0; i < wanted.size(); ++i)
      out[wanted[i].run - static_cast<uint64_t>(first_run)].push_back(shaped_like(wanted[i].axis, std::move(rates[i])));
    return out;
  }

  ErrorModel refit(const std::vector<Series>& again) const {
    if (settings_.criterion == "ml") return fit_model(again, op_, settings_);
    CurveData data = make_curve_data(again, op_, settings_.detrend, settings_.tau_s, settings_.across, Windows::kSome);
    data.basis = basis_;
    return (settings_.criterion == "ls"
                ? fit_least_squares(data, settings_.n_markov)
                : fit_bound(raised_to_confidence(data, settings_.confidence), settings_.n_markov))
        .model;
  }

private:
  Series shaped_like(size_t a, std::vector<double> rate_dph) const {
    const Series& shape = series_[a];
    Series s;
    s.log = shape.log, s.axis = shape.axis, s.t0_s = shape.t0_s, s.dt_s = shape.dt_s, s.n_missing = shape.n_missing;
    if (settings_.criterion == "ml") s.temp_degc = shape.temp_degc;
    s.rate_dph = std::move(rate_dph);
    if (shape.n_missing > 0)
      for (size_t i = 0; i < s.rate_dph.size(); ++i)
        if (std::isnan(shape.rate_dph[i])) s.rate_dph[i] = shape.rate_dph[i];
    if (!trends_.empty()) trends_[a].remove_from(&s);
    return s;
  }

  const std::vector<Series>& series_;
  const DpOperator& op_;
  FitSettings settings_;
  std::vector<NoiseComponent> components_;
  uint64_t seed_;
  std::shared_ptr<const CurveBasis> basis_;
  std::vector<Trend> trends_; // of each series
};

// Models of the refits that were done.
std::vector<ErrorModel> refitted(const Refitting& refitting, int runs, int threads,
                                 const std::function<bool(long)>& watch) {
  std::vector<std::optional<ErrorModel>> refits(static_cast<size_t>(runs));
  std::atomic<bool> is_over{false};
  std::atomic<long> n_done{0};
  const long together = std::min(refitting.together(), std::max(1L, static_cast<long>(runs) / std::max(1, threads)));
  parallel_for((runs + together - 1) / together, threads,
               [&](long i) {
                 if (is_over) return;
                 const long first = i * together;
                 std::vector<std::vector<Series>> records =
                     refitting.simulated(first, std::min(together, runs - first));
                 for (size_t k = 0; k < records.size() && !is_over; ++k, ++n_done) {
                   refits[static_cast<size_t>(first) + k] = refitting.refit(records[k]);
                   records[k].clear();
                 }
               },
               [&] {
                 if (watch && !watch(n_done)) is_over = true;
               });
  std::vector<ErrorModel> out;
  for (const std::optional<ErrorModel>& refit : refits)
    if (refit) out.push_back(*refit);
  return out;
}

} // namespace

std::vector<ParameterError> bootstrap_errors(const std::vector<Series>& series, const DpOperator& op,
                                             const FitSettings& o, const ErrorModel& fitted, int runs, uint64_t seed,
                                             int threads, std::shared_ptr<const CurveBasis> basis,
                                             const std::function<bool(long)>& watch) {
  const auto names = named_parameters(fitted);
  std::vector<std::vector<double>> values(names.size());
  std::vector<int> vanished(names.size(), 0);
  const std::vector<ErrorModel> refits =
      refitted(Refitting(series, op, o, fitted, seed, std::move(basis)), runs, threads, watch);
  for (const ErrorModel& refit : refits) {
    // Terms are matched in the order of their time constants; a missing one is counted against the last.
    const auto got = named_parameters(refit);
    for (size_t p = 0; p < names.size(); ++p) {
      if (p < got.size() && got[p].value > 0)
        values[p].push_back(std::log(got[p].value));
      else
        ++vanished[p];
    }
  }
  std::vector<ParameterError> out;
  for (size_t p = 0; p < names.size(); ++p) {
    ParameterError e;
    e.name = names[p].name, e.value = names[p].value;
    e.n_refits = static_cast<long>(refits.size());
    e.vanished_frac = refits.empty() ? 0 : static_cast<double>(vanished[p]) / static_cast<double>(refits.size());
    if (values[p].size() > 3 && e.value > 0) {
      set_interval(values[p], &e);
    } else {
      e.log_std_error = e.std_error = std::numeric_limits<double>::infinity();
    }
    out.push_back(e);
  }
  return out;
}

std::vector<ParameterError> likelihood_errors(const MlFit& fit) {
  std::vector<ParameterError> out;
  for (const MlParameter& p : fit.parameters) {
    ParameterError e;
    e.name = p.name, e.value = p.value, e.log_std_error = p.log_std_error;
    e.std_error = p.value * p.log_std_error;
    e.ci95_lo = p.ci95_lo, e.ci95_hi = p.ci95_hi;
    out.push_back(e);
  }
  return out;
}

void judge_parameters(double record_s, double dt_s, std::vector<ParameterError>* parameters) {
  const auto refuse = [](ParameterError* p, const std::string& reason) { p->verdict = "no", p->reason = reason; };
  for (ParameterError& p : *parameters) {
    const bool is_tau = p.name.find("tau_s") != std::string::npos;
    char text[160];
    if (is_tau && p.value >= 0.98 * record_s / 3) {
      refuse(&p, "at or beyond a third of the record: only sigma^2/tau, the rate of its walk, is known");
    } else if (is_tau && p.value < 3 * dt_s) {
      refuse(&p, "as fast as the sampling: cannot be told from white noise");
    } else if (p.vanished_frac > 0.1) {
      std::snprintf(text, sizeof text, "the term is absent from %.0f %% of refits of simulated records",
                    100 * p.vanished_frac);
      refuse(&p, text);
    } else {
      std::snprintf(text, sizeof text, "relative standard error %.0f %%", 100 * p.log_std_error);
      p.reason = text;
      p.verdict = p.log_std_error < 0.35 ? "yes" : p.log_std_error < 0.8 ? "weak" : "no";
    }
  }
}

namespace {

struct OneRun {
  bool bounded = false, bounds_truth = false, bounds_new = false;
  double new_worst = 0, excess_mean = 0, excess_worst = 0, over_grid = 0, ms = 0;
  ErrorModel model;
  std::vector<MlParameter> intervals;
};

double elapsed_ms(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - since).count();
}

OneRun validate_once(const ValidateSettings& o, const DpOperator& op, const std::vector<NoiseComponent>& components,
                     long run) {
  const auto n = static_cast<long>(std::lround(o.duration_s / o.dt_s));
  OneRun out;
  const std::vector<Series> own = {
      simulated(components, n, o.dt_s, o.seed, static_cast<uint64_t>(run), 0, o.fit.detrend)};
  const std::vector<Series> other = {
      simulated(components, n, o.dt_s, o.seed, static_cast<uint64_t>(run), 1, o.fit.detrend)};
  if (o.fit.criterion == "ml") {
    const auto start = std::chrono::steady_clock::now();
    const MlFit fit = fit_maximum_likelihood(Likelihood(own, o.fit.detrend), o.fit.n_markov);
    out.ms = elapsed_ms(start);
    out.model = fit.model, out.intervals = fit.parameters;
    if (o.fit.tau_s.empty()) return out;
  }
  const CurveData data = make_curve_data(own, op, o.fit.detrend, o.fit.tau_s, Across::kRms);
  const CurveData fresh = make_curve_data(other, op, o.fit.detrend, o.fit.tau_s, Across::kRms);
  if (o.fit.criterion != "ml") {
    const auto start = std::chrono::steady_clock::now();
    const CurveFit fit = o.fit.criterion == "ls"
                             ? fit_least_squares(data, o.fit.n_markov)
                             : fit_bound(raised_to_confidence(data, o.fit.confidence), o.fit.n_markov);
    out.ms = elapsed_ms(start);
    out.model = fit.model;
    out.over_grid = fit.objective / fit.grid_objective;
  }
  const CurveBasis basis(data);
  const auto square = basis.model(out.model), truth = basis.model(o.truth);
  const Excess excess = excess_of(data, square), again = excess_of(fresh, square);
  out.bounded = excess.worst_ratio >= 1 - 1e-9;
  out.bounds_new = again.worst_ratio >= 1;
  out.new_worst = again.worst_ratio;
  out.excess_mean = excess.mean, out.excess_worst = excess.worst;
  out.bounds_truth = true;
  for (size_t i = 0; i < square.size(); ++i) out.bounds_truth = out.bounds_truth && square[i] >= truth[i];
  return out;
}

} // namespace

Validation validate(const ValidateSettings& o, const DpOperator& op) {
  const auto components = noise_components(o.truth, o.dt_s);
  std::vector<OneRun> runs(static_cast<size_t>(o.runs));
  parallel_for(o.runs, o.threads,
               [&](long run) { runs[static_cast<size_t>(run)] = validate_once(o, op, components, run); });
  Validation v;
  v.runs = o.runs;
  const double each = 1.0 / o.runs;
  std::vector<double> worst, mean, largest, over, ms;
  auto truth = named_parameters(o.truth);
  std::vector<std::vector<double>> errors(truth.size());
  std::vector<double> covered(truth.size(), 0.0);
  for (const OneRun& r : runs) {
    v.bounded_frac += r.bounded * each, v.bounds_new_frac += r.bounds_new * each,
        v.bounds_truth_frac += r.bounds_truth * each;
    worst.push_back(r.new_worst), mean.push_back(r.excess_mean), largest.push_back(r.excess_worst);
    over.push_back(r.over_grid), ms.push_back(r.ms);
    v.terms_frac.resize(std::max(v.terms_frac.size(), r.model.markov.size() + 1), 0.0);
    v.terms_frac[r.model.markov.size()] += each;
    if (r.model.markov.size() != o.truth.markov.size()) continue;
    const auto got = named_parameters(r.model);
    for (size_t p = 0; p < truth.size(); ++p) {
      errors[p].push_back(std::log(got[p].value / truth[p].value));
      if (p < r.intervals.size())
        covered[p] += r.intervals[p].ci95_lo <= truth[p].value && truth[p].value <= r.intervals[p].ci95_hi;
    }
  }
  v.new_worst_ratio = spread_of(worst), v.excess_mean = spread_of(mean), v.excess_worst = spread_of(largest);
  v.objective_over_grid = spread_of(over), v.fit_ms = spread_of(ms);
  for (size_t p = 0; p < truth.size(); ++p) {
    v.names.push_back(truth[p].name);
    v.parameters.push_back(spread_of(errors[p]));
    double square = 0;
    for (double e : errors[p]) square += e * e / static_cast<double>(errors[p].size());
    v.rms_log_error.push_back(std::sqrt(square));
    v.coverage.push_back(o.fit.criterion == "ml" && !errors[p].empty()
                             ? covered[p] / static_cast<double>(errors[p].size())
                             : std::nan(""));
  }
  return v;
}

} // namespace imucal
