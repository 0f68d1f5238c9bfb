// SPDX-License-Identifier: MIT
#include "noise/states.h"

#include <cmath>

namespace imucal {

double NoiseStates::sigma(size_t i, size_t k) const {
  const double sigma = noise_.markov[i].sigma_dph;
  return i == 0 && noise_.markov_slope != 0 ? sigma * std::exp(0.5 * noise_.markov_slope * times_.tn[k]) : sigma;
}

void NoiseStates::transition(size_t k, double* phi, double* q) const {
  const double step_s = this->step_s(k);
  for (size_t i = 0; i < noise_.markov.size(); ++i) {
    double tau_s = noise_.markov[i].tau_s;
    if (i == 0 && noise_.tau_slope != 0) tau_s *= std::exp(noise_.tau_slope * times_.tn[k]);
    const double now = sigma(i, k), next = sigma(i, k + 1);
    const MarkovStep step(step_s, tau_s);
    phi[i] = step.phi() * (now > 0 ? next / now : 1.0);
    q[i] = next * next * step.q();
  }
  if (n_ > noise_.markov.size()) {
    phi[n_ - 1] = 1.0;
    q[n_ - 1] = noise_.walk_dph_per_rt_s * noise_.walk_dph_per_rt_s * step_s;
  }
}

} // namespace imucal
