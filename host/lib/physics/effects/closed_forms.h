// SPDX-License-Identifier: MIT
// A whole error model, its effects too, as independent noise components: what closed forms, fits and simulation share.
#pragma once
#include <vector>

#include "io/model.h"
#include "noise/components.h"

namespace imucal {

// The model's white noise and Markov terms, then one component of every effect that has a closed form; those that have one
// say so themselves (Effect::closed_form).  "angle_quantization" {q_arcsec} is a term of models only, not of the library:
// the standard deviation of the white angle error whose difference is read as rate, IEEE 952's quantisation noise;
// 1 arcsec per second is 1 deg/h.  data_error names an effect without a closed form, and a parameter that is missing or
// out of bounds.
std::vector<NoiseComponent> noise_components(const ErrorModel& model, double dt_s = 1.0);

} // namespace imucal
