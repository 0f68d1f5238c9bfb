// SPDX-License-Identifier: MIT
// What pictures are drawn from: where the gap lies, one-minute means, the map over averaging time and temperature.
#pragma once
#include "analysis/diagnose/diagnose.h"
#include "io/json_file.h"

namespace imucal {

Json where_json(const AxisResult& axis);
Json record_json(const AxisResult& axis); // of an axis without an answer too
Json plots_json(const AxisResult& axis);

} // namespace imucal
