// SPDX-License-Identifier: MIT
#include "noise/components.h"

#include <cmath>
#include <stdexcept>

#include "base/error.h"
#include "base/units.h"

namespace imucal {

using Kind = NoiseComponent::Kind;

NoiseComponent white_component(double variance_dph2) {
  NoiseComponent c;
  c.power_dph2 = variance_dph2;
  return c;
}

NoiseComponent markov_component(double variance_dph2, double tau_s, double dt_s) {
  NoiseComponent c;
  c.kind = Kind::kMarkov;
  c.power_dph2 = variance_dph2;
  c.alpha = dt_s / tau_s;
  return c;
}

NoiseComponent walk_component(double step_variance_dph2) {
  NoiseComponent c;
  c.kind = Kind::kRandomWalk;
  c.power_dph2 = step_variance_dph2;
  return c;
}

NoiseComponent ramp_component(double slope_dph_per_sample) {
  NoiseComponent c;
  c.kind = Kind::kRamp;
  c.power_dph2 = std::pow(slope_dph_per_sample, 2);
  return c;
}

NoiseComponent sinusoid_component(double amplitude_dph, double omega_rad_per_sample) {
  NoiseComponent c;
  c.kind = Kind::kSinusoid;
  c.power_dph2 = std::pow(amplitude_dph, 2);
  c.omega_rad = omega_rad_per_sample;
  return c;
}

NoiseComponent angle_component(double angle_error_dph) {
  NoiseComponent c;
  c.kind = Kind::kAngleQuantization;
  c.power_dph2 = std::pow(angle_error_dph, 2);
  return c;
}

std::vector<NoiseComponent> model_components(const ErrorModel& model, double dt_s) {
  std::vector<NoiseComponent> out;
  const double white = white_sigma_dph(model.arw_deg_rt_h, dt_s);
  if (white > 0) out.push_back(white_component(white * white));
  for (const Markov& m : model.markov)
    if (m.sigma_dph > 0) out.push_back(markov_component(m.sigma_dph * m.sigma_dph, m.tau_s, dt_s));
  return out;
}

// sum_{l=1}^{k-1} (k-l)(1-phi^l), phi = exp(-alpha).
static double markov_lost_sum(double k, double alpha) {
  if (k * alpha > 0.01) {
    const double one_minus_phi = -std::expm1(-alpha), one_minus_phi_k = -std::expm1(-alpha * k);
    return 0.5 * k * (k - 1) -
           std::exp(-alpha) * (k * one_minus_phi - one_minus_phi_k) / (one_minus_phi * one_minus_phi);
  }
  // Series in alpha; sum_l (k-l) l^m in closed form.
  const double k2 = k * k;
  const double t1 = k * (k2 - 1) / 6, t2 = k2 * (k2 - 1) / 12, t3 = k * (3 * k2 * k2 - 5 * k2 + 2) / 60,
               t4 = k2 * (k2 - 1) * (2 * k2 - 3) / 60;
  return alpha * (t1 - alpha / 2 * (t2 - alpha / 3 * (t3 - alpha / 4 * t4)));
}

double sum_variance(const NoiseComponent& c, double k) {
  if (k <= 0) return 0;
  switch (c.kind) {
  case Kind::kWhite:
    return c.power_dph2 * k;
  case Kind::kMarkov:
    return -2 * c.power_dph2 * markov_lost_sum(k, c.alpha);
  case Kind::kAngleQuantization:
    return 2 * c.power_dph2;
  case Kind::kRandomWalk:
    return -c.power_dph2 * k * (k * k - 1) / 6;
  default:
    throw std::logic_error("a deterministic component has no variance of sums");
  }
}

std::vector<double> covariance_times(const NoiseComponent& c, const std::vector<double>& v) {
  const size_t n = v.size();
  std::vector<double> out(n);
  const double p = c.power_dph2;
  if (c.kind == Kind::kWhite) {
    for (size_t i = 0; i < n; ++i) out[i] = p * v[i];
  } else if (c.kind == Kind::kAngleQuantization) {
    for (size_t i = 0; i < n; ++i) out[i] = p * (2 * v[i] - (i > 0 ? v[i - 1] : 0) - (i + 1 < n ? v[i + 1] : 0));
  } else if (c.kind == Kind::kMarkov) {
    const double phi = std::exp(-c.alpha);
    double sum = 0;
    for (size_t i = 0; i < n; ++i) out[i] = sum = v[i] + phi * sum;
    sum = 0;
    for (size_t i = n; i-- > 0;) {
      sum *= phi;
      out[i] = p * (out[i] + sum);
      sum += v[i];
    }
  } else if (c.kind == Kind::kRandomWalk) {
    double total = 0, moment = 0; // sum_j |i-j| v_j grows by (sum before) - (sum from here on)
    for (size_t j = 0; j < n; ++j) total += v[j], moment += static_cast<double>(j) * v[j];
    double before = 0;
    for (size_t i = 0; i < n; ++i) {
      out[i] = -0.5 * p * moment;
      before += v[i];
      moment += before - (total - before);
    }
  } else {
    throw std::logic_error("a deterministic component has no covariance matrix here");
  }
  return out;
}

} // namespace imucal
