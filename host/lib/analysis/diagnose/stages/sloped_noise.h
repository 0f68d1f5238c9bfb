// SPDX-License-Identifier: MIT
// Slow noise that follows the temperature, fitted to the seconds.  Means over 10 s blur a process of a minute: they make its
// slope too small and hardly tell whether its size or its time constant follows.
#pragma once
#include <optional>

#include "analysis/diagnose/stages/seconds_noise.h"
#include "analysis/diagnose/stages/slow_answer.h"

namespace imucal {

// Whether the kind of slow noise of a hypothesis follows the temperature.
bool is_noise_sloped(const SlowModel& m);
// Where slow->found.best has such a kind: the likeliest kind and its slope beside the mean that leaves this residual go into it.
// White noise competes: where it does without the slow kind, that one goes.  Fills slow->sloped.  Returns the noise of the seconds
// then; nothing where there is no such kind.
std::optional<SecondsNoise> fit_sloped_noise(const AxisQuestion& question, const std::vector<Eigen::VectorXd>& residual,
                                             SlowAnswer* slow);
// The slope of that kind which is likeliest beside this noise.
Theta slope_beside(const AxisQuestion& question, const std::vector<Eigen::VectorXd>& residual, const SlowModel& m,
                   const NoiseModel& noise);

} // namespace imucal
