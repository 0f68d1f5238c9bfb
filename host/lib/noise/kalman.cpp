// SPDX-License-Identifier: MIT
#include "noise/kalman.h"

#include <algorithm>
#include <cmath>

#include "base/quantile.h"
#include "base/simd.h"

namespace imucal {
namespace {

constexpr size_t kWide = 8;        // columns filtered side by side
constexpr double kSettled = 1e-10; // relative change of the gains below which they are taken as constant

// Parameters of all states at one used sample of a run.
class States {
public:
  States(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2 = nullptr)
      : times_(times), noise_(noise), extra_dph2_(extra_dph2) {
    n_ = noise.markov.size() + (noise.walk_dph_per_rt_s > 0 ? 1 : 0);
  }
  size_t size() const { return n_; }
  bool is_constant() const { return noise_.is_stationary() && !extra_dph2_; }

  double tn(size_t k) const { return times_.tn[k]; }
  double white_dph2(size_t k) const {
    const double white = noise_.white_sigma_dph * noise_.white_sigma_dph / times_.dt_s;
    return (noise_.white_slope != 0 ? white * std::exp(noise_.white_slope * tn(k)) : white) +
           noise_.extra_white_dph2 + (extra_dph2_ ? (*extra_dph2_)[static_cast<long>(k)] : 0.0);
  }
  double sigma(size_t i, size_t k) const {
    const double sigma = noise_.markov[i].sigma_dph;
    return i == 0 && noise_.markov_slope != 0 ? sigma * std::exp(0.5 * noise_.markov_slope * tn(k)) : sigma;
  }
  double start_dph2(size_t i) const { return i < noise_.markov.size() ? sigma(i, 0) * sigma(i, 0) : 0.0; }
  // From used sample k to k + 1.
  void transition(size_t k, double* phi, double* q) const {
    const double dt = times_.steps[k + 1] * times_.dt_s;
    for (size_t i = 0; i < noise_.markov.size(); ++i) {
      double tau = noise_.markov[i].tau_s;
      if (i == 0 && noise_.tau_slope != 0) tau *= std::exp(noise_.tau_slope * tn(k));
      const double now = sigma(i, k), next = sigma(i, k + 1);
      phi[i] = std::exp(-dt / tau) * (now > 0 ? next / now : 1.0);
      q[i] = -next * next * std::expm1(-2.0 * dt / tau);
    }
    if (n_ > noise_.markov.size()) {
      phi[n_ - 1] = 1.0;
      q[n_ - 1] = noise_.walk_dph_per_rt_s * noise_.walk_dph_per_rt_s * dt;
    }
  }

private:
  const SampleTimes& times_;
  const NoiseModel& noise_;
  const Eigen::VectorXd* extra_dph2_;
  size_t n_;
};

// Filters kWide columns, interleaved: in and out [sample][kWide].  state: [state][kWide], carried on.
IMUCAL_WIDE void filter_one_state(const double* phi, const double* gain, const double* inv_sqrt_s, size_t n,
                                  double* x, double* state) {
  double m[kWide];
  for (size_t c = 0; c < kWide; ++c) m[c] = state[c];
  for (size_t k = 0; k < n; ++k) {
    const double a = phi[k], g = gain[k], w = inv_sqrt_s[k];
    double* row = x + k * kWide;
    for (size_t c = 0; c < kWide; ++c) {
      const double nu = row[c] - m[c];
      row[c] = nu * w;
      m[c] = a * (m[c] + g * nu);
    }
  }
  for (size_t c = 0; c < kWide; ++c) state[c] = m[c];
}

IMUCAL_WIDE void filter_states(size_t n_states, const double* phi, const double* gain,
                               const double* inv_sqrt_s, size_t n, double* x, double* m) {
  for (size_t k = 0; k < n; ++k) {
    const double* a = phi + k * n_states;
    const double* g = gain + k * n_states;
    double* row = x + k * kWide;
    double nu[kWide];
    for (size_t c = 0; c < kWide; ++c) nu[c] = row[c];
    for (size_t i = 0; i < n_states; ++i)
      for (size_t c = 0; c < kWide; ++c) nu[c] -= m[i * kWide + c];
    const double w = inv_sqrt_s[k];
    for (size_t c = 0; c < kWide; ++c) row[c] = nu[c] * w;
    for (size_t i = 0; i < n_states; ++i)
      for (size_t c = 0; c < kWide; ++c) m[i * kWide + c] = a[i] * (m[i * kWide + c] + g[i] * nu[c]);
  }
}

// Samples first .. first + n.
void filter(const RunGains& gains, size_t first, size_t n, double* x, double* state) {
  const size_t m = gains.n_states;
  if (m == 1)
    filter_one_state(&gains.phi[first], &gains.gain[first], &gains.inv_sqrt_s[first], n, x, state);
  else
    filter_states(m, gains.phi.data() + first * m, gains.gain.data() + first * m, &gains.inv_sqrt_s[first], n,
                  x, state);
}

// g[i][j] += sum_k a[k][i] b[k][j], all kWide wide.
IMUCAL_WIDE void add_products(const double* a, const double* b, size_t n, double* g) {
  double sum[kWide * kWide];
  for (size_t i = 0; i < kWide * kWide; ++i) sum[i] = g[i];
  for (size_t k = 0; k < n; ++k)
    for (size_t i = 0; i < kWide; ++i)
      for (size_t j = 0; j < kWide; ++j) sum[i * kWide + j] += a[k * kWide + i] * b[k * kWide + j];
  for (size_t i = 0; i < kWide * kWide; ++i) g[i] = sum[i];
}

// One Kalman step of the covariance at sample k: fills gain and inv_sqrt_s, updates and predicts `p`.
class CovarianceFilter {
public:
  CovarianceFilter(const States& states)
      : s_(states), n_(states.size()), p_(n_ * n_, 0.0), ph_(n_), phi_(n_), q_(n_) {
    for (size_t i = 0; i < n_; ++i) p_[i * n_ + i] = s_.start_dph2(i);
  }
  double update(size_t k, double* gain) {
    double s = s_.white_dph2(k);
    for (size_t i = 0; i < n_; ++i) {
      ph_[i] = 0;
      for (size_t j = 0; j < n_; ++j) ph_[i] += p_[i * n_ + j];
      s += ph_[i];
    }
    for (size_t i = 0; i < n_; ++i) gain[i] = ph_[i] / s;
    for (size_t i = 0; i < n_; ++i)
      for (size_t j = 0; j < n_; ++j) p_[i * n_ + j] -= gain[i] * ph_[j];
    return s;
  }
  void predict(size_t k, double* phi, bool reuse) {
    if (!reuse) s_.transition(k, phi_.data(), q_.data());
    for (size_t i = 0; i < n_; ++i) {
      phi[i] = phi_[i];
      for (size_t j = 0; j < n_; ++j) p_[i * n_ + j] *= phi_[i] * phi_[j];
      p_[i * n_ + i] += q_[i];
    }
  }

private:
  const States& s_;
  size_t n_;
  std::vector<double> p_, ph_, phi_, q_;
};

} // namespace

RunGains compute_gains(const SampleTimes& times, const NoiseModel& noise, const Eigen::VectorXd* extra_dph2) {
  const States states(times, noise, extra_dph2);
  const size_t n = times.n, m = states.size();
  RunGains out;
  out.n_states = m;
  out.inv_sqrt_s.resize(n);
  out.gain.assign(n * m, 0.0);
  out.phi.assign(n * m, 0.0);
  CovarianceFilter filter(states);
  double log_s = 0, product = 1; // logarithms of products: fewer of them
  bool is_settled = false;
  for (size_t k = 0; k < n; ++k) {
    const bool next_is_second = k + 1 < n && times.steps[k + 1] == 1;
    if (is_settled) {
      out.inv_sqrt_s[k] = out.inv_sqrt_s[k - 1];
      for (size_t i = 0; i < m; ++i) {
        out.gain[k * m + i] = out.gain[(k - 1) * m + i];
        out.phi[k * m + i] = out.phi[(k - 1) * m + i];
      }
      if (k + 1 < n && !next_is_second) { // a gap: the covariance moves again
        double* gain = out.gain.data() + k * m;
        filter.update(k, gain);
        filter.predict(k, out.phi.data() + k * m, false);
        is_settled = false;
      }
    } else {
      const double s = filter.update(k, out.gain.data() + k * m);
      out.inv_sqrt_s[k] = 1.0 / std::sqrt(s);
      if (k + 1 < n) {
        const bool same_step = k > 0 && times.steps[k] == times.steps[k + 1] && states.is_constant();
        filter.predict(k, out.phi.data() + k * m, same_step);
      }
      if (states.is_constant() && k > 0 && next_is_second && times.steps[k] == 1) {
        bool same = std::fabs(out.inv_sqrt_s[k] - out.inv_sqrt_s[k - 1]) <= kSettled * out.inv_sqrt_s[k];
        for (size_t i = 0; i < m && same; ++i)
          same = std::fabs(out.gain[k * m + i] - out.gain[(k - 1) * m + i]) <= kSettled * out.gain[k * m + i];
        is_settled = same;
      }
    }
    product *= out.inv_sqrt_s[k];
    if (product < 1e-250 || product > 1e250) log_s -= 2 * std::log(product), product = 1;
  }
  out.sum_log_s = log_s - 2 * std::log(product);
  return out;
}

namespace {

// Columns side by side: out [sample][kWide], zero beyond `width`.
void interleave(const double* columns, size_t n, size_t width, double* out) {
  for (size_t c = 0; c < kWide; ++c)
    for (size_t k = 0; k < n; ++k) out[k * kWide + c] = c < width ? columns[c * n + k] : 0.0;
}

} // namespace

void whiten(const RunGains& gains, Eigen::MatrixXd* columns) {
  const size_t n = static_cast<size_t>(columns->rows()), p = static_cast<size_t>(columns->cols());
  if (p == 1) return whiten(gains, columns->data(), n);
  std::vector<double> block(n * kWide), state(std::max<size_t>(1, gains.n_states) * kWide);
  for (size_t first = 0; first < p; first += kWide) {
    const size_t width = std::min(kWide, p - first);
    interleave(columns->data() + first * n, n, width, block.data());
    std::fill(state.begin(), state.end(), 0.0);
    filter(gains, 0, n, block.data(), state.data());
    for (size_t c = 0; c < width; ++c) {
      double* out = columns->data() + (first + c) * n;
      for (size_t k = 0; k < n; ++k) out[k] = block[k * kWide + c];
    }
  }
}

WideColumns::WideColumns(const Eigen::MatrixXd& columns)
    : n_(static_cast<size_t>(columns.rows())), p_(static_cast<size_t>(columns.cols())),
      data_((p_ + kWide - 1) / kWide * n_ * kWide) {
  for (size_t first = 0; first < p_; first += kWide)
    interleave(columns.data() + first * n_, n_, std::min(kWide, p_ - first), &data_[first * n_]);
}

Eigen::MatrixXd WideColumns::whitened_gram(const RunGains& gains) const {
  constexpr size_t kChunk = 128; // samples that stay in the first cache
  const size_t blocks = (p_ + kWide - 1) / kWide, states = std::max<size_t>(1, gains.n_states) * kWide;
  std::vector<double> chunk(blocks * kChunk * kWide), state(blocks * states, 0.0),
      sums(blocks * blocks * kWide * kWide, 0.0);
  for (size_t k = 0; k < n_; k += kChunk) {
    const size_t n = std::min(kChunk, n_ - k);
    for (size_t b = 0; b < blocks; ++b) {
      double* x = &chunk[b * kChunk * kWide];
      std::copy_n(&data_[b * n_ * kWide + k * kWide], n * kWide, x);
      filter(gains, k, n, x, &state[b * states]);
    }
    for (size_t a = 0; a < blocks; ++a)
      for (size_t b = a; b < blocks; ++b)
        add_products(&chunk[a * kChunk * kWide], &chunk[b * kChunk * kWide], n,
                     &sums[(a * blocks + b) * kWide * kWide]);
  }
  Eigen::MatrixXd gram(static_cast<long>(p_), static_cast<long>(p_));
  for (size_t i = 0; i < p_; ++i)
    for (size_t j = i; j < p_; ++j)
      gram(static_cast<long>(i), static_cast<long>(j)) = gram(static_cast<long>(j), static_cast<long>(i)) =
          sums[((i / kWide) * blocks + j / kWide) * kWide * kWide + (i % kWide) * kWide + j % kWide];
  return gram;
}

void whiten(const RunGains& gains, double* column, size_t n) {
  std::vector<double> m(gains.n_states, 0.0);
  for (size_t k = 0; k < n; ++k) {
    double nu = column[k];
    for (size_t i = 0; i < m.size(); ++i) nu -= m[i];
    column[k] = nu * gains.inv_sqrt_s[k];
    for (size_t i = 0; i < m.size(); ++i)
      m[i] = gains.phi[k * m.size() + i] * (m[i] + gains.gain[k * m.size() + i] * nu);
  }
}

void colour(const RunGains& gains, double* column, size_t n) {
  std::vector<double> m(gains.n_states, 0.0);
  for (size_t k = 0; k < n; ++k) {
    const double nu = column[k] / gains.inv_sqrt_s[k];
    double prediction = 0;
    for (size_t i = 0; i < m.size(); ++i) prediction += m[i];
    column[k] = prediction + nu;
    for (size_t i = 0; i < m.size(); ++i)
      m[i] = gains.phi[k * m.size() + i] * (m[i] + gains.gain[k * m.size() + i] * nu);
  }
}

namespace {

// Standard normal score of a probability that rounding may have pushed to 0 or 1.
double normal_score(double p) {
  return normal_quantile(std::clamp(p, 1e-15, 1 - 1e-15));
}

// Outliers: each sample is normal or a hit; the state's density is collapsed to one Gaussian after each
// sample.
class HitFilter {
public:
  HitFilter(const SampleTimes& times, const NoiseModel& noise)
      : states_(times, noise), noise_(noise), n_(states_.size()) {}

