// SPDX-License-Identifier: MIT
// "Did you mean …": the known name nearest to one that is not known.
#pragma once
#include <string>
#include <vector>

namespace imucal {

// The known name with the fewest edits (insert, delete, replace, swap of neighbours; upper and lower case are one), empty
// where none is near: more than a third of the letters, at least one edit allowed.  A name's beginning is near it.
std::string nearest_name(const std::string& name, const std::vector<std::string>& known);

// "; did you mean \"markov\"?" or "".
std::string did_you_mean(const std::string& name, const std::vector<std::string>& known);

} // namespace imucal
