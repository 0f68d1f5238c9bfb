// SPDX-License-Identifier: MIT
#include "analysis/errormodel/confidence.h"

#include <algorithm>
#include <cmath>

#include "analysis/errormodel/expect.h"

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

// DP2, DP3: lag by lag through the filter's recursion; each sample after t0 enters with its covariance with d(t0).
void add_filtered(const NoiseComponent& comp, const DpOperator& op, long n, std::vector<double>* r) {
  const NominalFilter& f = op.filter;
  const size_t order = f.size();
  std::vector<double> c(order, 0.0);
  for (size_t i = 0; i < order; ++i)
    for (size_t m = 0; m < order; ++m) c[m] += f.prediction_factor(i, n, op.type == DpType::kDp3) * f.response[i][m];
  const auto size = static_cast<long>(r->size());
  const double phi = std::exp(-comp.alpha), p = comp.power_dph2;
  const auto gamma = [&](long lag) {
    lag = std::labs(lag);
    if (comp.kind == Kind::kMarkov) return p * std::exp(-comp.alpha * static_cast<double>(lag));
    if (comp.kind == Kind::kAngleQuantization) return lag == 0 ? 2 * p : lag == 1 ? -p : 0.0;
    return lag == 0 ? p : 0.0;
  };
  // s(j) = E d(0) x(j), x(j) being j samples after t0 (j = 0: the first predicted), for j > -1 - horizon.
  // Window part: sums of gamma; estimate part: E estimate x(j) = sum_m c_m sum_i pole^i gamma(j + 1 + i).
  const long reach = size + n;
  std::vector<double> cumulative(static_cast<size_t>(reach + n) + 2); // sum_{l<k} gamma(l)
  for (size_t k = 1; k < cumulative.size(); ++k) cumulative[k] = cumulative[k - 1] + gamma(static_cast<long>(k) - 1);
  const auto window_with = [&](long j) { // (1/n) sum_{i<n} gamma(j - i), j >= 0
    const auto at = [&](long k) { return cumulative[static_cast<size_t>(k)]; };
    const double sum = j < n ? at(j + 1) + at(n - j) - gamma(0) : at(j + 1) - at(j + 1 - n);
    return sum / static_cast<double>(n);
  };
  const auto estimate_with = [&](long j) { // j >= 0
    double sum = 0;
    for (size_t m = 0; m < order; ++m) {
      if (comp.kind == Kind::kMarkov) sum += c[m] * gamma(j + 1) / (1 - f.pole[m] * phi);
      if (comp.kind == Kind::kAngleQuantization && j == 0) sum -= c[m] * p;
    }
    return sum;
  };
  std::vector<double> with(static_cast<size_t>(reach));
  for (long j = 0; j < reach; ++j) with[static_cast<size_t>(j)] = window_with(j) - estimate_with(j);
  // E d(0) estimate_m(k), started at k = 0 from closed forms.
  std::vector<double> state(order, 0.0);
  for (size_t m = 0; m < order; ++m) {
    const double pm = f.pole[m];
    double window = 0, estimate = 0;
    if (comp.kind == Kind::kMarkov)
      window = p * phi / (1 - pm * phi) * std::expm1(-comp.alpha * static_cast<double>(n)) / std::expm1(-comp.alpha) /
               static_cast<double>(n);
    if (comp.kind == Kind::kAngleQuantization) window = -p / static_cast<double>(n);
    for (size_t k = 0; k < order; ++k) {
      double sum = 1;
      if (comp.kind == Kind::kMarkov) sum = 1 / (1 - pm * phi) + 1 / (1 - f.pole[k] * phi) - 1;
      if (comp.kind == Kind::kAngleQuantization) sum = 2 - pm - f.pole[k];
      estimate += c[k] * p * sum / (1 - pm * f.pole[k]);
    }
    state[m] = window - estimate;
  }
  double window = 0; // E d(0) mean(x[k .. k+n))
  for (long j = 0; j < n; ++j) window += with[static_cast<size_t>(j)] / static_cast<double>(n);
  for (long k = 0; k < size; ++k) {
    double estimate = 0;
    for (size_t m = 0; m < order; ++m) estimate += c[m] * state[m];
    (*r)[static_cast<size_t>(k)] += window - estimate;
    const double now = with[static_cast<size_t>(k)];
    window += (with[static_cast<size_t>(k + n)] - now) / static_cast<double>(n);
    for (size_t m = 0; m < order; ++m) state[m] = f.pole[m] * state[m] + now;
    if (k + n + 1 >= reach) break;
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
      add_filtered(comp, op, n, &r);
    else
      add_two_window(comp, static_cast<double>(n), static_cast<double>(op.history_n(n)), &r);
  }
  return r;
}

double model_dof(const std::vector<NoiseComponent>& components, const DpOperator& op, long n, long n_windows) {
  // Beyond some window lengths the autocovariance of d is spent (long Markov terms excepted: cut at 20 windows).
  const long lags = std::min(n_windows, 20 * (n + op.history_n(n)) + 200);
  const auto r = error_autocovariance(components, op, n, lags);
  const auto windows = static_cast<double>(n_windows);
  double sum = 0;
  for (size_t k = 0; k < r.size(); ++k) sum += (k ? 2 : 1) * (windows - static_cast<double>(k)) * r[k] * r[k];
  return std::max(1.0, windows * windows * r[0] * r[0] / sum);
}

double block_dof(const DpRecord::Moments& moments, const DpOperator& op, long n) {
  const long wanted = 2 * (n + op.history_n(n));
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
  const double white = model_dof({white_component(1)}, op, n, std::max(1L, moments.n_windows()));
  if (mean.size() < 6) return white;
  double centre = 0, square = 0;
  for (double m : mean) centre += m / static_cast<double>(mean.size());
  for (double m : mean) square += (m - centre) * (m - centre);
  const auto blocks = static_cast<double>(mean.size());
  const double variance = square / (blocks * (blocks - 1));
  return std::clamp(2 * centre * centre / std::max(variance, 1e-300), 1.0, 1e9);
}

std::vector<Interval> curve_intervals(const DpCurve& curve, const DpOperator& op,
                                      const std::vector<NoiseComponent>& components) {
  std::vector<Interval> out;
  for (size_t i = 0; i < curve.tau_s.size(); ++i) {
    const long n = std::lround(curve.tau_s[i] / op.dt_s);
    const double dof = components.empty() ? (curve.moments.empty() ? model_dof({white_component(1)}, op, n, curve.n[i])
                                                                   : block_dof(curve.moments[i], op, n))
                                          : model_dof(components, op, n, curve.n[i]);
    out.push_back(rms_interval(curve.dp_dph[i], dof));
  }
  return out;
}

} // namespace imucal
