// SPDX-License-Identifier: MIT
#include "analysis/dp/nominal_filter.h"

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/units.h"

namespace imucal {

namespace {

struct Term {
  double alpha;  // dt/tau
  double variance;
};

std::vector<Term> merged_terms(const ErrorModel& model, double dt_s) {
  std::vector<Term> terms;
  for (const Markov& m : model.markov)
    if (m.sigma_dph > 0) terms.push_back({dt_s / m.tau_s, m.sigma_dph * m.sigma_dph});
  std::sort(terms.begin(), terms.end(), [](const Term& a, const Term& b) { return a.alpha < b.alpha; });
  std::vector<Term> merged;
  for (const Term& t : terms) {
    if (!merged.empty() && t.alpha < merged.back().alpha * (1 + 1e-7))
      merged.back().variance += t.variance;
    else
      merged.push_back(t);
  }
  return merged;
}

// Root of r + sum c_i / (u_i - u) in (lo, hi), where it rises from -inf; bisection on the distance from lo.
double secular_root(double r, const std::vector<double>& c, const std::vector<double>& u, double lo, double hi) {
  double below = 0, above = hi - lo;
  for (int k = 0; k < 200; ++k) {
    const double middle = below > 0 ? std::sqrt(below * above) : above * 1e-3;
    double f = r;
    for (size_t i = 0; i < c.size(); ++i) f += c[i] / ((u[i] - lo) - middle);
    if (middle <= below * (1 + 4e-16) || middle >= above * (1 - 4e-16)) break;
    if (f < 0) {
      below = middle;
    } else {
      above = middle;
      if (below == 0 && above < 1e-280) break;
    }
  }
  return lo + 0.5 * (below + above);
}

}  // namespace

NominalFilter make_nominal_filter(const ErrorModel& nominal, double dt_s) {
  const std::vector<Term> terms = merged_terms(nominal, dt_s);
  if (terms.empty())
    throw usage_error("the nominal model has no Markov term with sigma > 0: DP2 and DP3 have nothing to estimate; "
                      "give a model with one, or use --type av or dp1");
  const size_t n = terms.size();
  double total = 0;
  for (const Term& t : terms) total += t.variance;
  const double white = white_sigma_dph(nominal.arw_deg_rt_h, dt_s);
  const double r = std::max(white * white, 1e-9 * total);

  std::vector<double> u(n), c(n), beta(n);
  double sum_c = 0;
  for (size_t i = 0; i < n; ++i) {
    const double half = std::sinh(0.5 * terms[i].alpha);
    u[i] = 4 * half * half;
    c[i] = terms[i].variance * 2 * std::sinh(terms[i].alpha);  // q / phi = sigma^2 (1 - phi^2) / phi
    sum_c += c[i];
  }
  for (size_t m = 0; m < n; ++m) {
    const double hi = m + 1 < n ? u[m + 1] : u[n - 1] + sum_c / r * (1 + 1e-12);
    beta[m] = 2 * std::asinh(0.5 * std::sqrt(secular_root(r, c, u, u[m], hi)));
  }

  NominalFilter f;
  f.dt_s = dt_s;
  f.innovation_variance_dph2 = r;
  for (size_t i = 0; i < n; ++i) {
    f.phi.push_back(std::exp(-terms[i].alpha));
    f.pole.push_back(std::exp(-beta[i]));
    f.innovation_variance_dph2 *= std::exp(beta[i] - terms[i].alpha);
  }
  for (size_t i = 0; i < n; ++i) {
    double gain = 1;  // 1 - pole/phi = -expm1(alpha - beta)
    for (size_t m = 0; m < n; ++m) gain *= -std::expm1(terms[i].alpha - beta[m]);
    for (size_t j = 0; j < n; ++j)
      if (j != i) gain /= -std::expm1(terms[i].alpha - terms[j].alpha);
    f.gain.push_back(gain);
    std::vector<double> response(n, gain);
    for (size_t m = 0; m < n; ++m) {
      for (size_t j = 0; j < n; ++j)
        if (j != i) response[m] *= -std::expm1(beta[m] - terms[j].alpha);
      for (size_t l = 0; l < n; ++l)
        if (l != m) response[m] /= -std::expm1(beta[m] - beta[l]);
    }
    f.response.push_back(response);
  }
  return f;
}

long NominalFilter::warm_up_n() const {
  const double slowest = *std::max_element(pole.begin(), pole.end());
  return std::max(1L, static_cast<long>(std::ceil(std::log(1e-4) / std::log(slowest))));
}

double NominalFilter::prediction_factor(size_t i, long n, bool optimal) const {
  if (!optimal) return 1;
  const double alpha = -std::log(phi[i]);
  return phi[i] * std::expm1(-alpha * static_cast<double>(n)) / (static_cast<double>(n) * std::expm1(-alpha));
}

}  // namespace imucal
