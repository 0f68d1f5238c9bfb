// SPDX-License-Identifier: MIT
#include "noise/steady_filter.h"

#include <algorithm>
#include <cmath>

namespace imucal {
namespace {

// r + sum_i c_i / (u_i - u), u increasing.
struct SecularEquation {
  double r = 0;
  std::vector<double> alpha, variance; // step/tau; 0: random walk, whose variance is q
  std::vector<double> c, u;
};

// Terms in the order of alpha, those of equal time constants merged.
void merge_terms(const NoiseModel& noise, double step_s, SecularEquation* eq) {
  std::vector<std::pair<double, double>> terms; // alpha, variance
  const double q = noise.walk_dph_per_rt_s * noise.walk_dph_per_rt_s * step_s;
  if (q > 0) terms.emplace_back(0.0, q);
  for (const Markov& m : noise.markov)
    if (m.sigma_dph > 0) terms.emplace_back(step_s / m.tau_s, m.sigma_dph * m.sigma_dph);
  std::sort(terms.begin(), terms.end());
  for (const auto& [alpha, variance] : terms) {
    if (!eq->alpha.empty() && eq->alpha.back() > 0 && alpha < eq->alpha.back() * (1 + 1e-7)) {
      eq->variance.back() += variance;
    } else {
      eq->alpha.push_back(alpha);
      eq->variance.push_back(variance);
    }
  }
}

SecularEquation secular_equation(const NoiseModel& noise, double step_s, double dt_s) {
  SecularEquation eq;
  eq.r = (noise.white_sigma_dph * noise.white_sigma_dph + noise.extra_white_dph2) / dt_s;
  merge_terms(noise, step_s, &eq);
  for (size_t i = 0; i < eq.alpha.size(); ++i) {
    const double half = std::sinh(0.5 * eq.alpha[i]);
    eq.u.push_back(4 * half * half);
    // q / phi = sigma^2 (1 - phi^2) / phi
    eq.c.push_back(eq.alpha[i] > 0 ? eq.variance[i] * 2 * std::sinh(eq.alpha[i]) : eq.variance[i]);
  }
  return eq;
}

// Root m: between u_m, where the left side rises from -inf, and the next u or the end of all roots; bisection on
// the logarithm of the distance from u_m until it is known to `tolerance` of itself.
double secular_root(const SecularEquation& eq, size_t m, double tolerance) {
  double sum_c = 0;
  for (const double c : eq.c) sum_c += c;
  const double lo = eq.u[m], hi = m + 1 < eq.u.size() ? eq.u[m + 1] : eq.u.back() + sum_c / eq.r * (1 + 1e-12);
  if (eq.u.size() == 1 || std::isinf(hi)) return m + 1 < eq.u.size() ? hi : lo + sum_c / eq.r;
  double below = 0, above = hi - lo;
  for (int k = 0; k < 200; ++k) {
    const double middle = below > 0 ? std::sqrt(below * above) : above * 1e-3;
    double f = eq.r;
    for (size_t i = 0; i < eq.c.size(); ++i) f += eq.c[i] / ((eq.u[i] - lo) - middle);
    if (middle <= below * (1 + tolerance) || middle >= above * (1 - tolerance)) break;
    if (f < 0) {
      below = middle;
    } else {
      above = middle;
      if (below == 0 && above < 1e-280) break;
    }
  }
  return lo + 0.5 * (below + above);
}

// -ln pole
double rate_of(double root) {
  return 2 * std::asinh(0.5 * std::sqrt(root));
}

// gain_i, and how a unit sample rings in state i: residues of prod (1 - phi_j z) / prod (1 - pole_m z).
double gain_of(const SecularEquation& eq, const std::vector<double>& beta, size_t i) {
  double gain = 1; // 1 - pole/phi = -expm1(alpha - beta)
  for (const double b : beta) gain *= -std::expm1(eq.alpha[i] - b);
  for (size_t j = 0; j < beta.size(); ++j)
    if (j != i) gain /= -std::expm1(eq.alpha[i] - eq.alpha[j]);
  return gain;
}

std::vector<double> response_of(const SecularEquation& eq, const std::vector<double>& beta, size_t i, double gain) {
  const size_t n = beta.size();
  std::vector<double> response(n, gain);
  for (size_t m = 0; m < n; ++m)
    for (size_t j = 0; j < n; ++j) {
      if (j != i) response[m] *= -std::expm1(beta[m] - eq.alpha[j]);
      if (j != m) response[m] /= -std::expm1(beta[m] - beta[j]);
    }
  return response;
}

} // namespace

SteadyFilter steady_filter(const NoiseModel& noise, double step_s, double dt_s) {
  const SecularEquation eq = secular_equation(noise, step_s, dt_s);
  SteadyFilter f;
  std::vector<double> beta;
  f.innovation_variance_dph2 = eq.r;
  for (size_t i = 0; i < eq.u.size(); ++i) {
    beta.push_back(rate_of(secular_root(eq, i, 4e-16)));
    f.phi.push_back(std::exp(-eq.alpha[i]));
    f.pole.push_back(std::exp(-beta[i]));
    f.innovation_variance_dph2 *= std::exp(beta[i] - eq.alpha[i]);
  }
  for (size_t i = 0; i < beta.size(); ++i) {
    f.gain.push_back(gain_of(eq, beta, i));
    f.response.push_back(response_of(eq, beta, i, f.gain[i]));
  }
  return f;
}

double slowest_pole(const NoiseModel& noise, double step_s, double dt_s) {
  const SecularEquation eq = secular_equation(noise, step_s, dt_s);
  return eq.u.empty() ? 0.0 : std::exp(-rate_of(secular_root(eq, 0, 1e-4)));
}

} // namespace imucal
