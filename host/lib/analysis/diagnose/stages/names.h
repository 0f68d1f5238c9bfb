// SPDX-License-Identifier: MIT
// What is said of one axis while it is decided: effects, and what is left where nothing can be said.  slow_names.h,
// undecided.h and fast_names.h fill it in this order; rest_names.h takes back what the tests of what is left speak against.
#pragma once
#include <algorithm>

#include "analysis/diagnose/stages/selected.h"

namespace imucal {

constexpr size_t kFewNames = 2;  // what the library is made for; more names have to be worth more
constexpr size_t kMostJumps = 2; // more are a noise that jumps, not events

struct Names {
  std::vector<SelectedEffect> effects;       // the strongest first
  std::vector<SelectedEffect> retuned;       // other parameters of the believed noise: after all others
  std::vector<SelectedEffect> dropped;       // names that held-out data do not support
  std::vector<CandidateEvidence> remainders; // what gains beside the names, or in their place, and is no name

  // Slow noise whose kind is open, or none.
  SelectedEffect* open_slow_noise() {
    const auto is_it = [](const SelectedEffect& e) { return e.is_family && e.family == Family::kSlowNoise; };
    const auto found = std::find_if(effects.begin(), effects.end(), is_it);
    return found == effects.end() ? nullptr : &*found;
  }
  // Not named: a remainder.
  void reject(const SelectedEffect& effect) { remainders.push_back(effect.set.front()); }
  // The same of every effect of a list (one of these) for which goes(effect).
  template <class F> void reject_those(F goes, std::vector<SelectedEffect>* list) {
    const auto kept = [&](const SelectedEffect& effect) { return !goes(effect); };
    const auto gone = std::stable_partition(list->begin(), list->end(), kept);
    for (auto effect = gone; effect != list->end(); ++effect) reject(*effect);
    list->erase(gone, list->end());
  }
};

} // namespace imucal
