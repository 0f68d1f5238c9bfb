// SPDX-License-Identifier: MIT
#include "analysis/errormodel/confidence.h"

#include <algorithm>
#include <cmath>

#include "analysis/errormodel/expect.h"
#include "base/quantile.h"

namespace imucal {

using Kind = NoiseComponent::Kind;

namespace {

// AV, DP1: d = (P(n) - P(0))/n - (P(0) - P(-m))/m for the running sum P, so r(k) = -1/2 sum_ij c_i c_j V(|k + a_i - a_j|).
void add_two_window(const NoiseComponent& comp, double n, double m, std::vector<double>* r) {
  const double place[3] = {n, 0, -m}, weight[3] = {1 / n, -1 / n - 1 / m, 1 / m};
  for (size_t k = 0; k < r->size(); ++k) {
    double sum = 0;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        sum += weight[i] * weight[j] * sum_variance(comp, std::fabs(static_cast<double>(k) + place[i] - place[j]));
    (*r)[k] -= 0.5 * sum;
  }
}

// DP2, DP3: d(0) = mean of the n samples that follow - estimate from those before.  r(k) = E d(0) d(k) is found lag by
// lag through the filter's recursion: every sample that enters at lag k enters with its covariance with d(0).
class FilteredAutocovariance {
public:
  FilteredAutocovariance(const NoiseComponent& comp, const DpOperator& op, long n)
      : f_(op.filter), kind_(comp.kind), alpha_(comp.alpha), p_(comp.power_dph2), phi_(std::exp(-comp.alpha)), n_(n),
        c_(f_.size(), 0.0) {
    for (size_t i = 0; i < c_.size(); ++i)
      for (size_t m = 0; m < c_.size(); ++m)
        c_[m] += f_.prediction_factor(i, n, op.type == DpType::kDp3) * f_.response[i][m];
  }

  void add_to(std::vector<double>* r) const;

private:
  double gamma(long lag) const; // autocovariance of the samples
  std::vector<double> covariance_with_samples(long reach) const;
  double estimate_with_sample(long j) const;
  double window_with_state(size_t m) const;
  double estimate_with_state(size_t m) const;
  std::vector<double> covariance_with_states() const;

