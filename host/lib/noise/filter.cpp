// SPDX-License-Identifier: MIT
#include "noise/filter.h"

#include <algorithm>

#include "base/simd.h"
#include "noise/gains.h"

namespace imucal {
namespace {

constexpr size_t kProductChunk = 512; // samples of a panel that stay in the second cache
constexpr size_t kPanel = 64;         // columns of it

// B vectors of columns; M: number of states where the compiler may know it, else 0.
template <class V, size_t B, size_t M>
IMUCAL_WIDE_PART void run(const FilterGains& g, double* rows, size_t stride, double* state) {
  constexpr size_t width = sizeof(V) / sizeof(double);
  const size_t next = g.is_settled ? 0 : 1;
  V m[M * B];
  unrolled<M * B>([&] IMUCAL_UNROLLED(i) { load_lanes(&m[i], state + i * width); });
  const double *phi = g.phi, *gain = g.gain, *w = g.inv_sqrt_s;
  for (size_t k = 0; k < g.n; ++k, rows += stride) {
    V nu[B];
    unrolled<B>([&] IMUCAL_UNROLLED(b) { load_lanes(&nu[b], rows + b * width); });
    unrolled<M * B>([&] IMUCAL_UNROLLED(i) { nu[i % B] -= m[i]; });
    unrolled<B>([&] IMUCAL_UNROLLED(b) { store_lanes(V(nu[b] * *w), rows + b * width); });
    unrolled<M * B>([&] IMUCAL_UNROLLED(i) { m[i] = phi[i / B] * (m[i] + gain[i / B] * nu[i % B]); });
    phi += next * M, gain += next * M, w += next;
  }
  unrolled<M * B>([&] IMUCAL_UNROLLED(i) { store_lanes(m[i], state + i * width); });
}
// Any number of states, kept in memory.
template <class V, size_t B>
IMUCAL_WIDE_PART void run_any(const FilterGains& g, double* rows, size_t stride, double* state) {
  constexpr size_t width = sizeof(V) / sizeof(double);
  const size_t n_states = g.n_states, next = g.is_settled ? 0 : 1;
  const double *phi = g.phi, *gain = g.gain, *w = g.inv_sqrt_s;
  for (size_t k = 0; k < g.n; ++k, rows += stride) {
    for (size_t b = 0; b < B; ++b) {
      V nu, m;
      load_lanes(&nu, rows + b * width);
      for (size_t i = 0; i < n_states; ++i) load_lanes(&m, state + (i * B + b) * width), nu -= m;
      store_lanes(V(nu * *w), rows + b * width);
      for (size_t i = 0; i < n_states; ++i) {
        load_lanes(&m, state + (i * B + b) * width);
        store_lanes(V(phi[i] * (m + gain[i] * nu)), state + (i * B + b) * width);
      }
    }
    phi += next * n_states, gain += next * n_states, w += next;
  }
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
    return run_any<V, B>(g, rows, stride, state);
  }
}

template <class V> constexpr size_t kWidth = sizeof(V) / sizeof(double);

template <class V>
IMUCAL_WIDE_PART void filter_16_by(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<V, 16 / kWidth<V>>(g, rows, stride, state);
}
template <class V> IMUCAL_WIDE_PART void filter_8_by(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<V, 8 / kWidth<V>>(g, rows, stride, state);
}
IMUCAL_BY_LANES(filter_16, (const FilterGains& g, double* rows, size_t stride, double* state), (g, rows, stride, state))
IMUCAL_BY_LANES(filter_8, (const FilterGains& g, double* rows, size_t stride, double* state), (g, rows, stride, state))
IMUCAL_WIDE void filter_12(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<Lanes, 3>(g, rows, stride, state);
}
IMUCAL_WIDE void filter_4(const FilterGains& g, double* rows, size_t stride, double* state) {
  run_states<Lanes, 1>(g, rows, stride, state);
}

// Four vectors of four numbers: columns become rows.  Without loops: in them the vectors would be kept in memory.
IMUCAL_WIDE_PART void transpose(const double* from0, const double* from1, const double* from2, const double* from3,
                                double* to0, double* to1, double* to2, double* to3) {
  Lanes x0, x1, x2, x3;
  load_lanes(&x0, from0), load_lanes(&x1, from1), load_lanes(&x2, from2), load_lanes(&x3, from3);
  const Lanes a = __builtin_shufflevector(x0, x1, 0, 4, 2, 6), b = __builtin_shufflevector(x0, x1, 1, 5, 3, 7);
  const Lanes c = __builtin_shufflevector(x2, x3, 0, 4, 2, 6), d = __builtin_shufflevector(x2, x3, 1, 5, 3, 7);
  store_lanes(Lanes(__builtin_shufflevector(a, c, 0, 1, 4, 5)), to0);
  store_lanes(Lanes(__builtin_shufflevector(b, d, 0, 1, 4, 5)), to1);
  store_lanes(Lanes(__builtin_shufflevector(a, c, 2, 3, 6, 7)), to2);
  store_lanes(Lanes(__builtin_shufflevector(b, d, 2, 3, 6, 7)), to3);
}

template <size_t N> IMUCAL_WIDE_PART void to_rows(const double* const* columns, size_t n, double* rows, size_t stride) {
  for (size_t first = 0; first < N; first += 4) {
    const double *a = columns[first], *b = columns[first + 1], *c = columns[first + 2], *d = columns[first + 3];
    double* to = rows + first;
    size_t k = 0;
    for (; k + 4 <= n; k += 4, to += 4 * stride)
      transpose(a + k, b + k, c + k, d + k, to, to + stride, to + 2 * stride, to + 3 * stride);
    for (; k < n; ++k, to += stride) to[0] = a[k], to[1] = b[k], to[2] = c[k], to[3] = d[k];
  }
}
template <size_t N>
IMUCAL_WIDE_PART void to_columns(const double* rows, size_t stride, size_t n, double* const* columns) {
  for (size_t first = 0; first < N; first += 4) {
    double *a = columns[first], *b = columns[first + 1], *c = columns[first + 2], *d = columns[first + 3];
    const double* from = rows + first;
    size_t k = 0;
    for (; k + 4 <= n; k += 4, from += 4 * stride)
      transpose(from, from + stride, from + 2 * stride, from + 3 * stride, a + k, b + k, c + k, d + k);
    for (; k < n; ++k, from += stride) a[k] = from[0], b[k] = from[1], c[k] = from[2], d[k] = from[3];
  }
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

// Four rows of the sum by B vectors of its columns: they stay in registers.
template <class V, size_t B>
IMUCAL_WIDE_PART void gram_block(const double* left, const double* right, size_t width, size_t n, double* sum) {
  V s[4 * B];
  const auto at = [=](size_t i) { return sum + i / B * width + i % B * kWidth<V>; };
  unrolled<4 * B>([&] IMUCAL_UNROLLED(i) { load_lanes(&s[i], at(i)); });
  for (size_t k = 0; k < n; ++k, left += width, right += width) {
    V r[B];
    unrolled<B>([&] IMUCAL_UNROLLED(b) { load_lanes(&r[b], right + b * kWidth<V>); });
    unrolled<4 * B>([&] IMUCAL_UNROLLED(i) { s[i] += left[i / B] * r[i % B]; });
  }
  unrolled<4 * B>([&] IMUCAL_UNROLLED(i) { store_lanes(s[i], at(i)); });
}
template <class V> IMUCAL_WIDE_PART void gram_by(const double* x, size_t width, size_t n, double* sum) {
  for (size_t i = 0; i < width; i += 4)
    for (size_t j = i; j < width; j += width - j < 8 ? 4 : 8)
      if (width - j < 8)
        gram_block<Lanes, 1>(x + i, x + j, width, n, sum + i * width + j);
      else
        gram_block<V, 8 / kWidth<V>>(x + i, x + j, width, n, sum + i * width + j);
}
IMUCAL_BY_LANES(gram, (const double* x, size_t width, size_t n, double* sum), (x, width, n, sum))

// A by B columns against each other.  Eight samples side by side, in one vector or in two: the same bits.  The sums stay in
// registers.
template <class V, size_t A, size_t B>
IMUCAL_WIDE_PART void column_block(const double* a, size_t lda, const double* b, size_t ldb, size_t n, double* out,
                                   size_t ldo) {
  constexpr size_t kParts = 8 / kWidth<V>;
  V s[A * B * kParts] = {}; // [part][column of b][column of a]
  size_t k = 0;
  for (; k + 8 <= n; k += 8)
    unrolled<kParts>([&] IMUCAL_UNROLLED(part) {
      V left[A];
      unrolled<A>([&] IMUCAL_UNROLLED(i) { load_lanes(&left[i], a + i * lda + k + part * kWidth<V>); });
      unrolled<B>([&] IMUCAL_UNROLLED(j) {
        V right;
        load_lanes(&right, b + j * ldb + k + part * kWidth<V>);
        unrolled<A>([&] IMUCAL_UNROLLED(i) { s[(part * B + j) * A + i] += left[i] * right; });
      });
    });
  unrolled<A * B>([&] IMUCAL_UNROLLED(at) {
    const size_t i = at % A, j = at / A;
    double sum = 0;
    unrolled<kParts>(
        [&] IMUCAL_UNROLLED(part) { unrolled<kWidth<V>>([&] IMUCAL_UNROLLED(l) { sum += s[part * A * B + at][l]; }); });
    for (size_t rest = k; rest < n; ++rest) sum += a[i * lda + rest] * b[j * ldb + rest];
    out[i + j * ldo] += sum;
  });
}

// Columns `from` to `end` of b against as many strips of A columns of a as are left from `first`, which moves behind them.
// Where `is_upper` only what column j of b needs of the columns up to j of a, and some more.
template <class V, size_t A>
IMUCAL_WIDE_PART void column_strips(const double* a, size_t lda, size_t na, const double* b, size_t ldb, size_t from,
                                    size_t end, size_t n, bool is_upper, double* out, size_t* first) {
  for (; *first + A <= na; *first += A)
    for (size_t j = from; j < end; j += 2) {
      if (is_upper && *first >= j + 2) continue;
      const double *left = a + *first * lda, *right = b + j * ldb;
      double* to = out + *first + j * na;
      if (end - j >= 2)
        column_block<V, A, 2>(left, lda, right, ldb, n, to, na);
      else
        column_block<V, A, 1>(left, lda, right, ldb, n, to, na);
    }
}

// Strips of a stay in the first cache, panels of b in the second.
template <class V>
IMUCAL_WIDE_PART void column_products_by(const double* a, size_t lda, size_t na, const double* b, size_t ldb, size_t nb,
                                         size_t n, bool is_upper, double* out) {
  constexpr size_t kMost = kWidth<V> == 8 ? 8 : 2; // sums with two columns of b take half of 32 registers, or of 16
  for (size_t from = 0; from < nb; from += kPanel) {
    const size_t end = std::min(nb, from + kPanel);
    size_t first = 0;
    column_strips<V, kMost>(a, lda, na, b, ldb, from, end, n, is_upper, out, &first);
    column_strips<V, kMost / 2>(a, lda, na, b, ldb, from, end, n, is_upper, out, &first);
    column_strips<V, 1>(a, lda, na, b, ldb, from, end, n, is_upper, out, &first);
  }
}
IMUCAL_BY_LANES(column_products,
                (const double* a, size_t lda, size_t na, const double* b, size_t ldb, size_t nb, size_t n,
                 bool is_upper, double* out),
                (a, lda, na, b, ldb, nb, n, is_upper, out))

} // namespace

void filter_lanes(const FilterGains& gains, size_t lanes, double* rows, size_t stride, double* state) {
  if (lanes == 16) return filter_16(gains, rows, stride, state);
  if (lanes == 12) return filter_12(gains, rows, stride, state);
  if (lanes == 8) return filter_8(gains, rows, stride, state);
  if (lanes == 4) return filter_4(gains, rows, stride, state);
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
  for (size_t k = 0; k < n; k += kProductChunk)
    column_products(a + k, lda, na, b + k, ldb, nb, n - k < kProductChunk ? n - k : kProductChunk, false, out);
}

void add_column_gram(const double* a, size_t lda, size_t na, size_t n, double* out) {
  for (size_t k = 0; k < n; k += kProductChunk)
    column_products(a + k, lda, na, a + k, lda, na, n - k < kProductChunk ? n - k : kProductChunk, true, out);
  for (size_t j = 0; j < na; ++j)
    for (size_t i = j + 1; i < na; ++i) out[i + j * na] = out[j + i * na];
}

void add_gram(const double* x, size_t width, size_t n, double* sum) {
  gram(x, width, n, sum);
}

} // namespace imucal
