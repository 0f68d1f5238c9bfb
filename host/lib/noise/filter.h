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

// Filters `lanes` (1, 4, 8, 12 or 16) neighbouring columns in place; rows are `stride` apart.  Each value becomes its
// innovation over the innovation's standard deviation.  state: [state][lanes], read and left for the next call.
void filter_lanes(const FilterGains& gains, size_t lanes, double* rows, size_t stride, double* state);

// Between columns and rows: `lanes` (4 or 8) columns side by side; rows are `stride` apart.
void columns_to_rows(size_t lanes, const double* const* columns, size_t n, double* rows, size_t stride);
void rows_to_columns(size_t lanes, const double* rows, size_t stride, size_t n, double* const* columns);

// out[i + j * na] += sum_k a[i * lda + k] b[j * ldb + k] over n samples: products of na columns with nb columns.
void add_column_products(const double* a, size_t lda, size_t na, const double* b, size_t ldb, size_t nb, size_t n,
                         double* out);

// The same of na columns with themselves.
void add_column_gram(const double* a, size_t lda, size_t na, size_t n, double* out);

// sum[i][j] += sum_k x[k][i] x[k][j] for j >= i (and some others); x: n rows of `width` columns, a multiple of 4.
void add_gram(const double* x, size_t width, size_t n, double* sum);

} // namespace imucal
