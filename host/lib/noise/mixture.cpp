// SPDX-License-Identifier: MIT
#include "noise/mixture.h"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

#include "base/quantile.h"
#include "noise/states.h"

namespace imucal {

using Eigen::VectorXd;

namespace {

// Standard normal score of a probability that rounding may have pushed to 0 or 1.
double normal_score(double p) {
  return normal_quantile(std::clamp(p, 1e-15, 1 - 1e-15));
}

// One innovation under two normal densities with prior probabilities.
struct Pair {
  double nu[2], s[2], prior[2];
  double posterior[2] = {0, 0}; // of the two, given the innovation

  // Logarithm of the density, without 1/2 ln 2 pi; relative to the larger exponent: no underflow.
  double log_density() {
    const double e[2] = {-0.5 * nu[0] * nu[0] / s[0], -0.5 * nu[1] * nu[1] / s[1]};
    const int top = e[0] < e[1] ? 1 : 0;
    const double less = std::exp(e[1 - top] - e[top]); // of the larger one: 1
    for (int j = 0; j < 2; ++j) posterior[j] = prior[j] * (j == top ? 1 : less) / std::sqrt(s[j]);
    const double sum = posterior[0] + posterior[1];
    for (double& d : posterior) d /= sum;
    return e[top] + std::log(sum);
  }
  double score() const {
    return normal_score(prior[0] * normal_cdf(nu[0] / std::sqrt(s[0])) +
                        prior[1] * normal_cdf(nu[1] / std::sqrt(s[1])));
  }
};

// Outliers: each sample is normal or a hit; the state's density is collapsed to one Gaussian after each sample.
template <size_t M>
double hit_log_likelihood(const SampleTimes& times, const NoiseModel& noise, const VectorXd& y, VectorXd* scores,
                          VectorXd* hit) {
  const NoiseStates states(times, noise);
  Belief<M> belief(states);
  Transitions<M> transitions(states);
  const double extra = noise.hit_sigma_dph * noise.hit_sigma_dph, p = noise.hit_probability;
  double log_likelihood = 0;
  for (size_t k = 0; k < times.n; ++k) {
    const auto at = static_cast<long>(k);
    const double s = states.white_dph2(k) + belief.spread(), nu = y[at] - belief.mean();
    Pair pair{{nu, nu}, {s, s + extra}, {1 - p, p}};
    log_likelihood += pair.log_density();
    const double w = pair.posterior[1], is = 1 / s, ih = 1 / (s + extra);
    if (hit) (*hit)[at] = w;
    if (scores) (*scores)[at] = pair.score();
    // First and second derivative of the log-density by nu (Masreliez 1975).
    belief.update(((1 - w) * is + w * ih) * nu, (1 - w) * is + w * ih - w * (1 - w) * nu * nu * (is - ih) * (is - ih));
    if (k + 1 == times.n) break;
    transitions.set(states, k);
    belief.predict(transitions.phi(), transitions.q());
  }
  return log_likelihood;
}

// That a level has changed on the way to sample k.
double switching(const SampleTimes& times, const NoiseModel& noise, size_t k) {
  return -0.5 * std::expm1(-times.seconds(k) / noise.telegraph_tau_s);
}

// Telegraph noise: two modes (+a, -a), each with a Kalman filter of its own, mixed before every prediction.
template <size_t M> class TelegraphFilter {
  using State = Belief<M>;

public:
  TelegraphFilter(const SampleTimes& times, const NoiseModel& noise)
      : times_(times), noise_(noise),
        states_(times, noise), mode_{State(states_), State(states_)}, mixed_{State(states_), State(states_)},
        transitions_(states_) {}

  // `upper`, where given: probability of +a after each sample.
  double run(const VectorXd& y, VectorXd* scores, VectorXd* upper = nullptr) {
    double log_likelihood = 0;
    for (size_t k = 0; k < times_.n; ++k) {
      const auto at = static_cast<long>(k);
      Pair pair = innovations(k, y[at]);
      log_likelihood += pair.log_density();
      if (scores) (*scores)[at] = pair.score();
      for (int j = 0; j < 2; ++j) {
        mode_[j].update(pair.nu[j] / pair.s[j], 1 / pair.s[j]);
        probability_[j] = pair.posterior[j];
      }
      if (upper) (*upper)[at] = probability_[0];
      if (k + 1 < times_.n) predict(k);
    }
    return log_likelihood;
  }

private:
  Pair innovations(size_t k, double y) {
    const double white = states_.white_dph2(k), level[2] = {noise_.telegraph_dph, -noise_.telegraph_dph};
    Pair pair{{0, 0}, {0, 0}, {probability_[0], probability_[1]}};
    for (int j = 0; j < 2; ++j) {
      pair.nu[j] = y - level[j] - mode_[j].mean();
      pair.s[j] = white + mode_[j].spread();
    }
    return pair;
  }

  void predict(size_t k) {
    if (transitions_.set(states_, k)) switching_ = switching(times_, noise_, k + 1);
    const double s = switching_;
    const double next[2] = {(1 - s) * probability_[0] + s * probability_[1],
                            s * probability_[0] + (1 - s) * probability_[1]};
    const auto from_other = [&](int j) { return s * probability_[1 - j] / std::max(next[j], 1e-300); };
    for (int j = 0; j < 2; ++j) mixed_[j].set_mixture(mode_[j], mode_[1 - j], from_other(j));
    for (int j = 0; j < 2; ++j) {
      std::swap(mode_[j], mixed_[j]);
      mode_[j].predict(transitions_.phi(), transitions_.q());
      probability_[j] = next[j];
    }
  }

  const SampleTimes& times_;
  const NoiseModel& noise_;
  NoiseStates states_;
  State mode_[2], mixed_[2];
  double probability_[2] = {0.5, 0.5};
  Transitions<M> transitions_;
  double switching_ = 0;
};

// f(number of states), which the compiler knows for those that most noises have.
template <class F> auto for_states(const NoiseModel& noise, const F& f) {
  const size_t n = noise.markov.size() + (noise.walk_dph_per_rt_s > 0 ? 1 : 0);
  if (n == 1) return f(std::integral_constant<size_t, 1>());
  if (n == 2) return f(std::integral_constant<size_t, 2>());
  return f(std::integral_constant<size_t, 0>());
}

} // namespace

double mixture_log_likelihood(const SampleTimes& times, const NoiseModel& noise, const VectorXd& residual,
                              VectorXd* scores, VectorXd* hit) {
  const auto n = static_cast<long>(times.n);
  if (scores) scores->resize(n);
  if (hit) hit->setZero(n);
  return for_states(noise, [&](auto states) {
    constexpr size_t M = decltype(states)::value;
    if (noise.hit_probability > 0) return hit_log_likelihood<M>(times, noise, residual, scores, hit);
    return TelegraphFilter<M>(times, noise).run(residual, scores);
  });
}

VectorXd expected_hit_dph2(const SampleTimes& times, const NoiseModel& noise, const VectorXd& residual) {
  VectorXd hit;
  mixture_log_likelihood(times, noise, residual, nullptr, &hit);
  const NoiseStates states(times, noise);
  const double extra = noise.hit_sigma_dph * noise.hit_sigma_dph;
  for (long k = 0; k < hit.size(); ++k) {
    const double white = states.white_dph2(static_cast<size_t>(k));
    hit[k] = hit[k] * extra * white / (white + (1 - hit[k]) * extra); // precision (1 - w)/white + w/(white + extra)
  }
  return hit;
}

TelegraphLevel telegraph_level(const SampleTimes& times, const NoiseModel& noise, const VectorXd& residual) {
  const auto n = static_cast<long>(times.n);
  VectorXd upper(n);
  for_states(noise, [&](auto states) {
    return TelegraphFilter<decltype(states)::value>(times, noise).run(residual, nullptr, &upper);
  });
  for (long k = n - 2; k >= 0; --k) {
    const double s = switching(times, noise, static_cast<size_t>(k) + 1), p = upper[k];
    const double next = (1 - s) * p + s * (1 - p); // of +a at k + 1, before that sample
    const double up = upper[k + 1] / std::max(next, 1e-300), down = (1 - upper[k + 1]) / std::max(1 - next, 1e-300);
    upper[k] = std::clamp(p * ((1 - s) * up + s * down), 0.0, 1.0);
  }
  const double a = noise.telegraph_dph;
  return {a * (2 * upper.array() - 1), 4 * a * a * upper.array() * (1 - upper.array())};
}

} // namespace imucal
