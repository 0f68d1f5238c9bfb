// SPDX-License-Identifier: MIT
#include "noise/covariance.h"

#include <cmath>
#include <stdexcept>

namespace imucal {
namespace {

// sum_j sigma^2 exp(-|t_i - t_j|/tau) v_j: what lies before sample i, carried forward, and what lies after, carried
// backward.
void add_markov(const SampleTimes& times, const Markov& markov, const Eigen::VectorXd& v, Eigen::VectorXd* out) {
  const double variance = markov.sigma_dph * markov.sigma_dph;
  Eigen::VectorXd phi(v.size()); // from the sample before
  double step_s = -1, last = 0;
  for (long k = 1; k < v.size(); ++k) {
    const double now_s = times.seconds(static_cast<size_t>(k));
    if (now_s != step_s) last = std::exp(-now_s / markov.tau_s), step_s = now_s;
    phi[k] = last;
  }
  *out += variance * v;
  double carried = 0;
  for (long k = 1; k < v.size(); ++k) (*out)[k] += variance * (carried = phi[k] * (carried + v[k - 1]));
  carried = 0;
  for (long k = v.size() - 1; k > 0; --k) (*out)[k - 1] += variance * (carried = phi[k] * (carried + v[k]));
}

// sum_j min(t_i, t_j) v_j, t from the first sample: (V v)_i grows by the step times what lies from i on.
void add_walk(const SampleTimes& times, double q_dph2_per_s, const Eigen::VectorXd& v, Eigen::VectorXd* out) {
  double ahead = v.sum(), sum = 0;
  for (long k = 1; k < v.size(); ++k) {
    ahead -= v[k - 1];
    sum += times.seconds(static_cast<size_t>(k)) * ahead;
    (*out)[k] += q_dph2_per_s * sum;
  }
}

} // namespace

Eigen::VectorXd covariance_times(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd& v) {
  if (!noise.is_stationary() || noise.is_mixture())
    throw std::logic_error("covariance_times: a model with slopes or a mixture");
  const double white = (noise.white_sigma_dph * noise.white_sigma_dph + noise.extra_white_dph2) / times.dt_s;
  Eigen::VectorXd out = (white + times.own_white_dph2) * v;
  for (const Markov& m : noise.markov) add_markov(times, m, v, &out);
  if (noise.walk_dph_per_rt_s > 0) add_walk(times, noise.walk_dph_per_rt_s * noise.walk_dph_per_rt_s, v, &out);
  return out;
}

} // namespace imucal
