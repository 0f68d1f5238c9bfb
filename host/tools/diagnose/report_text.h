// SPDX-License-Identifier: MIT
// The answer of diagnose as text.
#pragma once
#include <string>

#include "analysis/diagnose/diagnose.h"

namespace imucal {

std::string diagnosis_text(const DiagnoseResult& result);

} // namespace imucal
