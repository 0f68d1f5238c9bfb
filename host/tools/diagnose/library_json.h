// SPDX-License-Identifier: MIT
// The library of effects as JSON: names, words, families, parameters, properties.
#pragma once
#include "io/json_file.h"

namespace imucal {

Json library_json();

} // namespace imucal
