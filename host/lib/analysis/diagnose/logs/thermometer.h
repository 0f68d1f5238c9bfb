// SPDX-License-Identifier: MIT
// Minutes in which a thermometer was stuck.
//
// A stuck thermometer gives exactly one reading far longer than is usual for it, then jumps to the temperature of that
// second, further than it moves at any time soon after.  Both are asked: a coarse thermometer in a soak rests as long but
// goes on by one step, and a chamber that changes fast leaves a soak as suddenly but goes on as fast.
#pragma once
#include <cstddef>
#include <vector>

namespace imucal {

// Rows [first, end) have the same reading; the row `end` has the one after the jump.
struct Hold {
  size_t first = 0, end = 0;
};

// In increasing order.  One number per row; t_s increases, mostly by dt_s; temp_degc is NaN where missing, which ends a hold.
// A hold that ends in missing rows is not told from a soak.  None where holds would be more than half of the log.
std::vector<Hold> stuck_thermometer(const std::vector<double>& t_s, double dt_s, const std::vector<double>& temp_degc);

} // namespace imucal
