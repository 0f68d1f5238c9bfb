// SPDX-License-Identifier: MIT
// What `calibrate fit` and `calibrate run` write with --json (host/formats.md).
#pragma once
#include <vector>

#include "analysis/fit/fit.h"
#include "analysis/fit/judge.h"
#include "io/json_file.h"

namespace imucal {

// {"axes": [{axis, order, t0_degc, range_degc, coeff_dph, sigma_dph, temp_degc, residual_rms_dph, ...}], "judgement": ...}
Json to_json(const FitResult& result);

// What the model says of the constant that b0 holds beside the bias and sigma_dph does not count, in the unit of the axis;
// 0: nothing, or no model.
double turn_on_sigma(const FitResult& result, const FitAxis& axis);
// The same in words.
std::string turn_on_words(double sigma, const std::string& unit);

// {"accepted": bool, "reasons": [{axis, rule, value, limit, text, accepted}]}
Json judgement_json(const std::vector<FitReason>& reasons);

} // namespace imucal
