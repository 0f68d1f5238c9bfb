// SPDX-License-Identifier: MIT
#include "analysis/diagnose/gap.h"

#include <algorithm>
#include <cmath>

#include "base/rng.h"
#include "base/units.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kMinute_s = 60;
constexpr double kNoiseInDoubt = 0.5; // part of what counts as noise that may be left of the gap: lower limit
constexpr double kOverlap = 1e-9;

// A residual path as the nominal model's filter follows it.
struct FollowedPath {
  VectorXd cumulative; // sum of the samples before k
  VectorXd estimate;   // of sample k, from those before it
};
FollowedPath followed(const VectorXd& x, double phi, double gain) {
  FollowedPath out{VectorXd(x.size() + 1), VectorXd(x.size() + 1)};
  double sum = 0, estimate = 0;
  for (long k = 0; k < x.size(); ++k) {
    out.cumulative[k] = sum, out.estimate[k] = estimate;
    sum += x[k];
    estimate = phi * (estimate + gain * (x[k] - estimate));
  }
  out.cumulative[x.size()] = sum, out.estimate[x.size()] = estimate;
  return out;
}

// DP2 of a residual path: error of the mean over the next n samples, predicted by the nominal model's filter.
// Each tau is a whole number of steps dt, at least one.
std::vector<double> dp2(const std::vector<VectorXd>& paths, const NoiseModel& nominal, double dt_s,
                        const std::vector<double>& tau_s) {
  constexpr long kStart = 300; // samples until the filter has settled
  const double phi = nominal.markov.empty() ? 0 : nominal.markov[0].phi(dt_s);
  const double q = nominal.markov.empty() ? 0 : nominal.markov[0].q_dph2(dt_s);
  const double r = nominal.white_sigma_dph * nominal.white_sigma_dph / dt_s;
  double p = q / std::max(1e-12, 1 - phi * phi);
  for (int i = 0; i < 5000; ++i) p = phi * phi * p * r / (p + r) + q;
  std::vector<FollowedPath> all;
  for (const VectorXd& x : paths) all.push_back(followed(x, phi, p / (p + r)));
  std::vector<double> out;
  for (double tau : tau_s) {
    const long n = std::lround(tau / dt_s), stride = std::max<long>(1, n / 10);
    double sum = 0, count = 0;
    for (const FollowedPath& path : all)
      for (long k = (kStart / stride + 1) * stride; k + n < path.cumulative.size(); k += stride) {
        const double mean = (path.cumulative[k + n] - path.cumulative[k]) / static_cast<double>(n);
        sum += (mean - path.estimate[k]) * (mean - path.estimate[k]), count += 1;
      }
    out.push_back(count > 0 ? std::sqrt(sum / count / 2) : std::nan(""));
  }
  return out;
}

// Data with the places of what is learned from and what is predicted.
struct Split {
  SlowData data;
  std::vector<char> train, all; // per run
  std::vector<size_t> units;    // runs
};

// Mean squares of the minutes of one unit, and their number.
struct Minutes {
  double sum = 0, n = 0;
};
Minutes minutes_of(VectorXd rest, double dt_s) {
  Minutes out;
  const long minute = std::max(1L, std::lround(kMinute_s / dt_s));
  if (rest.size() > 0) rest.array() -= rest.mean();
  for (long k = 0; k + minute <= rest.size(); k += minute)
    out.sum += std::pow(rest.segment(k, minute).mean(), 2), out.n += 1;
  return out;
}

// What one hypothesis makes of the held-out units of a split.
struct Prediction {
  std::vector<double> nats;  // per unit
  std::vector<Minutes> rest; // per unit
  std::vector<std::vector<VectorXd>>
      mean; // per split and unit: what it predicts there, constants and start states fitted
};
Prediction predict(const SlowSearch& search, const Split& split, const SlowModel& model) {
  Prediction out;
  out.mean.emplace_back();
  const std::vector<MeanPart> parts = search.parts_on(split.data, model);
  std::vector<const MeanPart*> pointers;
  for (const MeanPart& part : parts) pointers.push_back(&part);
  const RunGrams grams(split.data, pointers, search.noise_of(model));
  const double trained = grams.log_marginal(1, split.train);
  const RunGrams::Posterior at = grams.posterior(split.train);
  for (size_t unit : split.units) {
    std::vector<char> with = split.train;
    with[unit] = 1;
    out.nats.push_back(grams.log_marginal(1, with) - trained);
    const VectorXd rest = residual_of(split.data, parts, at, unit);
    out.mean.back().push_back(split.data.y[unit] - rest);
    out.rest.push_back(minutes_of(rest, split.data.campaign.dt_s));
  }
  return out;
}

