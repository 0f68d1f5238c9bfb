// SPDX-License-Identifier: MIT
#include <cmath>

#include "base/units.h"
#include "analysis/profile/covariance.h"

namespace imucal {

// What the backward recursion needs of the forward one: per sample the innovation variance, and per sample
// and term the gain and the transition to the next sample.
struct Whitener::Pass {
  std::vector<double> variance_dph2, gain, phi_next;
};

Whitener::Whitener(const ErrorModel& model, double dt_s) : dt_s_(dt_s) {
  const double white = white_sigma_dph(model.arw_deg_rt_h, dt_s);
  white_dph2_ = white * white;
  for (const Markov& m : model.markov)
    if (m.sigma_dph > 0) terms_.push_back({m.sigma_dph * m.sigma_dph, m.tau_s});
}

// Kalman filter with the Markov terms as states, started in their stationary distribution.  The gains do not
// depend on the columns, so that all columns share one covariance recursion; once the gain has settled on
// even steps it is kept (settled: every covariance changed by less than 1e-15 of itself).
void Whitener::forward(size_t width, std::vector<double>* columns, const std::vector<double>& step_s,
                       Pass* pass) const {
  const size_t n_terms = terms_.size(), n = columns->size() / width;
  std::vector<double> cov(n_terms * n_terms, 0.0), gain(n_terms), phi(n_terms), state(n_terms * width, 0.0);
  for (size_t i = 0; i < n_terms; ++i) cov[i * n_terms + i] = terms_[i].variance_dph2;
  if (pass) {
    pass->variance_dph2.resize(n);
    pass->gain.resize(n * n_terms);
    pass->phi_next.resize(n * n_terms);
  }
  double variance = white_dph2_, scale = 1, last_step_s = -1;
  bool settled = false;
  for (size_t k = 0; k < n; ++k) {
    if (!settled) {
      variance = white_dph2_;
      for (size_t i = 0; i < n_terms; ++i) {
        gain[i] = 0;
        for (size_t j = 0; j < n_terms; ++j) gain[i] += cov[i * n_terms + j];
        variance += gain[i];
      }
      for (double& g : gain) g /= variance;
      scale = 1 / std::sqrt(variance);
    }
    double* row = columns->data() + k * width;
    for (size_t c = 0; c < width; ++c) {
      for (size_t i = 0; i < n_terms; ++i) row[c] -= state[i * width + c];
    }
    const double next_s = k + 1 < n && !step_s.empty() ? step_s[k + 1] : dt_s_;
    if (next_s != last_step_s) {
      for (size_t i = 0; i < n_terms; ++i) phi[i] = std::exp(-next_s / terms_[i].tau_s);
      last_step_s = next_s;
      settled = false;
    }
    for (size_t i = 0; i < n_terms; ++i)
      for (size_t c = 0; c < width; ++c)
        state[i * width + c] = phi[i] * (state[i * width + c] + gain[i] * row[c]);
    if (pass) {
      pass->variance_dph2[k] = variance;
      for (size_t i = 0; i < n_terms; ++i) {
        pass->gain[k * n_terms + i] = gain[i];
        pass->phi_next[k * n_terms + i] = phi[i];
      }
    } else {
      for (size_t c = 0; c < width; ++c) row[c] *= scale;
    }
    if (settled) continue;
    settled = true;
    for (size_t i = 0; i < n_terms; ++i) {
      for (size_t j = 0; j <= i; ++j) {
        double next = phi[i] * phi[j] * (cov[i * n_terms + j] - gain[i] * gain[j] * variance);
        if (i == j) next -= terms_[i].variance_dph2 * std::expm1(-2 * next_s / terms_[i].tau_s);
        if (std::abs(next - cov[i * n_terms + j]) > 1e-15 * std::abs(next)) settled = false;
        cov[i * n_terms + j] = cov[j * n_terms + i] = next;
      }
    }
  }
}

void Whitener::whiten(size_t width, std::vector<double>* columns, const std::vector<double>& step_s) const {
  forward(width, columns, step_s, nullptr);
}

// V^-1 z by the backward recursion of the disturbance smoother (Durbin & Koopman 2012, 4.5.3):
// u_k = v_k / F_k - K_k' r_k,  r_{k-1} = H' u_k + Phi' r_k,  K = Phi g, H = [1 … 1].
void Whitener::solve(size_t width, std::vector<double>* columns, const std::vector<double>& step_s) const {
  Pass pass;
  forward(width, columns, step_s, &pass);
  const size_t n_terms = terms_.size(), n = columns->size() / width;
  std::vector<double> r(n_terms * width, 0.0);
  for (size_t k = n; k-- > 0;) {
    double* row = columns->data() + k * width;
    const double* gain = pass.gain.data() + k * n_terms;
    const double* phi = pass.phi_next.data() + k * n_terms;
    for (size_t c = 0; c < width; ++c) {
      double u = row[c] / pass.variance_dph2[k];
      for (size_t i = 0; i < n_terms; ++i) u -= phi[i] * gain[i] * r[i * width + c];
      for (size_t i = 0; i < n_terms; ++i) r[i * width + c] = u + phi[i] * r[i * width + c];
      row[c] = u;
    }
  }
}

// White: r A'A.  Markov term: with a_k = phi a_{k-1} + u_k, sum_{k,l} phi^|k-l| u_k u_l' =
// sum_k (a_k u_k' + u_k a_k' - u_k u_k').
std::vector<double> noise_quadratic(const ErrorModel& model, double dt_s, size_t width,
                                    const std::vector<double>& columns, const std::vector<double>& step_s) {
  const size_t n = columns.size() / width;
  const double white = white_sigma_dph(model.arw_deg_rt_h, dt_s);
  std::vector<double> out(width * width, 0.0), a(width);
  const auto add = [&](double factor, const double* left, const double* right) {
    for (size_t i = 0; i < width; ++i)
      for (size_t j = 0; j < width; ++j) out[i * width + j] += factor * left[i] * right[j];
  };
  for (size_t k = 0; k < n; ++k) add(white * white, &columns[k * width], &columns[k * width]);
  for (const Markov& m : model.markov) {
    const double variance = m.sigma_dph * m.sigma_dph;
    a.assign(width, 0.0);
    double step = dt_s, phi = std::exp(-step / m.tau_s);
    for (size_t k = 0; k < n; ++k) {
      if (!step_s.empty() && step_s[k] != step) {
        step = step_s[k];
        phi = std::exp(-step / m.tau_s);
      }
      const double* u = &columns[k * width];
      for (size_t i = 0; i < width; ++i) a[i] = (k ? phi * a[i] : 0.0) + u[i];
      add(variance, a.data(), u);
      add(variance, u, a.data());
      add(-variance, u, u);
    }
  }
  return out;
}

} // namespace imucal
