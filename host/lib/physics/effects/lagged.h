// SPDX-License-Identifier: MIT
// A place that follows the thermometer with a time constant.
#pragma once
#include <cstddef>
#include <vector>

#include "physics/effects/estimation.h"

namespace imucal {

// The temperature of a place behind (tau_s > 0, dTg/dt = (T - Tg)/tau_s) or ahead (tau_s < 0, Tg = T - tau_s dT/dt) of
// `temp`, `offset_degc` off at the start.  Exact for a temperature that is linear between the samples (Tg follows a ramp
// at a distance tau_s dT/dt).  t_s: times of the samples, rising.
Column lagged(const std::vector<double>& t_s, const std::vector<double>& temp, double tau_s, double offset_degc);

// Of an effect that arises near the thermometer (EffectEstimator::is_near_thermometer): its lag behind the thermometer,
// which stands after the `n_own` shape parameters of its own; 0 where it is not given.
double nearby_lag_s(const Theta& shape, size_t n_own);

} // namespace imucal
