// SPDX-License-Identifier: MIT
// Scalar product of two columns of n doubles.  The order of the additions is the same on every machine.
#pragma once
#include <cstddef>

namespace imucal {

double scalar_product(const double* a, const double* b, size_t n);

} // namespace imucal
