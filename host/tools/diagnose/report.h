// SPDX-License-Identifier: MIT
// The answer of diagnose as JSON (host/formats.md, Diagnosis).
#pragma once
#include <string>
#include <vector>

#include "analysis/diagnose/diagnose.h"
#include "io/json_file.h"

namespace imucal {

Json diagnosis_json(const DiagnoseOptions& options, const DiagnoseResult& result);
// The axes that were not judged, in a line each: name and why.
std::vector<std::string> unanswered(const DiagnoseResult& result);

} // namespace imucal
