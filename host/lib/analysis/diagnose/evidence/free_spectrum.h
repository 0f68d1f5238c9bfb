// SPDX-License-Identifier: MIT
// A spectrum of slow noise that no effect owns: a power law of any exponent between white noise and a random walk.  It names
// nothing; a kind of slow noise is told only where it does better than this.
#pragma once
#include "physics/effects/effect.h"

namespace imucal {

// Density about b^2 / (pi f) (f tau)^(1 - exponent), tau in the middle of the time constants that logs show; parameters {b,
// exponent}.  Exponent 1: flicker noise; 2: a random walk.
const Effect& free_spectrum();

} // namespace imucal
