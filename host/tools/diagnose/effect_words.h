// SPDX-License-Identifier: MIT
// One effect of an answer in words: what was seen, how sure it is, what else it may be.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"

namespace imucal {

// Slow noise that a repeatable cause equals has no evidence of its own: neither gains over the other.
bool has_evidence(const SelectedEffect& e);
bool is_weak(const SelectedEffect& e); // its evidence is little
bool is_noise(const SelectedEffect& e);
bool is_slow_noise(const SelectedEffect& e);
bool is_note(const AxisResult& axis, const SelectedEffect& e); // beside the answer
// What axes share was measured; its parameters are those of a simulation.
bool is_shared_noise(const SelectedEffect& e);

// Places of the effects as people read them: what adds most first, other parameters of the believed noise, notes.
std::vector<size_t> reading_order(const AxisResult& axis);
// Its values; none where it has none of its own.
Parameters values_of(const AxisResult& axis, const SelectedEffect& e);

// What was seen, or why the name is not more than it is; empty: nothing beside the name.
std::string statement_of(const SelectedEffect& e);
// What the numbers mean, where they alone do not say it.
std::string in_words(const AxisResult& axis, const SelectedEffect& e);
// What to look for in the hardware, by what was found; none where that does not point anywhere.
std::vector<HardwareCause> hardware_causes_of(const AxisResult& axis, const SelectedEffect& e);
// How sure a name is and what else it may be, a line each: the same in text, JSON and on the page.
std::vector<std::string> remarks_on(const AxisResult& axis, const SelectedEffect& e);

// In the axis' unit: a tenth of a dph, or three digits of a few mg.
std::string figure(double value, const AxisResult& axis);

} // namespace imucal
