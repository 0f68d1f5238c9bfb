// SPDX-License-Identifier: MIT
// Temperature ranges as options give them.
#pragma once
#include <string>

namespace imucal {

struct TemperatureRange {
  double lo_degc = 0, hi_degc = 0;
  double width() const { return hi_degc - lo_degc; }
};

// Temperatures of a log that span less show no thermal polynomial.
constexpr double kMinSpanDegc = 0.5;

// "LOW:HIGH" in degC.  usage_error names the option, what was given and, where the ends are reversed, the
// remedy.
TemperatureRange parse_range(const std::string& option, const std::string& text);

} // namespace imucal
