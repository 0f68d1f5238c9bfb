// SPDX-License-Identifier: MIT
// What the seconds say beside the slow causes: kinds of fast noise, and noise that jumps.
#pragma once
#include "analysis/diagnose/stages/jumping.h"

namespace imucal {

struct FastAnswer {
  FastScan scan; // the best first
  JumpingAnswer jumping;
  FastFinding second; // another kind beside the best; no effect: none
  // The finding that is worth its name, or nullptr.
  const FastFinding* best(const SelectorConstants& constants) const;
};

// What all stages found of one axis.
struct Found {
  SlowAnswer slow;
  SecondsAnswer seconds;
  FastAnswer fast;
};

// A finding in a hypothesis, with the errors of its parameters.
Term term_of(const FastFinding& finding);

// Asks the seconds of found->slow and found->seconds, which change where noise that jumps is found.  A finding that is worth
// its name joins the hypothesis of the seconds.
void ask_fast(const AxisQuestion& question, Found* found);

} // namespace imucal