  double go(const Eigen::VectorXd& y, size_t n, Eigen::VectorXd* scores, Eigen::VectorXd* hit) {
    std::vector<double> mean(n_, 0.0), p(n_ * n_, 0.0), ph(n_), phi(n_), q(n_);
    for (size_t i = 0; i < n_; ++i) p[i * n_ + i] = states_.start_dph2(i);
    const double extra = noise_.hit_sigma_dph * noise_.hit_sigma_dph, prob = noise_.hit_probability;
    double log_likelihood = 0;
    for (size_t k = 0; k < n; ++k) {
      double s0 = states_.white_dph2(k), nu = y[static_cast<long>(k)];
      for (size_t i = 0; i < n_; ++i) {
        ph[i] = 0;
        for (size_t j = 0; j < n_; ++j) ph[i] += p[i * n_ + j];
        s0 += ph[i];
        nu -= mean[i];
      }
      const double s1 = s0 + extra;
      // Densities up to 1/sqrt(2 pi), relative to the larger exponent.
      const double e0 = -0.5 * nu * nu / s0, e1 = -0.5 * nu * nu / s1, top = std::max(e0, e1);
      const double d0 = (1 - prob) * std::exp(e0 - top) / std::sqrt(s0),
                   d1 = prob * std::exp(e1 - top) / std::sqrt(s1);
      log_likelihood += top + std::log(d0 + d1);
      const double w = d1 / (d0 + d1);
      if (hit) (*hit)[static_cast<long>(k)] = w;
      if (scores)
        (*scores)[static_cast<long>(k)] =
            normal_score((1 - prob) * normal_cdf(nu / std::sqrt(s0)) + prob * normal_cdf(nu / std::sqrt(s1)));
      const double g = (1 - w) * nu / s0 + w * nu / s1;
      const double spread = w * (1 - w) * nu * nu * (1 / s0 - 1 / s1) * (1 / s0 - 1 / s1);
      const double c = (1 - w) / s0 + w / s1 - spread;
      for (size_t i = 0; i < n_; ++i) mean[i] += ph[i] * g;
      for (size_t i = 0; i < n_; ++i)
        for (size_t j = 0; j < n_; ++j) p[i * n_ + j] -= ph[i] * ph[j] * c;
      if (k + 1 == n) break;
      states_.transition(k, phi.data(), q.data());
      for (size_t i = 0; i < n_; ++i) {
        mean[i] *= phi[i];
        for (size_t j = 0; j < n_; ++j) p[i * n_ + j] *= phi[i] * phi[j];
        p[i * n_ + i] += q[i];
      }
    }
    return log_likelihood;
  }

private:
  States states_;
  const NoiseModel& noise_;
  size_t n_;
};

// Telegraph noise: two modes (+a, -a), each with a Kalman filter of its own, mixed before every prediction.
class TelegraphFilter {
public:
  TelegraphFilter(const SampleTimes& times, const NoiseModel& noise)
      : times_(times), states_(times, noise), noise_(noise), n_(states_.size()) {}