std::vector<Split> splits_of(const SlowData& training, const Campaign* held_out, HeldOut* method) {
  std::vector<Split> out;
  const size_t n = training.campaign.runs.size();
  if (held_out) {
    *method = HeldOut::kLogs;
    Campaign both = training.campaign;
    for (const CampaignRun& run : held_out->runs) both.runs.push_back(run);
    Split split{SlowData(both), std::vector<char>(both.runs.size(), 0), {}, {}};
    std::fill_n(split.train.begin(), n, 1);
    for (size_t r = n; r < both.runs.size(); ++r) split.units.push_back(r);
    split.data.spread_dph = training.spread_dph;
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
CampaignRun only_rows(const CampaignRun& run, size_t quarter, bool is_inside) {
  CampaignRun out = run;
  const size_t n = run.n();
  for (size_t k = 0; k < n; ++k)
    if ((k * 4 / n == quarter) != is_inside) out.input.rate_dph[static_cast<size_t>(run.used[k])] = std::nan("");
  find_used(&out);
  return out;
}

Prediction predict_quarters(const SlowSearch& search, const SlowData& training, const SlowModel& model) {
  Prediction out;
  const auto grams_on = [&](const SlowData& data, std::vector<MeanPart>* parts) {
    *parts = search.parts_on(data, model);
    std::vector<const MeanPart*> pointers;
    for (const MeanPart& part : *parts) pointers.push_back(&part);
    return RunGrams(data, pointers, search.noise_of(model));
  };
  std::vector<MeanPart> parts;
  const double whole = grams_on(training, &parts).log_marginal(1);
  for (size_t q = 0; q < 4; ++q) {
    Campaign rest = training.campaign;
    rest.runs[0] = only_rows(training.campaign.runs[0], q, false);
    SlowData data(rest, training);
    std::vector<MeanPart> rest_parts;
    const RunGrams grams = grams_on(data, &rest_parts);
    out.nats.push_back(whole - grams.log_marginal(1));
    VectorXd left = residual_of(training, parts, grams.posterior(), 0);
    const long n = left.size(), first = static_cast<long>(q) * n / 4, last = static_cast<long>(q + 1) * n / 4;
    out.rest.push_back(minutes_of(left.segment(first, last - first), training.campaign.dt_s));
  }
  return out;
}

Prediction predict_all(const SlowSearch& search, const SlowData& training, const std::vector<Split>& splits,
                       const SlowModel& model) {
  if (splits.empty()) return predict_quarters(search, training, model);
  Prediction out;
  for (const Split& split : splits) {
    const Prediction one = predict(search, split, model);
    out.nats.insert(out.nats.end(), one.nats.begin(), one.nats.end());
    out.rest.insert(out.rest.end(), one.rest.begin(), one.rest.end());
    out.mean.insert(out.mean.end(), one.mean.begin(), one.mean.end());
  }
  return out;
}
// The held-out units as a hypothesis predicts them.
std::vector<Split> as_predicted(std::vector<Split> splits, const Prediction& by) {
  for (size_t s = 0; s < splits.size(); ++s)
    for (size_t u = 0; u < splits[s].units.size(); ++u) splits[s].data.y[splits[s].units[u]] = by.mean[s][u];
  return splits;
}

double sum_of(const std::vector<double>& x) {
  double sum = 0;
  for (double v : x) sum += v;
  return sum;
}
double mean_square(const std::vector<Minutes>& rest) {
  double sum = 0, n = 0;
  for (const Minutes& m : rest) sum += m.sum, n += m.n;
  return n > 0 ? sum / n : 0;
}

// Variance of the mean of a Markov process of unit variance over a time of t/tau: its covariance exp(-|u|/tau), integrated
// over the square of that time.
double mean_of_markov(double t_over_tau) {
  const double a = t_over_tau;
  return a < 1e-4 ? 1 - a / 3 : 2 / (a * a) * (a + std::expm1(-a));
}
// Mean square of one-minute means of the noise itself about their mean over a unit of `length_s`.
double noise_of_minutes(const NoiseModel& noise, double length_s) {
  const double length = std::max(length_s, 2 * kMinute_s);
  double sum = noise.white_sigma_dph * noise.white_sigma_dph * (1 / kMinute_s - 1 / length);
  for (const Markov& m : noise.markov)
    sum += m.sigma_dph * m.sigma_dph * (mean_of_markov(kMinute_s / m.tau_s) - mean_of_markov(length / m.tau_s));
  const double walk = noise.walk_dph_per_rt_s;
  return sum + walk * walk * (length - kMinute_s) / 6;
}
// The same over units of different lengths, weighted by their minutes.
double noise_of_units(const NoiseModel& noise, const std::vector<Minutes>& rest) {
  double sum = 0, n = 0;
  for (const Minutes& m : rest) sum += m.n * noise_of_minutes(noise, m.n * kMinute_s), n += m.n;
  return n > 0 ? sum / n : 0;
}

// 95 % factor of Student's t for few units.
double t_factor(size_t units) {
  static const double table[] = {12.7, 12.7, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36};
  return units < 2 ? 0 : units - 1 < 8 ? table[units - 1] : 2.1;
}

void set_shrinkage(const Prediction& before, const Prediction& after, GapResult* out) {
  const double noise = std::min(out->noise_rms_dph * out->noise_rms_dph, mean_square(after.rest));
  const double ms_before = mean_square(before.rest), ms_after = mean_square(after.rest);
  out->before = std::max(0.0, ms_before - noise), out->after = std::max(0.0, ms_after - noise);
  if (!(out->before > 1e-9 * ms_before)) return;
  const double removed = ms_before - ms_after;
  out->shrinkage = std::clamp(removed / out->before, -1.0, 1.0);
  std::vector<double> parts;
  double square = 0, n = 0;
  for (const Minutes& m : before.rest) n += m.n;
  for (size_t u = 0; u < before.rest.size(); ++u)
    parts.push_back((before.rest[u].sum - after.rest[u].sum) / n * static_cast<double>(before.rest.size()));
  for (double p : parts) square += std::pow(p - removed, 2);
  const double units = static_cast<double>(parts.size());
  const double error = units > 1 ? std::sqrt(square / (units - 1) / units) : std::fabs(removed);
  const double half = t_factor(parts.size()) * error / out->before;
  const double in_doubt = removed / std::max(out->before, ms_before - kNoiseInDoubt * noise);
  // The spread between units is partly one of what there was to remove, which the ratio does not have.
  const double lower = std::min(in_doubt, out->shrinkage - std::min(half, 0.35 * (1 + std::fabs(out->shrinkage))));
  out->ci_lo = std::clamp(lower, -1.0, out->shrinkage);
  out->ci_hi = std::clamp(out->shrinkage + half, out->shrinkage, 1.0);
}

} // namespace

double predicted_nats(const SlowSearch& search, const SlowData& training, const Campaign* held_out,
                      const SlowModel& model) {
  HeldOut method;
  const bool is_single = !held_out && training.campaign.runs.size() == 1;
  const std::vector<Split> splits = is_single ? std::vector<Split>() : splits_of(training, held_out, &method);
  return sum_of(predict_all(search, training, splits, model).nats);
}

GapResult measure_gap(const SlowSearch& search, const SlowData& training, const Campaign* held_out,
                      const SlowModel& null, const SlowModel& final) {
  GapResult out;
  const bool is_single = !held_out && training.campaign.runs.size() == 1;
  std::vector<Split> splits;
  if (is_single)
    out.method = HeldOut::kQuarters;
  else
    splits = splits_of(training, held_out, &out.method);
  const Prediction before = predict_all(search, training, splits, null);
  const Prediction after = predict_all(search, training, splits, final);
  for (size_t u = 0; u < before.nats.size(); ++u) out.delta_by_unit.push_back(2 * (after.nats[u] - before.nats[u]));
  out.delta_deviance = sum_of(out.delta_by_unit);
  const std::vector<Split> ideal = as_predicted(splits, after);
  const double ideal_nats = ideal.empty() ? std::nan("") : sum_of(predict_all(search, training, ideal, final).nats);
  const auto support = [&](const SlowModel& less) {
    return GapResult::Support{sum_of(after.nats) - sum_of(predict_all(search, training, splits, less).nats),
                              ideal.empty() ? std::nan("")
                                            : ideal_nats - sum_of(predict_all(search, training, ideal, less).nats)};
  };
  for (size_t i = 0; i < final.names.size(); ++i) {
    SlowModel less = final;
    less.names[i].is_start_only = true; // what is free in every run predicts none
    out.beyond_start.push_back(support(less));
    out.at_all.push_back(support(final.without(i)));
  }
  double seconds = 0;
  const Campaign& units = held_out ? *held_out : training.campaign;
  seconds = static_cast<double>(units.n()) * units.dt_s;
  out.hours = std::max(kOverlap, seconds / 3600);
  out.gain = out.delta_deviance / out.hours;
  out.rms_before_dph = std::sqrt(mean_square(before.rest)), out.rms_after_dph = std::sqrt(mean_square(after.rest));
  out.noise_rms_dph = std::sqrt(noise_of_units(search.seconds_noise_of(final), after.rest));
  out.has_mean = !final.names.empty();
  if (out.has_mean) set_shrinkage(before, after, &out);
  return out;
}

namespace {

std::vector<VectorXd> simulated(const Campaign& seconds, const NoiseModel& noise, uint64_t seed, uint64_t draw) {
  std::vector<VectorXd> out;
  const NoiseModel gaussian = gaussian_equivalent(noise);
  for (size_t r = 0; r < seconds.runs.size(); ++r) {
    const Rng rng(seed, draw, static_cast<uint32_t>(r), static_cast<uint32_t>(Stream::kTool) + 9);
    const RunGains gains = compute_gains(seconds.runs[r], gaussian);
    VectorXd x(static_cast<long>(seconds.runs[r].n()));
    rng.normals(0, static_cast<size_t>(x.size()), x.data());
    colour(gains, x.data(), static_cast<size_t>(x.size()));
    out.push_back(std::move(x));
  }
  return out;
}

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0, n = 0;
  for (size_t i = 0; i < a.size(); ++i)
    if (std::isfinite(a[i]) && std::isfinite(b[i])) sum += std::pow(a[i] - b[i], 2), n += 1;
  return n > 0 ? std::sqrt(sum / n) : 0;
}

} // namespace

