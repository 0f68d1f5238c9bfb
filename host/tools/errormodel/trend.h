// SPDX-License-Identifier: MIT
// The series to work on, and the detrending that is taken where none was chosen.
#pragma once
#include <string>
#include <vector>

#include "analysis/dp/series.h"

namespace imucal {

// The series of a log's axes; of those not asked for by name the gyros only, where there are any: one model has one unit.
std::vector<Series> load_one_kind(const std::string& log, const std::vector<std::string>& axes, bool with_temp);

// Fills an empty *detrend: "mean", or "poly:3" where an axis of the logs follows the temperature, and says so on standard
// error.  Where the caller chose none or mean all the same, it is warned.
void choose_detrend(const std::vector<std::string>& logs, const std::vector<std::string>& axes, std::string* detrend);

} // namespace imucal
