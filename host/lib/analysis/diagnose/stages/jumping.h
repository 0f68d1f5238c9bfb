// SPDX-License-Identifier: MIT
// The search for noise that jumps between levels.  Block means know no such noise: other noise parameters, other kinds of
// noise, jumps in time and causes in the mean stand in for it there.  Where the seconds change suddenly it is asked for
// without them; the levels that the logs show are taken out, and the slow stage is asked again.
#pragma once
#include "analysis/diagnose/stages/seconds_answer.h"

namespace imucal {

struct JumpingAnswer {
  bool has_teeth = false; // sudden changes go one way: no noise that jumps
  double gain_nats = 0;   // over the best answer without such noise; 0: none is taken
};

// Where noise that jumps is likelier than what stands, it is put first in `fast`, and `slow` and `seconds` become the
// answers beside it; otherwise nothing is changed.
JumpingAnswer ask_jumping_noise(const AxisQuestion& question, SlowAnswer* slow, SecondsAnswer* seconds, FastScan* fast);

} // namespace imucal
