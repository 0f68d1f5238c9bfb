// SPDX-License-Identifier: MIT
// What the profiles of the logs could not show or tell apart, and what to record instead.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"

namespace imucal {

// What these profiles would not show at a size that matters, less what they have just shown.
std::vector<const Detectability*> hidden_effects(const AxisResult& axis);
// The same with the sizes below which it stays unseen: "warm_up below amplitude_dph 61 (tau_s 320)".
std::string hidden_text(const AxisResult& axis);

// Pairs that look alike on these profiles and bear on the answer: of a name with what its set holds, or of what was not named
// where a gap has no name.
std::vector<Alike> open_pairs(const AxisResult& axis);

// Whether runs of the advised profile would show what these hide, or tell what these leave open.
bool advised_profile_helps(const AxisResult& axis);

std::vector<std::string> advice(const AxisResult& axis);
// What no log can show: always the last of the advice.
std::string constant_offsets();

} // namespace imucal
