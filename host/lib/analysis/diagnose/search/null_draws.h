// SPDX-License-Identifier: MIT
// The threshold of a name, from draws of the fitted noise: each is searched over all candidates and nodes of noise as the data
// are.  What a draw gains by chance, a name has to gain more.
#pragma once
#include <cstdint>
#include <string>

#include "analysis/diagnose/search/null_tail.h"
#include "analysis/diagnose/search/slow_scan.h"

namespace imucal {

// The largest gain of each draw over its own best noise.  `null`: the hypothesis without a name that is drawn from.
std::vector<double> null_gains(const SlowLikelihood& likelihood, const std::vector<const SlowNode*>& nodes,
                               const SlowModel& null, size_t draws, uint64_t seed);
// Names everything that null_gains depends on, to the last bit: what is kept under it is what would be drawn.
std::string null_key(const SlowSpace& space, size_t draws, uint64_t seed);
// The threshold that the largest gain of a draw exceeds with probability `rate`: exponential tail above the upper fifth.
NullTail null_tail(std::vector<double> gains, double rate, const SelectorConstants& constants = {});
// What jumps in time must gain together beyond step_nats each: constants.first_step_nats at 1 in 100, with which half of the rate is
// left to names.
double jump_threshold(double rate, const SelectorConstants& constants = {});

} // namespace imucal
