// SPDX-License-Identifier: MIT
#include "physics/effects/lagged.h"

#include <cmath>

namespace imucal {
namespace {

// `temp` and `lead_s` seconds of its slope.
Column ahead(const std::vector<double>& t_s, const std::vector<double>& temp, double lead_s) {
  Column out = temp;
  const size_t n = temp.size();
  for (size_t i = 0; i < n && n > 1; ++i) {
    const size_t before = i ? i - 1 : 0, after = i + 1 < n ? i + 1 : i;
    out[i] += lead_s * (temp[after] - temp[before]) / (t_s[after] - t_s[before]);
  }
  return out;
}

} // namespace

Column lagged(const std::vector<double>& t_s, const std::vector<double>& temp, double tau_s, double offset_degc) {
  if (tau_s <= 0) return ahead(t_s, temp, -tau_s);
  Column out = temp;
  if (!out.empty()) out[0] += offset_degc;
  double last_dt = -1, a = 0;
  for (size_t i = 1; i < temp.size(); ++i) {
    const double dt = t_s[i] - t_s[i - 1];
    if (dt != last_dt) a = std::exp(-dt / tau_s), last_dt = dt;
    const double distance = tau_s * (temp[i] - temp[i - 1]) / dt;
    out[i] = a * (out[i - 1] - temp[i - 1] + distance) + temp[i] - distance;
  }
  return out;
}

double nearby_lag_s(const Theta& shape, size_t n_own) {
  return shape.size() > n_own ? shape[n_own] : 0;
}

} // namespace imucal
