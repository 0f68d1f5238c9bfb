// SPDX-License-Identifier: MIT
// Where the gap of an answered axis lies: by whose noise it is measured, and what of the answer has a place.
#pragma once
#include "analysis/diagnose/result.h"

namespace imucal {

// `axis.nominal_fit` and `axis.final_fit` are there.
WhereResult where_told(const AxisResult& axis);

} // namespace imucal
