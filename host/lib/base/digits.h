// SPDX-License-Identifier: MIT
// Numbers for people: no more digits than are known, and no powers of ten where digits do.
#pragma once
#include <string>

namespace imucal {

// So many digits that count: 76608.4 in two is "77000", 0.00144 is "0.0014".
std::string in_digits(double value, int digits);
// "731 +- 210" in two digits of the error, the value to the same place: "730 +- 210".  An error that is not finite, or 0: the
// value alone in four digits.
std::string with_error(double value, double error);
// The value of these alone.
std::string as_known(double value, double error);
// Evidence: whole numbers from 10 on.
std::string nats_text(double nats);

} // namespace imucal
