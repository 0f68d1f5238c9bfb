// SPDX-License-Identifier: MIT
// Noise that follows the temperature, in an engineer's words: a slope of a logarithm over a normalised temperature tells nobody
// how much louder a warm sensor is.
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/evidence/fit.h"

namespace imucal {

// How many times as large (long) at one end of the temperatures of the logs as at the other, and what its slope is per.
// Empty: the term is no noise that follows the temperature.
std::string noise_over_temperature(const Term& term, const Campaign& campaign);

// Whether such a noise is nearly as large at all of these temperatures, or as far as is known.
bool hardly_follows_temperature(const Term& term, const Campaign& campaign);

// Several processes that were estimated together, all of them; those of 1/f noise by its strength.  Empty: one at most.
std::string processes_in_words(const std::vector<Markov>& processes, const std::string& axis_unit);

} // namespace imucal
