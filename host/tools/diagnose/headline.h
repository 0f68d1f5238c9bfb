// SPDX-License-Identifier: MIT
// The answer of an axis in a sentence, in a few words, and the notes beside it.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"

namespace imucal {

// The answer in a sentence.
std::string headline(const AxisResult& axis);
// The same, and with no gap what the profiles could not have shown.
std::string statement(const AxisResult& axis);
// No temperatures, or steady ones: no thermal cause was looked for.
bool is_of_noise_alone(const AxisResult& axis);
// The verdict in a few words, never more than the headline says.
std::string title(const AxisResult& axis);
std::vector<std::string> notes(const AxisResult& axis);
std::string why_refused(const AxisResult& axis);
// Other parameters of the believed noise, and notes, are beside the cause, if there is one.
bool has_weak_causes_only(const AxisResult& axis);

} // namespace imucal
