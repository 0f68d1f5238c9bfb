// SPDX-License-Identifier: MIT
// Inside the noise room: the state-space form of a noise model and the Gaussian belief about its states.
#pragma once
#include <vector>

#include "noise/gains.h"

namespace imucal {

// Parameters of all states at one sample of a run.
class NoiseStates {
public:
  NoiseStates(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2 = nullptr)
      : times_(times), noise_(noise), extra_dph2_(extra_dph2),
        n_(noise.markov.size() + (noise.walk_dph_per_rt_s > 0 ? 1 : 0)) {}
  size_t size() const { return n_; }
  bool is_constant() const { return noise_.is_stationary() && !extra_dph2_; }
  bool has_constant_transitions() const { return noise_.markov_slope == 0 && noise_.tau_slope == 0; }
  double white_dph2(size_t k) const;
  double start_dph2(size_t i) const { return i < noise_.markov.size() ? sigma(i, 0) * sigma(i, 0) : 0.0; }
  // From sample k to k + 1.
  void transition(size_t k, double* phi, double* q) const;

private:
  double sigma(size_t i, size_t k) const;

  const SampleTimes& times_;
  const NoiseModel& noise_;
  const Eigen::VectorXd* extra_dph2_;
  size_t n_;
};

// Mean and covariance of the states, predicted to the next sample.  Order of calls for each sample: spread,
// update, predict.
class Belief {
public:
  explicit Belief(const NoiseStates& states);
  // Variance of the sum of the states.
  double spread();
  double mean() const;
  // The covariance times a vector of ones; `spread` computes it.
  const std::vector<double>& cross() const { return cross_; }
  // mean += cross score, covariance -= cross cross' weight.  Gaussian: score = innovation/s, weight = 1/s.
  void update(double score, double weight);
  void predict(const double* phi, const double* q);
  // Takes the mean and covariance of a mixture: the part `share` of b and the rest of a.
  void set_mixture(const Belief& a, const Belief& b, double share);

private:
  size_t n_;
  std::vector<double> mean_, covariance_, cross_;
};

} // namespace imucal
