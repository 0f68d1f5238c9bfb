// SPDX-License-Identifier: MIT
// Grids of prediction times.
#pragma once
#include <string>
#include <vector>

namespace imucal {

// "2:600" or "2:600:2" (linear, step in seconds, 1 by default), "log:2:600" or "log:2:600:20" (points per decade, 20
// by default), "octave" or "octave:FIRST:LAST" (n = 1, 2, 4 … samples), or a list "2,5,10".  Returns whole samples, each
// once, in rising order.  `longest_s` ends an octave grid without LAST, and the default grid ("": log from one
// sample on, 20 per decade).  usage_error names what is wrong.
std::vector<double> parse_tau(const std::string& text, double dt_s, double longest_s);

// Any numbers so: whole samples, each once, in rising order.  usage_error, which begins with `what`, for a number that is not
// positive or less than half a sample.
std::vector<double> whole_taus(std::vector<double> tau_s, double dt_s, const std::string& what);

} // namespace imucal
