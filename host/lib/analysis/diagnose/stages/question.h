// SPDX-License-Identifier: MIT
// What is asked of one axis.  Every stage reads it; prepare_slow alone writes the scale of priors into its campaign.
#pragma once
#include <functional>
#include <vector>

#include "analysis/diagnose/search/search.h"

namespace imucal {

// A line of the spectrum that stands in the mean.
struct NamedLine {
  const Effect* effect;
  Theta shape;
  double gain_nats, threshold_nats;
};

struct AxisQuestion {
  const Campaign& campaign; // the fitted logs, second by second; what structure has spoilt is masked
  const Campaign* held_out; // further logs, the same, or nullptr
  const std::vector<const Effect*>& library;
  const std::vector<bool>& active; // effects of the library that may be named
  NoiseBelief belief;              // with the lines in the mean among what is known
  SelectorConstants constants;
  bool is_censored = false;          // large values are missing: the spread of what is left is not that of the noise
  std::vector<NamedLine> lines = {}; // in the mean already
  // The threshold of a name by draws of this noise without a name; empty: the constants hold the only one.
  std::function<double(const SlowSearch&, const SlowModel&)> threshold_under = {};

  // The first effect that may be named and whose estimator is of a kind, or nullptr.
  template <class F> const Effect* first_kind(F is_it) const {
    for (size_t j = 0; j < library.size(); ++j)
      if (const EffectEstimator* e = library[j]->estimator(); e && active[j] && is_it(*e)) return library[j];
    return nullptr;
  }
  // Noise that jumps between levels.
  const Effect* jumping_kind() const {
    return first_kind([](const EffectEstimator& e) { return e.is_jumping(); });
  }
};

} // namespace imucal
