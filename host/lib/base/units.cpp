// SPDX-License-Identifier: MIT
#include "base/units.h"

#include <cmath>
#include <cstdio>

namespace imucal {

double white_sigma_dph(double arw_deg_rt_h, double dt_s) {
  return 60.0 * arw_deg_rt_h / std::sqrt(dt_s);
}

std::string shown(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

} // namespace imucal
