// SPDX-License-Identifier: MIT
// Free shapes of the mean that no effect owns: what a family of causes could explain at best.  They compete with the
// named members by the same marginal likelihood; their many columns pay for themselves through their priors.
#pragma once
#include "analysis/diagnose/evidence/scan.h"

namespace imucal {

struct Reference {
  Family family;
  const char* what; // in words
  ScanCandidate candidate;
  bool has_members = true; // false: no effect of the library is of this kind, the family says little
};

// Free functions of temperature, of temperature with the direction of its change, of earlier temperature rates, of the
// time since the start, and of temperature and time together: all of them, also those that a campaign cannot hold.
const std::vector<Reference>& free_shapes();

// The shape of an effect that its parameters do not tell (EffectEstimator::of_any_shape), or nullptr.
const Reference* any_shape_of(const Effect& effect);

// A free function of temperature, its past and (with several runs) the time since the start: cosines of each of them and
// products of two.  What is smooth and repeats is near one of these, whatever made it.  It owns nothing and names nothing;
// it stands against answers.
const Reference& free_function(bool with_time);
// Over which delay the past counts, how the past is scaled on this campaign, and the longest time.
std::vector<Theta> free_function_shapes(const Campaign& campaign, double longest_s);

} // namespace imucal
