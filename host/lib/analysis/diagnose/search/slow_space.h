// SPDX-License-Identifier: MIT
// What the slow search looks through on one campaign: data, what is believed of the noise, and all that may be named.
#pragma once
#include <cmath>
#include <memory>
#include <vector>

#include "analysis/diagnose/evidence/constants.h"
#include "analysis/diagnose/search/slow_model.h"

namespace imucal {

// Standard deviations of the weak prior of log(white), log(slow density), log(tau).
struct NoisePrior {
  double centre[3] = {0, 0, 0}, sd[3] = {1.5, 3, 2};
  double at(const double* x) const {
    double sum = 0;
    for (int i = 0; i < 3; ++i) sum -= 0.5 * std::pow((x[i] - centre[i]) / sd[i], 2);
    return sum;
  }
};

struct SlowSpace {
  const SlowData& data;
  NoiseBelief belief;
  SelectorConstants constants;
  const Campaign* held_out; // its temperatures alone; nullptr: none
  NoiseModel base = {};     // what the factors of a hypothesis act on
  NoisePrior prior = {};
  double longest_tau_s = 1e4; // that is asked for: three times the longest log
  double longest_log_s() const { return longest_tau_s / 3; }
  std::vector<Candidate> candidates = {};        // the free function, where there is one, is the last
  std::vector<const Effect*> noise_effects = {}; // kinds of slow noise that block means can show
  const EffectEstimator* steps = nullptr;        // of jumps in time, where they may be named
  std::unique_ptr<ScanBank> bank = {};           // columns of all candidates but the free function

  // Whether the shape of an effect comes back in the fitted logs, or in these and the held-out ones together: a jump at a
  // temperature that is passed once is none.
  bool is_repeated(const EffectEstimator& estimator, const Theta& shape, bool with_held_out) const;
  // Whether the steps of a coarse thermometer do the same as an effect at this shape.
  bool is_of_steps(const EffectEstimator& estimator, const Theta& shape) const;
};
// `data` and `held_out` (nullptr: none) must outlive it.  `active`: effects of the library that may be named.
SlowSpace make_slow_space(const SlowData& data, const NoiseBelief& belief, const std::vector<const Effect*>& library,
                          const std::vector<bool>& active, const SelectorConstants& constants,
                          const Campaign* held_out);

} // namespace imucal
