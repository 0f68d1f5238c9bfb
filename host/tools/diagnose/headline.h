// SPDX-License-Identifier: MIT
// The answer of an axis in a sentence, in a few words, and the notes beside it.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"

namespace imucal {

// The answer in a sentence.  Silence of a profile is no answer on what it cannot show.
std::string headline(const AxisResult& axis);
// The verdict in a few words, never more than the headline says.
std::string title(const AxisResult& axis);
std::vector<std::string> notes(const AxisResult& axis);
std::string why_refused(const AxisResult& axis);
// Other parameters of the believed noise, and notes, are beside the cause, if there is one.
bool has_weak_causes_only(const AxisResult& axis);

} // namespace imucal
