// SPDX-License-Identifier: MIT
// Slow noise that follows the temperature, fitted to the seconds.  Means over 10 s blur a process of a minute: they make its slope
// too small and hardly tell whether its size or its time constant follows.
#pragma once
#include "analysis/diagnose/stages/seconds_answer.h"

namespace imucal {

// Whether the kind of slow noise of a hypothesis follows the temperature.
bool is_noise_sloped(const SlowModel& m);
// The likeliest kind of noise that follows the temperature and its slope, where slow->found.best has such a kind: beside the mean of
// `seconds`, whose noise becomes that one.  Fills slow->sloped.
void fit_sloped_noise(const AxisQuestion& question, SlowAnswer* slow, SecondsAnswer* seconds);
// The slope that is likeliest beside the believed noise.
Theta slope_beside_believed(const AxisQuestion& question, const SlowAnswer& slow, const SecondsAnswer& seconds);

} // namespace imucal
