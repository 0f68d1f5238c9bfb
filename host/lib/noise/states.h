// SPDX-License-Identifier: MIT
// Inside the noise room: the state-space form of a noise model and the Gaussian belief about its states.
#pragma once
#include <array>
#include <cmath>
#include <type_traits>
#include <vector>

#include "noise/gains.h"

namespace imucal {

// Parameters of all states at one sample of a run.
class NoiseStates {
public:
  NoiseStates(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2 = nullptr)
      : times_(times), noise_(noise), extra_dph2_(extra_dph2),
        n_(noise.markov.size() + (noise.walk_dph_per_rt_s > 0 ? 1 : 0)),
        white_dph2_(noise.white_sigma_dph * noise.white_sigma_dph / times.dt_s) {}
  size_t size() const { return n_; }
  bool is_constant() const { return noise_.is_stationary() && !extra_dph2_; }
  bool has_constant_transitions() const { return noise_.markov_slope == 0 && noise_.tau_slope == 0; }
  double white_dph2(size_t k) const {
    const double here =
        noise_.white_slope != 0 ? white_dph2_ * std::exp(noise_.white_slope * times_.tn[k]) : white_dph2_;
    return here + noise_.extra_white_dph2 / times_.dt_s + times_.own_white_dph2 +
           (extra_dph2_ ? (*extra_dph2_)[static_cast<long>(k)] : 0.0);
  }
  double start_dph2(size_t i) const { return i < noise_.markov.size() ? sigma(i, 0) * sigma(i, 0) : 0.0; }
  double step_s(size_t k) const { return times_.seconds(k + 1); } // from sample k to k + 1
  // From sample k to k + 1.
  void transition(size_t k, double* phi, double* q) const;

private:
  double sigma(size_t i, size_t k) const;

  const SampleTimes& times_;
  const NoiseModel& noise_;
  const Eigen::VectorXd* extra_dph2_;
  size_t n_;
  double white_dph2_; // where no slope changes it
};

// Covariance of the states, predicted to the next sample.  Order of calls for each sample: spread, update, predict.
// M: the number of states where the compiler may know it, else 0.
template <size_t M> class Covariance {
public:
  explicit Covariance(const NoiseStates& states) : n_(states.size()) {
    if constexpr (M == 0) p_.resize(n_ * n_);
    for (size_t i = 0; i < n(); ++i)
      for (size_t j = 0; j < n(); ++j) p_[i * n() + j] = i == j ? states.start_dph2(i) : 0.0;
  }
  // The covariance times a vector of ones goes to `cross`; returns the variance of the sum of the states.
  double spread(double* cross) const {
    double sum = 0;
    for (size_t i = 0; i < n(); ++i) {
      cross[i] = 0;
      for (size_t j = 0; j < n(); ++j) cross[i] += p_[i * n() + j];
      sum += cross[i];
    }
    return sum;
  }
  // -= cross cross' weight.  Gaussian: weight = 1/s.
  void update(const double* cross, double weight) {
    for (size_t i = 0; i < n(); ++i)
      for (size_t j = 0; j < n(); ++j) p_[i * n() + j] -= cross[i] * weight * cross[j];
  }
  void predict(const double* phi, const double* q) {
    for (size_t i = 0; i < n(); ++i) {
      for (size_t j = 0; j < n(); ++j) p_[i * n() + j] *= phi[i] * phi[j];
      p_[i * n() + i] += q[i];
    }
  }
  double& at(size_t i, size_t j) { return p_[i * n() + j]; }
  double at(size_t i, size_t j) const { return p_[i * n() + j]; }

private:
  size_t n() const { return M ? M : n_; }

  size_t n_;
  std::conditional_t<M == 0, std::vector<double>, std::array<double, M * M>> p_;
};

// Mean and covariance of the states; calls in the order of Covariance.  M as there.
template <size_t M> class Belief {
public:
  explicit Belief(const NoiseStates& states) : n_(states.size()), covariance_(states) {
    if constexpr (M == 0) mean_.resize(n_), cross_.resize(n_);
    for (size_t i = 0; i < n(); ++i) mean_[i] = cross_[i] = 0;
  }
  // Variance of the sum of the states.
  double spread() { return covariance_.spread(cross_.data()); }
  double mean() const {
    double sum = 0;
    for (size_t i = 0; i < n(); ++i) sum += mean_[i];
    return sum;
  }
  // mean += cross score, covariance -= cross cross' weight, cross as `spread` left it.  Gaussian: score = innovation/s.
  void update(double score, double weight) {
    for (size_t i = 0; i < n(); ++i) mean_[i] += cross_[i] * score;
    covariance_.update(cross_.data(), weight);
  }
  void predict(const double* phi, const double* q) {
    for (size_t i = 0; i < n(); ++i) mean_[i] *= phi[i];
    covariance_.predict(phi, q);
  }
  // Takes the mean and covariance of a mixture: the part `share` of b and the rest of a.
  void set_mixture(const Belief& a, const Belief& b, double share) {
    for (size_t i = 0; i < n(); ++i) mean_[i] = (1 - share) * a.mean_[i] + share * b.mean_[i];
    for (size_t i = 0; i < n(); ++i)
      for (size_t j = 0; j < n(); ++j)
        covariance_.at(i, j) = (1 - share) * a.covariance_.at(i, j) + share * b.covariance_.at(i, j) +
                               share * (1 - share) * (a.mean_[i] - b.mean_[i]) * (a.mean_[j] - b.mean_[j]);
  }

private:
  size_t n() const { return M ? M : n_; }

  size_t n_;
  std::conditional_t<M == 0, std::vector<double>, std::array<double, M>> mean_, cross_;
  Covariance<M> covariance_;
};

// Phi and q from sample to sample: the same as before after as many seconds, unless the noise follows the temperature.
template <size_t M> class Transitions {
public:
  explicit Transitions(const NoiseStates& states) {
    if constexpr (M == 0) phi_.resize(states.size()), q_.resize(states.size());
  }
  // To those from sample k to k + 1; returns whether they have changed.
  bool set(const NoiseStates& states, size_t k) {
    const double step_s = states.step_s(k);
    if (step_s == step_s_ && states.has_constant_transitions()) return false;
    step_s_ = step_s;
    states.transition(k, phi_.data(), q_.data());
    return true;
  }
  const double* phi() const { return phi_.data(); }
  const double* q() const { return q_.data(); }
  double step_s() const { return step_s_; }

private:
  std::conditional_t<M == 0, std::vector<double>, std::array<double, M>> phi_ = {}, q_ = {};
  double step_s_ = -1; // that they are for
};

} // namespace imucal