  double go(const Eigen::VectorXd& y, size_t n, Eigen::VectorXd* scores) {
    // The two modes share the covariance up to the spread of the means: kept apart for exactness of the
    // mixture.
    std::vector<double> mean[2], p[2], ph(n_), phi(n_), q(n_);
    for (int j = 0; j < 2; ++j) {
      mean[j].assign(n_, 0.0);
      p[j].assign(n_ * n_, 0.0);
      for (size_t i = 0; i < n_; ++i) p[j][i * n_ + i] = states_.start_dph2(i);
    }
    double prob[2] = {0.5, 0.5}, log_likelihood = 0;
    const double level[2] = {noise_.telegraph_dph, -noise_.telegraph_dph};
    for (size_t k = 0; k < n; ++k) {
      double nu[2], s[2], e[2];
      const double white = states_.white_dph2(k);
      for (int j = 0; j < 2; ++j) {
        nu[j] = y[static_cast<long>(k)] - level[j];
        s[j] = white;
        for (size_t i = 0; i < n_; ++i) {
          nu[j] -= mean[j][i];
          for (size_t c = 0; c < n_; ++c) s[j] += p[j][i * n_ + c];
        }
        e[j] = -0.5 * nu[j] * nu[j] / s[j];
      }
      const double top = std::max(e[0], e[1]);
      double d[2], sum = 0;
      for (int j = 0; j < 2; ++j) d[j] = prob[j] * std::exp(e[j] - top) / std::sqrt(s[j]), sum += d[j];
      log_likelihood += top + std::log(sum);
      if (scores)
        (*scores)[static_cast<long>(k)] = normal_score(prob[0] * normal_cdf(nu[0] / std::sqrt(s[0])) +
                                                       prob[1] * normal_cdf(nu[1] / std::sqrt(s[1])));
      for (int j = 0; j < 2; ++j) {
        for (size_t i = 0; i < n_; ++i) {
          ph[i] = 0;
          for (size_t c = 0; c < n_; ++c) ph[i] += p[j][i * n_ + c];
        }
        for (size_t i = 0; i < n_; ++i) mean[j][i] += ph[i] / s[j] * nu[j];
        for (size_t i = 0; i < n_; ++i)
          for (size_t c = 0; c < n_; ++c) p[j][i * n_ + c] -= ph[i] * ph[c] / s[j];
        prob[j] = d[j] / sum;
      }
      if (k + 1 == n) break;
      const double dt = times_.steps[k + 1] * times_.dt_s;
      mix(-0.5 * std::expm1(-dt / noise_.telegraph_tau_s), prob, mean, p);
      states_.transition(k, phi.data(), q.data());
      for (int j = 0; j < 2; ++j)
        for (size_t i = 0; i < n_; ++i) {
          mean[j][i] *= phi[i];
          for (size_t c = 0; c < n_; ++c) p[j][i * n_ + c] *= phi[i] * phi[c];
          p[j][i * n_ + i] += q[i];
        }
    }
    return log_likelihood;
  }

private:
  void mix(double switching, double* prob, std::vector<double>* mean, std::vector<double>* p) {
    const double next[2] = {(1 - switching) * prob[0] + switching * prob[1],
                            switching * prob[0] + (1 - switching) * prob[1]};
    std::vector<double>*mixed_mean = mixed_mean_, *mixed_p = mixed_p_;
    for (int j = 0; j < 2; ++j) {
      const double from_other = switching * prob[1 - j] / std::max(next[j], 1e-300);
      mixed_mean[j].resize(n_);
      mixed_p[j].resize(n_ * n_);
      for (size_t i = 0; i < n_; ++i)
        mixed_mean[j][i] = (1 - from_other) * mean[j][i] + from_other * mean[1 - j][i];
      for (size_t i = 0; i < n_; ++i)
        for (size_t c = 0; c < n_; ++c)
          mixed_p[j][i * n_ + c] =
              (1 - from_other) * p[j][i * n_ + c] + from_other * p[1 - j][i * n_ + c] +
              from_other * (1 - from_other) * (mean[j][i] - mean[1 - j][i]) * (mean[j][c] - mean[1 - j][c]);
    }
    for (int j = 0; j < 2; ++j) {
      prob[j] = next[j];
      mean[j].swap(mixed_mean[j]);
      p[j].swap(mixed_p[j]);
    }
  }

  const SampleTimes& times_;
  States states_;
  const NoiseModel& noise_;
  size_t n_;
  std::vector<double> mixed_mean_[2], mixed_p_[2];
};

} // namespace

double mixture_log_likelihood(const SampleTimes& times, const NoiseModel& noise,
                              const Eigen::VectorXd& residual, Eigen::VectorXd* scores,
                              Eigen::VectorXd* hit) {
  const size_t n = times.n;
  if (scores) scores->resize(static_cast<long>(n));
  if (hit) hit->setZero(static_cast<long>(n));
  if (noise.hit_probability > 0) return HitFilter(times, noise).go(residual, n, scores, hit);
  return TelegraphFilter(times, noise).go(residual, n, scores);
}

} // namespace imucal
