// SPDX-License-Identifier: MIT
// The state in which an effect with a memory begins a run: what the device lived through before is not in the
// log.
#pragma once
#include <string>

#include "physics/effects/effect.h"

namespace imucal {

// The optional parameter "start" of an effect with a memory.
EffectParameter start_parameter();

// How this run begins: the effect's own parameter, else the run's.  Without random numbers (`rng` null) a
// random start is the cold one, so that noise-free runs repeat.
StartState start_of(const Parameters& parameters, const SimRun& run, const Rng* rng);

// Random numbers of the history before the run: the same for all axes of one run, others in every run.
Rng history_of(const Effect& effect, const SimRun& run);

// "random", "cold", "settled"; usage_error for another word.
StartState start_state_from(const std::string& word);

} // namespace imucal
