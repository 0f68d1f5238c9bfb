// SPDX-License-Identifier: MIT
#include "noise/filter.h"

#include "base/simd.h"
#include "noise/gains.h"

namespace imucal {
namespace {

// M: number of states where the compiler may know it, else 0.
template <class V, size_t M>
IMUCAL_WIDE_PART void run(const FilterGains& g, double* rows, size_t stride, double* state) {
  constexpr size_t width = sizeof(V) / sizeof(double);
  const size_t n_states = M ? M : g.n_states, next = g.is_settled ? 0 : 1;
  V m[M ? M : kMostStates];
  for (size_t i = 0; i < n_states; ++i) load_lanes(&m[i], state + i * width);
  const double *phi = g.phi, *gain = g.gain, *w = g.inv_sqrt_s;
  for (size_t k = 0; k < g.n; ++k) {
    V nu;
    load_lanes(&nu, rows + k * stride);
    for (size_t i = 0; i < n_states; ++i) nu -= m[i];
    store_lanes(V(nu * *w), rows + k * stride);
    for (size_t i = 0; i < n_states; ++i) m[i] = phi[i] * (m[i] + gain[i] * nu);
    phi += next * n_states, gain += next * n_states, w += next;
  }
  for (size_t i = 0; i < n_states; ++i) store_lanes(m[i], state + i * width);
}

template <class V> IMUCAL_WIDE_PART void run_states(const FilterGains& g, double* rows, size_t stride, double* state) {
  switch (g.n_states) {
  case 1:
    return run<V, 1>(g, rows, stride, state);
  case 2:
    return run<V, 2>(g, rows, stride, state);
  case 3:
    return run<V, 3>(g, rows, stride, state);
  default:
    return run<V, 0>(g, rows, stride, state);
  }
}

IMUCAL_WIDE void run_8(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<Lanes8>(g, rows, stride, state);
}
IMUCAL_WIDE void run_4(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<Lanes>(g, rows, stride, state);
}

// Four rows of the sum at a time: they stay in registers.
template <class V> IMUCAL_WIDE_PART void products(const double* a, const double* b, size_t n, double* sum) {
  constexpr size_t width = sizeof(V) / sizeof(double);
  for (size_t i = 0; i < width; i += 4) {
    V s[4], right;
    for (size_t l = 0; l < 4; ++l) load_lanes(&s[l], sum + (i + l) * width);
    for (size_t k = 0; k < n; ++k) {
      load_lanes(&right, b + k * width);
      for (size_t l = 0; l < 4; ++l) s[l] += a[k * width + i + l] * right;
    }
    for (size_t l = 0; l < 4; ++l) store_lanes(s[l], sum + (i + l) * width);
  }
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

IMUCAL_WIDE void products_8(const double* a, const double* b, size_t n, double* sum) {
  products<Lanes8>(a, b, n, sum);
}
IMUCAL_WIDE void products_4(const double* a, const double* b, size_t n, double* sum) {
  products<Lanes>(a, b, n, sum);
}

} // namespace

void filter_lanes(const FilterGains& gains, size_t lanes, double* rows, size_t stride, double* state) {
  if (lanes == 8) return run_8(gains, rows, stride, state);
  if (lanes == 4) return run_4(gains, rows, stride, state);
  run_states<double>(gains, rows, stride, state);
}

void add_column_products(const double* a, size_t lda, size_t na, const double* b, size_t ldb, size_t nb, size_t n,
                         double* out) {
  constexpr size_t kChunk = 512; // samples of all columns of b that stay in the second cache
  for (size_t k = 0; k < n; k += kChunk)
    column_products(a + k, lda, na, b + k, ldb, nb, n - k < kChunk ? n - k : kChunk, out);
}

void add_products(size_t lanes, const double* a, const double* b, size_t n, double* sum) {
  (lanes == 8 ? products_8 : products_4)(a, b, n, sum);
}

} // namespace imucal
