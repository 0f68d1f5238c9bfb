// SPDX-License-Identifier: MIT
// Jumps: at times, and at temperatures between the places of a grid.  Both are looked for where a step beside
// a hypothesis would gain most.
#pragma once
#include <optional>

#include "analysis/diagnose/search/slow_polish.h"

namespace imucal {

constexpr size_t kFewJumps = 5;    // more are no events but a noise that jumps
constexpr size_t kManyJumps = 13;  // more are not told one by one
constexpr size_t kFewestTeeth = 3; // jumps all one way: fewer may be chance

// Jumps in time beside a hypothesis, as the effect of steps takes them.
struct TimeJumps {
  std::vector<Theta> places;
  // More than a few: a noise, or an effect that jumps again and again.  Without places they are too many to tell one by one.
  bool are_many = false;
};

// Jumps in time beside `null` that earn their cost, one after the other (run, t_s), the noise estimated again with each; no places
// where there are more than `most`.
TimeJumps find_steps(const SlowLikelihood& of, const SlowModel& null, size_t most = kFewJumps);
// How the jumps in time of a hypothesis, one at least, follow each other.
struct JumpPattern {
  bool go_one_way = true;     // all up or all down, as the teeth of a saw
  bool are_two_levels = true; // of one height, up and down in turn in every run, as a noise of two levels
  size_t n_followed = 0;      // jumps that another one of the same run follows
};
JumpPattern pattern_of(const SlowLikelihood& of, const SlowModel& m);
// The temperature and its slope at a moment of a log, and the row [s] that the moment lies in; at its ends: none.
struct JumpMoment {
  JumpPlace place;
  double row_s = 0;
};
std::optional<JumpMoment> moment_of(const RunInput& run, double t_s);

// Whether the jumps in time of a hypothesis come again where other passages have the same temperature and direction, with the same
// height: a relay, or several, and no event.  Moments drawn at random would agree so often once in 1000 times.
struct RepeatedJumps {
  bool follow_temperature = false; // half of them at least come again
  bool are_loops = false;          // on the way down the bias does not jump back where it jumped on the way up
};
RepeatedJumps repeated_jumps(const SlowLikelihood& of, const SlowModel& m);
// `scores`: candidates added to `m`.  Those that jump are also tried at the likely places, and taken there where they alone do
// better than `in_time`, which jumps at times, or where held-out logs are to tell the two.
void try_jumps(const SlowLikelihood& of, const SlowModel& m, const SlowModel& in_time,
               std::vector<SlowCandidateScore>* scores);

} // namespace imucal
