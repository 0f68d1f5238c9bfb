// SPDX-License-Identifier: MIT
// What an axis measures, by its name (host/formats.md, Log).
#pragma once
#include <string>

namespace imucal {

// The unit that figures of an axis have inside the programs: "mg" where its name ends in _mg or _ms2, else "dph".
const char* axis_unit(const std::string& axis);
bool is_accelerometer(const std::string& axis);

// Its name without the unit: gx of gx_dph.  A name without `_` is its own stem.
std::string axis_stem(const std::string& axis);

// The name of a field or parameter for people, in a unit: "sigma_dph" is "sigma_mg" of an accelerometer.
std::string name_in_unit(const std::string& name, const std::string& unit);

} // namespace imucal
