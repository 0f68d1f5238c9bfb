// SPDX-License-Identifier: MIT
#include "base/units.h"

#include <cmath>

namespace imucal {

double white_sigma_dph(double arw_deg_rt_h, double dt_s) {
  return 60.0 * arw_deg_rt_h / std::sqrt(dt_s);
}

} // namespace imucal
