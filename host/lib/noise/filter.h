// SPDX-License-Identifier: MIT
// Inside the noise room: the inner loops, for the widest vectors of the machine (base/simd.h).
#pragma once
#include <cstddef>

namespace imucal {

// Gains of n samples: row k * (is_settled ? 0 : 1) belongs to sample k.
struct FilterGains {
  size_t n, n_states;
  const double *phi, *gain, *inv_sqrt_s;
  bool is_settled;
};

// Filters `lanes` (1, 4 or 8) neighbouring columns in place; rows are `stride` apart.  Each value becomes its
// innovation over the innovation's standard deviation.  state: [state][lanes], read and left for the next call.
void filter_lanes(const FilterGains& gains, size_t lanes, double* rows, size_t stride, double* state);

// out[i + j * na] += sum_k a[i * lda + k] b[j * ldb + k] over n samples: products of na columns with nb columns.
void add_column_products(const double* a, size_t lda, size_t na, const double* b, size_t ldb, size_t nb, size_t n,
                         double* out);

// sum[i][j] += sum_k a[k][i] b[k][j] over n samples; a, b, sum `lanes` (4 or 8) wide and dense.
void add_products(size_t lanes, const double* a, const double* b, size_t n, double* sum);

} // namespace imucal
