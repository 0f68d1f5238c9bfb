// SPDX-License-Identifier: MIT
// What the profiles of the logs could not show or tell apart, and what to record instead.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"

namespace imucal {

// What these profiles would not show at a size that matters, less what they have just shown.
std::vector<const Detectability*> hidden_effects(const AxisResult& axis);
// The same with the sizes below which it stays unseen: "a warm up smaller than 61 dph (time constant 320 s)".
std::string hidden_text(const AxisResult& axis);

// Pairs that look alike on these profiles and bear on the answer: of a name with what its set holds, or of what was not named
// where a gap has no name.
std::vector<Alike> open_pairs(const AxisResult& axis);

// Whether runs of the advised profile would show what these hide, or tell what these leave open.
bool advised_profile_helps(const AxisResult& axis);

// What to do next: hardware to look at (by what was named; on the page beside its sources), then logs to record.
std::vector<std::string> hardware_to_look_at(const AxisResult& axis);
std::vector<std::string> steps(const AxisResult& axis);
// What these logs cannot show or tell apart.
std::vector<std::string> limits(const AxisResult& axis);
// Steps, then limits.
std::vector<std::string> advice(const AxisResult& axis);
// What no log can show: always the last of the advice.
std::string constant_offsets();

} // namespace imucal