  const NominalFilter& f_;
  Kind kind_;
  double alpha_, p_, phi_;
  long n_;
  std::vector<double> c_; // the estimate as a sum of the filter's modes: sum_m c_m state_m
};

double FilteredAutocovariance::gamma(long lag) const {
  lag = std::labs(lag);
  if (kind_ == Kind::kMarkov) return p_ * std::exp(-alpha_ * static_cast<double>(lag));
  if (kind_ == Kind::kAngleQuantization) return lag == 0 ? 2 * p_ : lag == 1 ? -p_ : 0.0;
  return lag == 0 ? p_ : 0.0;
}

// E estimate x(j) = sum_m c_m sum_i pole_m^i gamma(j + 1 + i), j >= 0.
double FilteredAutocovariance::estimate_with_sample(long j) const {
  double sum = 0;
  for (size_t m = 0; m < c_.size(); ++m) {
    if (kind_ == Kind::kMarkov) sum += c_[m] * gamma(j + 1) / (1 - f_.pole[m] * phi_);
    if (kind_ == Kind::kAngleQuantization && j == 0) sum -= c_[m] * p_;
  }
  return sum;
}

// E d(0) x(j) for 0 <= j < reach; x(0) is the first sample predicted.  The window's part is a sum of gamma over n lags.
std::vector<double> FilteredAutocovariance::covariance_with_samples(long reach) const {
  std::vector<double> cumulative(static_cast<size_t>(reach + n_) + 2); // sum_{l<k} gamma(l)
  for (size_t k = 1; k < cumulative.size(); ++k) cumulative[k] = cumulative[k - 1] + gamma(static_cast<long>(k) - 1);
  const auto window_with_sample = [&](long j) { // (1/n) sum_{i<n} gamma(j - i)
    const auto at = [&](long k) { return cumulative[static_cast<size_t>(k)]; };
    const double sum = j < n_ ? at(j + 1) + at(n_ - j) - gamma(0) : at(j + 1) - at(j + 1 - n_);
    return sum / static_cast<double>(n_);
  };
  std::vector<double> with(static_cast<size_t>(reach));
  for (long j = 0; j < reach; ++j) with[static_cast<size_t>(j)] = window_with_sample(j) - estimate_with_sample(j);
  return with;
}

// E window(0) state_m(0).
double FilteredAutocovariance::window_with_state(size_t m) const {
  const auto n = static_cast<double>(n_);
  if (kind_ == Kind::kMarkov)
    return p_ * phi_ / (1 - f_.pole[m] * phi_) * std::expm1(-alpha_ * n) / std::expm1(-alpha_) / n;
  if (kind_ == Kind::kAngleQuantization) return -p_ / n;
  return 0;
}

// E estimate(0) state_m(0).
double FilteredAutocovariance::estimate_with_state(size_t m) const {
  const double pm = f_.pole[m];
  double estimate = 0;
  for (size_t k = 0; k < c_.size(); ++k) {
    double sum = 1;
    if (kind_ == Kind::kMarkov) sum = 1 / (1 - pm * phi_) + 1 / (1 - f_.pole[k] * phi_) - 1;
    if (kind_ == Kind::kAngleQuantization) sum = 2 - pm - f_.pole[k];
    estimate += c_[k] * p_ * sum / (1 - pm * f_.pole[k]);
  }
  return estimate;
}

std::vector<double> FilteredAutocovariance::covariance_with_states() const {
  std::vector<double> state(c_.size(), 0.0);
  for (size_t m = 0; m < state.size(); ++m) state[m] = window_with_state(m) - estimate_with_state(m);
  return state;
}

void FilteredAutocovariance::add_to(std::vector<double>* r) const {
  const auto size = static_cast<long>(r->size());
  const long reach = size + n_;
  const std::vector<double> with = covariance_with_samples(reach);
  std::vector<double> state = covariance_with_states(); // E d(0) state_m(k)
  double window = 0;                                    // E d(0) mean(x[k .. k+n))
  for (long j = 0; j < n_; ++j) window += with[static_cast<size_t>(j)] / static_cast<double>(n_);
  for (long k = 0; k < size; ++k) {
    double estimate = 0;
    for (size_t m = 0; m < state.size(); ++m) estimate += c_[m] * state[m];
    (*r)[static_cast<size_t>(k)] += window - estimate;
    const double now = with[static_cast<size_t>(k)];
    window += (with[static_cast<size_t>(k + n_)] - now) / static_cast<double>(n_);
    for (size_t m = 0; m < state.size(); ++m) state[m] = f_.pole[m] * state[m] + now;
    if (k + n_ + 1 >= reach) break;
  }
}

} // namespace

std::vector<double> error_autocovariance(const std::vector<NoiseComponent>& components, const DpOperator& op, long n,
                                         long n_lags) {
  std::vector<double> r(static_cast<size_t>(n_lags), 0.0);
  const bool filtered = op.type == DpType::kDp2 || op.type == DpType::kDp3;
  for (const auto& comp : components) {
    if (comp.kind == Kind::kRamp || comp.kind == Kind::kSinusoid) continue;
    if (filtered && comp.kind == Kind::kRandomWalk) continue;
    if (filtered)
      FilteredAutocovariance(comp, op, n).add_to(&r);
    else
      add_two_window(comp, static_cast<double>(n), static_cast<double>(op.history_n(n)), &r);
  }
  return r;
}

namespace {

// Autocovariance at lag k of the difference of two adjoining windows' means, n and m long, of unit white noise: linear
// between the lags 0, n, m and n + m.
double white_two_window(double n, double m, double k) {
  const double own = std::max(0.0, n - k) / (n * n) + std::max(0.0, m - k) / (m * m);
  return own - std::max(0.0, std::min(n, k) - std::max(0.0, k - m)) / (n * m);
}

// Sum over k in [first, last) of weight (windows - k) r(k)^2, r linear: closed, whatever the number of lags.
double weighted_squares(double n, double m, double windows, double first, double last) {
  const double count = last - first, r = white_two_window(n, m, first);
  const double slope = count > 1 ? (white_two_window(n, m, last - 1) - r) / (count - 1) : 0;
  const double s1 = count * (count - 1) / 2, s2 = s1 * (2 * count - 1) / 3, s3 = s1 * s1;
  const double constant = r * r, linear = 2 * r * slope, square = slope * slope;
  return (windows - first) * (constant * count + linear * s1 + square * s2) -
         (constant * s1 + linear * s2 + square * s3);
}

// Of white noise under AV and DP1, whose windows do not know each other once they do not touch.
double white_dof(double n, double m, double windows) {
  const double knots[] = {1, std::min(n, m), std::max(n, m), n + m};
  const double r0 = white_two_window(n, m, 0);
  double sum = windows * r0 * r0;
  for (int k = 0; k < 3; ++k) {
    const double first = std::max(1.0, knots[k]), last = std::min(knots[k + 1], windows);
    if (last > first) sum += 2 * weighted_squares(n, m, windows, first, last);
  }
  return std::max(1.0, windows * windows * r0 * r0 / sum);
}

} // namespace

double model_dof(const std::vector<NoiseComponent>& components, const DpOperator& op, long n, long n_windows) {
  const bool is_white =
      op.type != DpType::kDp2 && op.type != DpType::kDp3 && !components.empty() &&
      std::all_of(components.begin(), components.end(), [](const NoiseComponent& c) { return c.kind == Kind::kWhite; });
  if (is_white)
    return white_dof(static_cast<double>(n), static_cast<double>(op.history_n(n)), static_cast<double>(n_windows));
  // Beyond some window lengths the autocovariance of d is spent (long Markov terms excepted: cut at 20 windows).
  const long reach = n + op.history_n(n);
  const long lags = std::min(n_windows, 20 * reach + 200);
  const auto r = error_autocovariance(components, op, n, lags);
  const auto windows = static_cast<double>(n_windows);
  double sum = 0;
  for (size_t k = 0; k < r.size(); ++k) sum += (k ? 2 : 1) * (windows - static_cast<double>(k)) * r[k] * r[k];
  return std::max(1.0, windows * windows * r[0] * r[0] / sum);
}

namespace {

// Where the data tell too little: the noise that the operator's nominal filter was made for; else the wider of two kinds.
double assumed_dof(const DpOperator& op, long n, long n_windows) {
  n_windows = std::max(1L, n_windows);
  if (!op.filter.components.empty()) return model_dof(op.filter.components, op, n, n_windows);
  return std::min(model_dof({white_component(1)}, op, n, n_windows), model_dof({walk_component(1)}, op, n, n_windows));
}

std::vector<double> block_means(const DpRecord::Moments& moments, long wanted) {
  std::vector<double> mean;
  double sum = 0;
  long count = 0;
  for (size_t b = 0; b < moments.count.size(); ++b) {
    sum += moments.sum_sq[b];
    count += moments.count[b];
    if (count < wanted) continue;
    mean.push_back(sum / static_cast<double>(count));
    sum = 0, count = 0;
  }
  return mean;
}

} // namespace

BlockDof block_dof(const DpRecord::Moments& moments, const DpOperator& op, long n) {
  const std::vector<double> mean = block_means(moments, 2 * (n + op.history_n(n)));
  if (static_cast<long>(mean.size()) < kFewestBlocks) return {assumed_dof(op, n, moments.n_windows()), 0};
  const auto blocks = static_cast<double>(mean.size());
  double centre = 0, square = 0, next = 0;
  for (double m : mean) centre += m / blocks;
  for (double m : mean) square += (m - centre) * (m - centre);
  for (size_t b = 1; b < mean.size(); ++b) next += (mean[b] - centre) * (mean[b - 1] - centre);
  // Of independent blocks the lag-1 products would be -1/blocks of the squares, since their mean is taken off.
  const double correlated = 2 * std::max(0.0, next + square / blocks);
  const double t = student_quantile(0.975, blocks - 1) / normal_quantile(0.975);
  const double variance = t * t * (square + correlated) / (blocks * (blocks - 1));
  return {std::clamp(2 * centre * centre / std::max(variance, 1e-300), 1.0, 1e9), static_cast<long>(mean.size())};
}

CurveIntervals curve_intervals(const DpCurve& curve, const DpOperator& op,
                               const std::vector<NoiseComponent>& components) {
  CurveIntervals out;
  for (size_t i = 0; i < curve.tau_s.size(); ++i) {
    const long n = std::lround(curve.tau_s[i] / op.dt_s);
    BlockDof found;
    if (!components.empty())
      found.dof = model_dof(components, op, n, curve.n[i]);
    else if (curve.moments.empty())
      found.dof = assumed_dof(op, n, curve.n[i]);
    else
      found = block_dof(curve.moments[i], op, n);
    out.ci.push_back(rms_interval(curve.dp_dph[i], found.dof));
    if (components.empty()) out.blocks.push_back(found.blocks);
  }
  return out;
}

} // namespace imucal
