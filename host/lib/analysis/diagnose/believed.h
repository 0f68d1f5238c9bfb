// SPDX-License-Identifier: MIT
// What a model that is believed says of one axis: which of its effects are of it, and its noise with those that are noise.
#pragma once
#include <string>

#include "noise/noise_model.h"
#include "physics/effects/estimation.h"

namespace imucal {

bool is_for(const EffectSpec& spec, const std::string& axis);

// Parameters in the order of the library, which is that of theta; the angle random walk as white noise of 1-s means.
Theta theta_of(const Effect& effect, const Parameters& parameters);

// The noise with the effects that the model itself already holds.
NoiseModel known_noise(const ErrorModel& model, const std::string& axis, NoiseModel noise);

// Whether all that an effect of a model does is other white noise, or other or more Markov processes: where the noise is
// estimated again, these are estimated as one with those of the model itself.
bool is_part_of_base_noise(const EffectSpec& spec);

} // namespace imucal
