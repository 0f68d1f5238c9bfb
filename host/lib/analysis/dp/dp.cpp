// SPDX-License-Identifier: MIT
#include "analysis/dp/dp.h"

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/simd.h"

namespace imucal {

namespace {

constexpr long kBlock = 16384; // t0 per block at most: three streams of it stay in the second-level cache
constexpr long kBlocksPerRecord = 64;

// Sum over t0 in [b, e) of (p[t+n] - 2 p[t] + p[t-n])^2.  Four lanes, two chains: the order of the additions is
// the same on every machine.
IMUCAL_WIDE double second_difference_sum_sq(const double* p, long b, long e, long n) {
  Lanes s0 = {0, 0, 0, 0}, s1 = {0, 0, 0, 0};
  long t = b;
  for (; t + 8 <= e; t += 8) {
    Lanes lo, mid, hi;
    load_lanes(&lo, p + t - n), load_lanes(&mid, p + t), load_lanes(&hi, p + t + n);
    const Lanes d0 = (hi - mid) - (mid - lo);
    load_lanes(&lo, p + t + 4 - n), load_lanes(&mid, p + t + 4), load_lanes(&hi, p + t + 4 + n);
    const Lanes d1 = (hi - mid) - (mid - lo);
    s0 += d0 * d0;
    s1 += d1 * d1;
  }
  const Lanes s = s0 + s1;
  double sum = (s[0] + s[1]) + (s[2] + s[3]);
  for (; t < e; ++t) {
    const double d = (p[t + n] - p[t]) - (p[t] - p[t - n]);
    sum += d * d;
  }
  return sum;
}

// Sum over t0 in [b, e) of ((p[t+n] - p[t]) / n - factor x[t])^2.
IMUCAL_WIDE double prediction_sum_sq(const double* p, const double* x, long b, long e, long n, double factor) {
  const double inv_n = 1.0 / static_cast<double>(n);
  Lanes s0 = {0, 0, 0, 0}, s1 = {0, 0, 0, 0};
  long t = b;
  for (; t + 8 <= e; t += 8) {
    Lanes mid, hi, est;
    load_lanes(&mid, p + t), load_lanes(&hi, p + t + n), load_lanes(&est, x + t);
    const Lanes d0 = (hi - mid) * inv_n - est * factor;
    load_lanes(&mid, p + t + 4), load_lanes(&hi, p + t + 4 + n), load_lanes(&est, x + t + 4);
    const Lanes d1 = (hi - mid) * inv_n - est * factor;
    s0 += d0 * d0;
    s1 += d1 * d1;
  }
  const Lanes s = s0 + s1;
  double sum = (s[0] + s[1]) + (s[2] + s[3]);
  for (; t < e; ++t) {
    const double d = (p[t + n] - p[t]) * inv_n - x[t] * factor;
    sum += d * d;
  }
  return sum;
}

long steps_of(double tau_s, double dt_s) {
  return std::lround(tau_s / dt_s);
}

} // namespace

DpType dp_type_from_text(const std::string& text) {
  if (text == "av") return DpType::kAv;
  if (text == "dp1") return DpType::kDp1;
  if (text == "dp2") return DpType::kDp2;
  if (text == "dp3") return DpType::kDp3;
  throw usage_error("--type " + text + ": expected av, dp1, dp2 or dp3");
}

std::string to_text(DpType type) {
  static const char* const names[] = {"av", "dp1", "dp2", "dp3"};
  return names[static_cast<int>(type)];
}

DpEstimator dp_estimator_from_text(const std::string& text) {
  if (text == "rms") return DpEstimator::kRms;
  if (text == "max") return DpEstimator::kMax;
  if (text == "p95") return DpEstimator::kP95;
  throw usage_error("--estimator " + text + ": expected rms, max or p95");
}

std::string to_text(DpEstimator estimator) {
  static const char* const names[] = {"rms", "max", "p95"};
  return names[static_cast<int>(estimator)];
}

long DpOperator::history_n(long n) const {
  if (type == DpType::kAv) return n;
  if (type == DpType::kDp1) return estimation_n;
  return filter.warm_up_n();
}

DpOperator make_dp_operator(DpType type, double dt_s, const std::optional<ErrorModel>& nominal, double estimation_s) {
  DpOperator op;
  op.type = type;
  op.dt_s = dt_s;
  op.estimation_n = steps_of(estimation_s, dt_s);
  if (type == DpType::kDp1 && op.estimation_n < 1)
    throw usage_error("--estimation-s " + std::to_string(estimation_s) + " is less than one sample of " +
                      std::to_string(dt_s) + " s");
  if (type == DpType::kDp2 || type == DpType::kDp3) {
    if (!nominal) throw usage_error("--type " + to_text(type) + " needs --nominal MODEL.json");
    op.filter = make_nominal_filter(*nominal, dt_s);
  }
  return op;
}

DpRecord::DpRecord(const Series& series, const DpOperator& op, const std::vector<double>& initial)
    : op_(op), size_(series.size()) {
  const auto size = static_cast<size_t>(size_);
  sum_.resize(size + 1);
  double sum = 0;
  for (size_t i = 0; i < size; ++i) {
    sum_[i] = sum;
    if (series.n_missing == 0 || !std::isnan(series.rate_dph[i])) sum += series.rate_dph[i];
  }
  sum_[size] = sum;
  if (series.n_missing > 0) {
    present_.resize(size + 1);
    for (size_t i = 0; i < size; ++i) present_[i + 1] = present_[i] + !std::isnan(series.rate_dph[i]);
  }
  if (op.type != DpType::kDp2 && op.type != DpType::kDp3) return;
  const NominalFilter& f = op.filter;
  std::vector<double> x = initial.empty() ? std::vector<double>(f.size(), 0.0) : initial;
  states_.assign(f.size(), std::vector<double>(size + 1));
  for (size_t i = 0; i <= size; ++i) {
    for (size_t k = 0; k < x.size(); ++k) states_[k][i] = x[k];
    if (i == size) break;
    double predicted = 0;
    for (size_t k = 0; k < x.size(); ++k) predicted += x[k] *= f.phi[k];
    if (std::isnan(series.rate_dph[i])) continue;
    const double innovation = series.rate_dph[i] - predicted;
    for (size_t k = 0; k < x.size(); ++k) x[k] += f.gain[k] * innovation;
  }
  // DP2 with several terms needs only their sum.
  if (op.type == DpType::kDp2 && f.size() > 1) {
    for (size_t k = 1; k < f.size(); ++k)
      for (size_t i = 0; i <= size; ++i) states_[0][i] += states_[k][i];
    states_.resize(1);
  }
}

bool DpRecord::complete(long first, long last) const {
  const int present = present_[static_cast<size_t>(last)] - present_[static_cast<size_t>(first)];
  return present > 0 && present >= op_.min_fill * static_cast<double>(last - first) - 1e-9;
}

// Mean of [first, last), over the samples present.
double DpRecord::window_sum(long first, long last, long n) const {
  const auto a = static_cast<size_t>(first), b = static_cast<size_t>(last);
  const double count = present_.empty() ? static_cast<double>(n) : present_[b] - present_[a];
  return (sum_[b] - sum_[a]) / count;
}

double DpRecord::estimate(long n, long t0) const {
  if (op_.type == DpType::kAv) return window_sum(t0 - n, t0, n);
  if (op_.type == DpType::kDp1) return window_sum(t0 - op_.estimation_n, t0, op_.estimation_n);
  double sum = 0;
  for (size_t k = 0; k < states_.size(); ++k)
    sum += op_.filter.prediction_factor(k, n, op_.type == DpType::kDp3) * states_[k][static_cast<size_t>(t0)];
  return sum;
}

void DpRecord::samples(long n, std::vector<double>* d, std::vector<long>* t0, long first_t0) const {
  d->clear();
  if (t0) t0->clear();
  const long history = op_.history_n(n);
  std::vector<double> factor(states_.size());
  for (size_t k = 0; k < factor.size(); ++k) factor[k] = op_.filter.prediction_factor(k, n, op_.type == DpType::kDp3);
  for (long t = std::max(history, first_t0); t + n <= size_; ++t) {
    if (!present_.empty() && !(complete(t, t + n) && complete(t - history, t))) continue;
    double predicted = 0;
    if (factor.empty())
      predicted = estimate(n, t);
    else
      for (size_t k = 0; k < factor.size(); ++k) predicted += factor[k] * states_[k][static_cast<size_t>(t)];
    d->push_back(window_sum(t, t + n, n) - predicted);
    if (t0) t0->push_back(t);
  }
}

std::vector<double> DpRecord::adjoint(long n, const std::vector<double>& d, const std::vector<long>& t0) const {
  const auto size = static_cast<size_t>(size_);
  std::vector<double> slope(size + 1, 0.0); // differences of the weights given by windows
  const auto add_mean = [&](long first, long last, double value) {
    const auto a = static_cast<size_t>(first), b = static_cast<size_t>(last);
    const double share = value / (present_.empty() ? static_cast<double>(last - first) : present_[b] - present_[a]);
    slope[a] += share;
    slope[b] -= share;
  };
  const bool filtered = !states_.empty();
  std::vector<double> from_filter(filtered ? size + 1 : 0, 0.0);
  for (size_t k = 0; k < d.size(); ++k) {
    add_mean(t0[k], t0[k] + n, d[k]);
    if (filtered)
      from_filter[static_cast<size_t>(t0[k])] = -d[k];
    else
      add_mean(t0[k] - op_.history_n(n), t0[k], -d[k]);
  }
  std::vector<double> out(size);
  double sum = 0;
  for (size_t i = 0; i < size; ++i) out[i] = sum += slope[i];
  if (filtered) { // the filter's recursion backwards
    const NominalFilter& f = op_.filter;
    std::vector<double> state(f.size(), 0.0), factor(f.size());
    for (size_t k = 0; k < f.size(); ++k) factor[k] = f.prediction_factor(k, n, op_.type == DpType::kDp3);
    for (size_t i = size; i-- > 0;) {
      for (size_t k = 0; k < f.size(); ++k) state[k] += from_filter[i + 1] * factor[k];
      double along = 0;
      if (present_.empty() || present_[i + 1] > present_[i])
        for (size_t k = 0; k < f.size(); ++k) along += f.gain[k] * state[k];
      out[i] += along;
      for (size_t k = 0; k < f.size(); ++k) state[k] = f.phi[k] * (state[k] - along);
    }
  }
  if (!present_.empty())
    for (size_t i = 0; i < size; ++i)
      if (present_[i + 1] == present_[i]) out[i] = 0;
  return out;
}

long DpRecord::Moments::n_windows() const {
  long sum = 0;
  for (long c : count) sum += c;
  return sum;
}

double DpRecord::Moments::mean_square() const {
  double sum = 0;
  for (double s : sum_sq) sum += s;
  const long n = n_windows();
  return n > 0 ? sum / static_cast<double>(n) : 0;
}

std::vector<DpRecord::Moments> DpRecord::moments(const std::vector<long>& n, const std::vector<long>& first_t0) const {
  const long block = std::clamp(size_ / kBlocksPerRecord, 8L, kBlock);
  std::vector<Moments> out(n.size());
  const bool general = !present_.empty() || states_.size() > 1;
  std::vector<double> d;
  std::vector<long> t0;
  if (general) {
    for (size_t i = 0; i < n.size(); ++i) {
      samples(n[i], &d, &t0, first_t0.empty() ? 0 : first_t0[i]);
      long end = -1;
      for (size_t k = 0; k < d.size(); ++k) {
        if (t0[k] >= end) {
          end = (t0[k] / block + 1) * block;
          out[i].sum_sq.push_back(0);
          out[i].count.push_back(0);
        }
        out[i].sum_sq.back() += d[k] * d[k];
        ++out[i].count.back();
      }
    }
    return out;
  }
  std::vector<double> scale(n.size()), factor(n.size());
  for (size_t i = 0; i < n.size(); ++i) {
    const auto steps = static_cast<double>(n[i]);
    scale[i] = op_.type == DpType::kAv ? 1 / (steps * steps) : 1;
    factor[i] = states_.empty() ? 1 : op_.filter.prediction_factor(0, n[i], op_.type == DpType::kDp3);
  }
  // DP1: the estimates once, as one more array.
  std::vector<double> mean_before;
  if (op_.type == DpType::kDp1) {
    mean_before.resize(static_cast<size_t>(size_) + 1);
    for (long t = op_.estimation_n; t <= size_; ++t) mean_before[static_cast<size_t>(t)] = estimate(0, t);
  }
  const double* x = op_.type == DpType::kDp1 ? mean_before.data() : states_.empty() ? nullptr : states_[0].data();
  for (long b = 0; b < size_; b += block)
    for (size_t i = 0; i < n.size(); ++i) {
      const long first = std::max({b, op_.history_n(n[i]), first_t0.empty() ? 0L : first_t0[i]}),
                 last = std::min(b + block, size_ - n[i] + 1);
      if (first >= last) continue;
      const double sum = op_.type == DpType::kAv ? second_difference_sum_sq(sum_.data(), first, last, n[i])
                                                 : prediction_sum_sq(sum_.data(), x, first, last, n[i], factor[i]);
      out[i].sum_sq.push_back(sum * scale[i]);
      out[i].count.push_back(last - first);
    }
  return out;
}

double dp_sigma(DpEstimator estimator, std::vector<double>* d) {
  if (d->empty()) return 0;
  if (estimator == DpEstimator::kRms) {
    double sum = 0;
    for (double v : *d) sum += v * v;
    return std::sqrt(sum / static_cast<double>(d->size()));
  }
  for (double& v : *d) v = std::fabs(v);
  if (estimator == DpEstimator::kMax) return *std::max_element(d->begin(), d->end()) / 3;
  // Percentile with linear interpolation between order statistics.
  const double place = 0.954 * static_cast<double>(d->size() - 1);
  const auto k = static_cast<long>(place);
  std::nth_element(d->begin(), d->begin() + k, d->end());
  const double lower = (*d)[static_cast<size_t>(k)];
  const double upper = k + 1 < static_cast<long>(d->size()) ? *std::min_element(d->begin() + k + 1, d->end()) : lower;
  return 0.5 * (lower + (place - static_cast<double>(k)) * (upper - lower));
}

DpCurve dp_curve(const Series& series, const DpRecord& record, const std::vector<double>& tau_s,
                 DpEstimator estimator) {
  DpCurve curve;
  curve.log = series.log;
  curve.axis = series.axis;
  curve.type = record.op().type;
  curve.estimator = estimator;
  const auto first =
      std::find_if(series.rate_dph.begin(), series.rate_dph.end(), [](double x) { return !std::isnan(x); });
  if (std::all_of(first, series.rate_dph.end(), [&](double x) { return std::isnan(x) || x == *first; }))
    throw data_error(series.log + ": axis " + series.axis + " is constant: nothing to analyse (is the sensor alive?)");
  std::vector<long> steps;
  for (double tau : tau_s) {
    const long n = steps_of(tau, series.dt_s);
    if (n < 1)
      throw usage_error("tau " + std::to_string(tau) + " s is less than one sample of " + std::to_string(series.dt_s) +
                        " s");
    if (record.possible_windows(n) < 1)
      throw data_error(series.log + ": tau " + std::to_string(tau) + " s is beyond the record: " + to_text(curve.type) +
                       " needs " + std::to_string(record.op().history_n(n)) + " samples before and " +
                       std::to_string(n) + " after, the record has " + std::to_string(record.size()));
    steps.push_back(n);
    curve.tau_s.push_back(static_cast<double>(n) * series.dt_s);
  }
  if (estimator == DpEstimator::kRms) {
    curve.moments = record.moments(steps);
    for (const auto& m : curve.moments) {
      curve.dp_dph.push_back(std::sqrt(0.5 * m.mean_square()));
      curve.n.push_back(m.n_windows());
    }
  } else {
    std::vector<double> d;
    for (long n : steps) {
      record.samples(n, &d, nullptr);
      curve.n.push_back(static_cast<long>(d.size()));
      curve.dp_dph.push_back(dp_sigma(estimator, &d) / std::sqrt(2.0));
    }
  }
  for (size_t i = 0; i < steps.size(); ++i)
    if (curve.n[i] == 0)
      throw data_error(series.log + ": axis " + series.axis + ": no window of tau " + std::to_string(curve.tau_s[i]) +
                       " s is free of missing samples; lower tau or allow some with --min-fill");
  return curve;
}

} // namespace imucal
