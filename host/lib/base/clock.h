// SPDX-License-Identifier: MIT
// The clock that measures how long something takes.
#pragma once

namespace imucal {

// Seconds since some fixed moment; never set back, not the time of day.
double now_s();

} // namespace imucal
