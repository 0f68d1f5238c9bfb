// SPDX-License-Identifier: MIT
#include "analysis/dp/nominal_filter.h"

#include <algorithm>
#include <cmath>

#include "base/error.h"

namespace imucal {

NominalFilter make_nominal_filter(const ErrorModel& nominal, double dt_s) {
  NoiseModel noise = noise_of(nominal);
  if (noise.markov.empty())
    throw usage_error("the nominal model has no Markov term with sigma > 0: DP2 and DP3 have nothing to estimate; "
                      "give a model with one, or use --type av or dp1");
  double total = 0;
  for (const Markov& m : noise.markov) total += m.sigma_dph * m.sigma_dph;
  noise.white_sigma_dph = std::max(noise.white_sigma_dph, std::sqrt(1e-9 * total * dt_s));
  NominalFilter f;
  static_cast<SteadyFilter&>(f) = steady_filter(noise, dt_s, dt_s);
  f.dt_s = dt_s;
  f.components = model_components(nominal, dt_s);
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

} // namespace imucal
