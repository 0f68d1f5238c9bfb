// SPDX-License-Identifier: MIT
// Parts that several documents of JSON hold.
#pragma once
#include <vector>

#include "analysis/diagnose/diagnose.h"
#include "io/json_file.h"

namespace imucal {

// null where it is not finite.
Json number(double x);
Json short_number(double x); // seven digits: enough for the eye
Json numbers(const std::vector<double>& x);
Json evidence_json(const CandidateEvidence& c);
Json causes_json(const std::vector<HardwareCause>& causes);

} // namespace imucal
