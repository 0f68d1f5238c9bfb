// SPDX-License-Identifier: MIT
#include "base/range.h"

#include <cmath>
#include <cstdio>

#include "base/error.h"
#include "base/units.h"

namespace imucal {

TemperatureRange parse_range(const std::string& option, const std::string& text) {
  TemperatureRange range;
  char extra = 0;
  if (std::sscanf(text.c_str(), "%lf:%lf%c", &range.lo_degc, &range.hi_degc, &extra) != 2 ||
      !std::isfinite(range.lo_degc) || !std::isfinite(range.hi_degc))
    throw usage_error(option + " " + text + ": write two temperatures in degC as LOW:HIGH, for example 0:60");
  if (range.lo_degc > range.hi_degc)
    throw usage_error(option + " " + text + " is reversed: write " + option + " " + shown(range.hi_degc) + ":" +
                      shown(range.lo_degc));
  if (range.lo_degc == range.hi_degc)
    throw usage_error(option + " " + text + " has no width; widen it, for example " + shown(range.lo_degc) + ":" +
                      shown(range.hi_degc + 1));
  if (range.lo_degc < -273.15 || range.hi_degc > 2000)
    throw usage_error(option + " " + text + ": temperatures must lie between -273.15 and 2000 degC");
  return range;
}

} // namespace imucal
