// SPDX-License-Identifier: MIT
// What the program `profile` does, apart from parsing its options: inputs, JSON results (host/README.md), text.
#pragma once
#include <string>
#include <vector>

#include "analysis/profile/bound.h"
#include "analysis/profile/covariance.h"
#include "analysis/profile/signature.h"
#include "base/range.h"
#include "io/json_file.h"
#include "io/model.h"

namespace imucal {

// A profile (JSON) or a recorded log (CSV), told apart by their first character.
struct ProfileInput {
  std::string path;
  std::vector<CalibrationRun> runs;
  double lo_degc = 0, hi_degc = 0;  // extremes reached
  double max_rate_degc_per_min = 0; // of a profile's ramps; 0 for a log
};
ProfileInput read_profile_input(const std::string& path, bool restart_each_cycle);

Json to_json(const CalibrationError& error);
Json to_json(const Bound& bound);
Json to_json(const SignatureTable& table);

// Correlations of the signatures and the size from which each effect can be named.
std::string signature_text(const SignatureTable& table, const std::string& unit = "dph");

// Table of error over temperature at `points` temperatures.
std::string error_text(const CalibrationError& error, bool with_believed, const std::string& unit, int lines = 13);

} // namespace imucal
