// SPDX-License-Identifier: MIT
// The steps that rates were rounded to.  Logs of one device may have been exported with different numbers of digits: each log is
// asked for its own step.
#pragma once
#include <cstddef>
#include <vector>

#include "physics/effects/estimation.h"

namespace imucal {

struct Lattice {
  double step_dph = 0;
  std::vector<size_t> runs; // that lie on it, increasing
};

// The lattices of these logs, however fine; a log that is on none is in none.  What a log is too short to show is told by those
// whose lattice it lies on, or by all logs together.
std::vector<Lattice> lattices(const std::vector<RunInput>& runs);

} // namespace imucal
