// SPDX-License-Identifier: MIT
#include "noise/noise_model.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "base/units.h"

namespace imucal {

double variance_of_mean(double time_over_tau) {
  const double a = time_over_tau;
  return a < 1e-3 ? 1 - a / 3 : 2 * (a + std::expm1(-a)) / (a * a);
}

bool operator==(const NoiseModel& a, const NoiseModel& b) {
  const auto rest = [](const NoiseModel& m) {
    return std::make_tuple(m.white_sigma_dph, m.walk_dph_per_rt_s, m.white_slope, m.markov_slope, m.tau_slope,
                           m.extra_white_dph2, m.hit_probability, m.hit_sigma_dph, m.telegraph_dph, m.telegraph_tau_s);
  };
  const auto is_same = [](const Markov& x, const Markov& y) {
    return x.sigma_dph == y.sigma_dph && x.tau_s == y.tau_s;
  };
  return rest(a) == rest(b) && std::equal(a.markov.begin(), a.markov.end(), b.markov.begin(), b.markov.end(), is_same);
}

NoiseModel with_factors(const NoiseModel& base, const double* x) {
  NoiseModel out = base;
  out.white_sigma_dph *= std::exp(x[0]);
  for (Markov& m : out.markov) m.tau_s *= std::exp(x[2]), m.sigma_dph *= std::exp(0.5 * (x[1] + x[2]));
  return out;
}

NoiseModel noise_of(const ErrorModel& model) {
  NoiseModel out;
  out.white_sigma_dph = white_sigma_dph(model.arw_deg_rt_h, 1.0);
  for (const Markov& m : model.markov)
    if (m.sigma_dph > 0) out.markov.push_back(m);
  return out;
}

NoiseModel gaussian_equivalent(NoiseModel noise) {
  noise.hit_probability = noise.hit_sigma_dph = 0;
  if (noise.telegraph_dph > 0) noise.markov.push_back({noise.telegraph_dph, noise.telegraph_tau_s});
  noise.telegraph_dph = noise.telegraph_tau_s = 0;
  return noise;
}

} // namespace imucal
