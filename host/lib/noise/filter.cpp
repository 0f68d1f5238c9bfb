// SPDX-License-Identifier: MIT
#include "noise/filter.h"

#include "base/simd.h"
#include "noise/gains.h"

namespace imucal {
namespace {

// B vectors of columns; M: number of states where the compiler may know it, else 0.
template <class V, size_t B, size_t M>
IMUCAL_WIDE_PART void run(const FilterGains& g, double* rows, size_t stride, double* state) {
  constexpr size_t width = sizeof(V) / sizeof(double);
  const size_t n_states = M ? M : g.n_states, next = g.is_settled ? 0 : 1;
  V m[(M ? M : kMostStates) * B];
  for (size_t i = 0; i < n_states * B; ++i) load_lanes(&m[i], state + i * width);
  const double *phi = g.phi, *gain = g.gain, *w = g.inv_sqrt_s;
  for (size_t k = 0; k < g.n; ++k) {
    for (size_t b = 0; b < B; ++b) {
      double* at = rows + k * stride + b * width;
      V nu;
      load_lanes(&nu, at);
      for (size_t i = 0; i < n_states; ++i) nu -= m[i * B + b];
      store_lanes(V(nu * *w), at);
      for (size_t i = 0; i < n_states; ++i) m[i * B + b] = phi[i] * (m[i * B + b] + gain[i] * nu);
    }
    phi += next * n_states, gain += next * n_states, w += next;
  }
  for (size_t i = 0; i < n_states * B; ++i) store_lanes(m[i], state + i * width);
}

template <class V, size_t B>
IMUCAL_WIDE_PART void run_states(const FilterGains& g, double* rows, size_t stride, double* state) {
  switch (g.n_states) {
  case 1:
    return run<V, B, 1>(g, rows, stride, state);
  case 2:
    return run<V, B, 2>(g, rows, stride, state);
  case 3:
    return run<V, B, 3>(g, rows, stride, state);
  default:
    return run<V, B, 0>(g, rows, stride, state);
  }
}

IMUCAL_WIDE void run_16(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<Lanes8, 2>(g, rows, stride, state);
}
IMUCAL_WIDE void run_12(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<Lanes, 3>(g, rows, stride, state);
}
IMUCAL_WIDE void run_8(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<Lanes8, 1>(g, rows, stride, state);
}
IMUCAL_WIDE void run_4(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<Lanes, 1>(g, rows, stride, state);
}

template <size_t N> IMUCAL_WIDE_PART void to_rows(const double* const* columns, size_t n, double* rows, size_t stride) {
  const double* from[N];
  for (size_t c = 0; c < N; ++c) from[c] = columns[c];
  for (size_t k = 0; k < n; ++k)
    for (size_t c = 0; c < N; ++c) rows[k * stride + c] = from[c][k];
}
template <size_t N>
IMUCAL_WIDE_PART void to_columns(const double* rows, size_t stride, size_t n, double* const* columns) {
  double* to[N];
  for (size_t c = 0; c < N; ++c) to[c] = columns[c];
  for (size_t k = 0; k < n; ++k)
    for (size_t c = 0; c < N; ++c) to[c][k] = rows[k * stride + c];
}
IMUCAL_WIDE void to_rows_8(const double* const* columns, size_t n, double* rows, size_t stride) {
  to_rows<8>(columns, n, rows, stride);
}
IMUCAL_WIDE void to_rows_4(const double* const* columns, size_t n, double* rows, size_t stride) {
  to_rows<4>(columns, n, rows, stride);
}
IMUCAL_WIDE void to_columns_8(const double* rows, size_t stride, size_t n, double* const* columns) {
  to_columns<8>(rows, stride, n, columns);
}
IMUCAL_WIDE void to_columns_4(const double* rows, size_t stride, size_t n, double* const* columns) {
  to_columns<4>(rows, stride, n, columns);
}

// Four rows of the sum by one vector of its columns: they stay in registers.
template <class V>
IMUCAL_WIDE_PART void gram_block(const double* left, const double* right, size_t width, size_t n, double* sum) {
  V s[4], r;
  for (size_t l = 0; l < 4; ++l) load_lanes(&s[l], sum + l * width);
  for (size_t k = 0; k < n; ++k) {
    load_lanes(&r, right + k * width);
    for (size_t l = 0; l < 4; ++l) s[l] += left[k * width + l] * r;
  }
  for (size_t l = 0; l < 4; ++l) store_lanes(s[l], sum + l * width);
}

IMUCAL_WIDE void gram(const double* x, size_t width, size_t n, double* sum) {
  for (size_t i = 0; i < width; i += 4)
    for (size_t j = i; j < width; j += width - j < 8 ? 4 : 8)
      if (width - j < 8)
        gram_block<Lanes>(x + i, x + j, width, n, sum + i * width + j);
      else
        gram_block<Lanes8>(x + i, x + j, width, n, sum + i * width + j);
}

// A by B columns against each other: eight samples side by side, the sums stay in registers.
template <size_t A, size_t B>
IMUCAL_WIDE_PART void column_block(const double* a, size_t lda, const double* b, size_t ldb, size_t n, double* out,
                                   size_t ldo) {
  Lanes8 s[A][B] = {};
  size_t k = 0;
  for (; k + 8 <= n; k += 8) {
    Lanes8 left[A], right;
    for (size_t i = 0; i < A; ++i) load_lanes(&left[i], a + i * lda + k);
    for (size_t j = 0; j < B; ++j) {
      load_lanes(&right, b + j * ldb + k);
      for (size_t i = 0; i < A; ++i) s[i][j] += left[i] * right;
    }
  }
  for (size_t i = 0; i < A; ++i)
    for (size_t j = 0; j < B; ++j) {
      double sum = 0;
      for (size_t l = 0; l < 8; ++l) sum += s[i][j][l];
      for (size_t rest = k; rest < n; ++rest) sum += a[i * lda + rest] * b[j * ldb + rest];
      out[i + j * ldo] += sum;
    }
}

IMUCAL_WIDE void column_products(const double* a, size_t lda, size_t na, const double* b, size_t ldb, size_t nb,
                                 size_t n, double* out) {
  for (size_t i = 0; i < na; i += na - i < 4 ? 1 : 4)
    for (size_t j = 0; j < nb; j += nb - j < 2 ? 1 : 2) {
      const double *left = a + i * lda, *right = b + j * ldb;
      double* to = out + i + j * na;
      if (na - i >= 4 && nb - j >= 2)
        column_block<4, 2>(left, lda, right, ldb, n, to, na);
      else if (na - i >= 4)
        column_block<4, 1>(left, lda, right, ldb, n, to, na);
      else if (nb - j >= 2)
        column_block<1, 2>(left, lda, right, ldb, n, to, na);
      else
        column_block<1, 1>(left, lda, right, ldb, n, to, na);
    }
}

} // namespace

void filter_lanes(const FilterGains& gains, size_t lanes, double* rows, size_t stride, double* state) {
  if (lanes == 16) return run_16(gains, rows, stride, state);
  if (lanes == 12) return run_12(gains, rows, stride, state);
  if (lanes == 8) return run_8(gains, rows, stride, state);
  if (lanes == 4) return run_4(gains, rows, stride, state);
  run_states<double, 1>(gains, rows, stride, state);
}

void columns_to_rows(size_t lanes, const double* const* columns, size_t n, double* rows, size_t stride) {
  (lanes == 8 ? to_rows_8 : to_rows_4)(columns, n, rows, stride);
}

void rows_to_columns(size_t lanes, const double* rows, size_t stride, size_t n, double* const* columns) {
  (lanes == 8 ? to_columns_8 : to_columns_4)(rows, stride, n, columns);
}

void add_column_products(const double* a, size_t lda, size_t na, const double* b, size_t ldb, size_t nb, size_t n,
                         double* out) {
  constexpr size_t kChunk = 512; // samples of all columns of b that stay in the second cache
  for (size_t k = 0; k < n; k += kChunk)
    column_products(a + k, lda, na, b + k, ldb, nb, n - k < kChunk ? n - k : kChunk, out);
}

void add_gram(const double* x, size_t width, size_t n, double* sum) {
  gram(x, width, n, sum);
}

} // namespace imucal