void compare_dp2(const Campaign& seconds, const NoiseModel& nominal, const NoiseModel& final, const Fit& before,
                 const Fit& after, uint64_t seed, GapResult* gap) {
  double shortest = 1e300;
  for (const CampaignRun& run : seconds.runs)
    shortest = std::min(shortest, static_cast<double>(run.n()) * seconds.dt_s);
  for (double tau = std::max(2.0, seconds.dt_s); tau <= shortest / 4; tau *= 1.6) {
    const double whole = seconds.dt_s * std::round(tau / seconds.dt_s);
    if (gap->dp2_tau_s.empty() || whole > gap->dp2_tau_s.back()) gap->dp2_tau_s.push_back(whole);
  }
  const auto curve_of = [&](const NoiseModel& noise) {
    std::vector<double> square(gap->dp2_tau_s.size(), 0.0);
    constexpr int kDraws = 2;
    for (int d = 0; d < kDraws; ++d) {
      const std::vector<double> c =
          dp2(simulated(seconds, noise, seed, static_cast<uint64_t>(d)), nominal, seconds.dt_s, gap->dp2_tau_s);
      for (size_t i = 0; i < square.size(); ++i) square[i] += c[i] * c[i] / kDraws;
    }
    for (double& s : square) s = std::sqrt(s);
    return square;
  };
  gap->dp2_data_dph = dp2(before.residual, nominal, seconds.dt_s, gap->dp2_tau_s);
  const std::vector<double> left = dp2(after.residual, nominal, seconds.dt_s, gap->dp2_tau_s);
  gap->dp2_nominal_dph = curve_of(nominal);
  gap->dp2_final_dph = final == nominal ? gap->dp2_nominal_dph : curve_of(final);
  gap->dp2_before_dph = distance(gap->dp2_data_dph, gap->dp2_nominal_dph);
  gap->dp2_after_dph = distance(left, gap->dp2_final_dph);
}

} // namespace imucal
