// SPDX-License-Identifier: MIT
#include "noise/states.h"

#include <cmath>

namespace imucal {

double NoiseStates::sigma(size_t i, size_t k) const {
  const double sigma = noise_.markov[i].sigma_dph;
  return i == 0 && noise_.markov_slope != 0 ? sigma * std::exp(0.5 * noise_.markov_slope * times_.tn[k]) : sigma;
}

void NoiseStates::transition(size_t k, double* phi, double* q) const {
  const double step_s = times_.seconds(k + 1);
  for (size_t i = 0; i < noise_.markov.size(); ++i) {
    double tau_s = noise_.markov[i].tau_s;
    if (i == 0 && noise_.tau_slope != 0) tau_s *= std::exp(noise_.tau_slope * times_.tn[k]);
    const double now = sigma(i, k), next = sigma(i, k + 1);
    phi[i] = std::exp(-step_s / tau_s) * (now > 0 ? next / now : 1.0);
    q[i] = -next * next * std::expm1(-2.0 * step_s / tau_s);
  }
  if (n_ > noise_.markov.size()) {
    phi[n_ - 1] = 1.0;
    q[n_ - 1] = noise_.walk_dph_per_rt_s * noise_.walk_dph_per_rt_s * step_s;
  }
}

Belief::Belief(const NoiseStates& states) : n_(states.size()), mean_(n_, 0.0), cross_(n_, 0.0), covariance_(states) {}

double Belief::mean() const {
  double sum = 0;
  for (const double m : mean_) sum += m;
  return sum;
}

void Belief::update(double score, double weight) {
  for (size_t i = 0; i < n_; ++i) mean_[i] += cross_[i] * score;
  covariance_.update(cross_.data(), weight);
}

void Belief::predict(const double* phi, const double* q) {
  for (size_t i = 0; i < n_; ++i) mean_[i] *= phi[i];
  covariance_.predict(phi, q);
}

void Belief::set_mixture(const Belief& a, const Belief& b, double share) {
  for (size_t i = 0; i < n_; ++i) mean_[i] = (1 - share) * a.mean_[i] + share * b.mean_[i];
  for (size_t i = 0; i < n_; ++i)
    for (size_t j = 0; j < n_; ++j)
      covariance_.at(i, j) = (1 - share) * a.covariance_.at(i, j) + share * b.covariance_.at(i, j) +
                             share * (1 - share) * (a.mean_[i] - b.mean_[i]) * (a.mean_[j] - b.mean_[j]);
}

} // namespace imucal
