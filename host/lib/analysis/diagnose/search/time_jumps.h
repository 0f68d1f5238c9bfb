// SPDX-License-Identifier: MIT
// Jumps: at times, and at temperatures between the places of a grid.  Both are looked for where the innovations of a
// hypothesis are largest.
#pragma once
#include "analysis/diagnose/search/slow_polish.h"

namespace imucal {

// Jumps in time beside a hypothesis, as the effect of steps takes them.
struct TimeJumps {
  std::vector<Theta> places;
  bool are_many = false; // more than a few: a noise, or an effect that jumps again and again; no places then
};

// Jumps in time beside `null` that earn their cost, one after the other (run, t_s); more than a few are a noise: none then.
TimeJumps find_steps(const SlowLikelihood& of, const SlowModel& null);
// `scores`: candidates added to `m`.  Those that jump are also tried at the likely places, and taken there where they alone do
// better than `in_time`, which jumps at times, or where held-out logs are to tell the two.
void try_jumps(const SlowLikelihood& of, const SlowModel& m, const SlowModel& in_time,
               std::vector<SlowCandidateScore>* scores);

} // namespace imucal
