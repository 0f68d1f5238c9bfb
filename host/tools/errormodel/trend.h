// SPDX-License-Identifier: MIT
// The detrending that is taken where none was chosen.
#pragma once
#include <string>
#include <vector>

namespace imucal {

// Fills an empty *detrend: "mean", or "poly:3" where an axis of the logs follows the temperature, and says so on standard
// error.  Where the caller chose none or mean all the same, it is warned.
void choose_detrend(const std::vector<std::string>& logs, const std::vector<std::string>& axes, std::string* detrend);

} // namespace imucal
