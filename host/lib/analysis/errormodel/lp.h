// SPDX-License-Identifier: MIT
// The bounding program: minimise cost' x subject to A x >= 1, x >= 0, with A >= 0 (rows: tau, columns: components).
#pragma once
#include <cstddef>
#include <vector>

namespace imucal {

struct BoundingProgram {
  std::vector<std::vector<double>> columns; // [component][tau], >= 0
  // Cost of a component: sum of its column, i.e. the objective is the sum over tau of A x.
};
struct BoundingSolution {
  std::vector<double> x;
  double objective = 0; // sum over tau of (A x - 1); infinite when no component reaches some tau
};

// By Clp's simplex.  It begins with few rows and adds those that are violated, until every row holds to 1e-9.  The
// result is then scaled up by what is still missing, so that every row holds exactly.
BoundingSolution solve_bounding(const BoundingProgram& program);

// The same for a few columns (at most 6), by walking the vertices directly: microseconds, for searches.
BoundingSolution solve_bounding_small(const std::vector<const double*>& columns, size_t n_rows);

} // namespace imucal
