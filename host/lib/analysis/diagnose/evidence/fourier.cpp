// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/fourier.h"

#include <cmath>

#include "base/simd.h"
#include "base/units.h"

namespace imucal {
namespace {

constexpr size_t kInCache = 256; // numbers; eight sequences of them fill a first cache of 32 kB
constexpr size_t kTurn = 6;      // numbers of one j

// Re and im of four times what V holds.
template <class V> struct Four { V re[4], im[4]; };
template <class V> IMUCAL_WIDE_PART void load_four(const double* re, const double* im, size_t apart, Four<V>* x) {
  unrolled<4>([&] IMUCAL_UNROLLED(q) { load_lanes(&x->re[q], re + q * apart), load_lanes(&x->im[q], im + q * apart); });
}
// A transform of four: x becomes what leads to the frequencies 4 r, 4 r + 1, 4 r + 2, 4 r + 3.
template <class V> IMUCAL_WIDE_PART void four_point(Four<V>* x) {
  const V ac_re = x->re[0] + x->re[2], ac_im = x->im[0] + x->im[2], a_c_re = x->re[0] - x->re[2],
          a_c_im = x->im[0] - x->im[2];
  const V bd_re = x->re[1] + x->re[3], bd_im = x->im[1] + x->im[3], b_d_re = x->re[1] - x->re[3],
          b_d_im = x->im[1] - x->im[3];
  x->re[0] = ac_re + bd_re, x->im[0] = ac_im + bd_im;
  x->re[1] = a_c_re + b_d_im, x->im[1] = a_c_im - b_d_re; // (a - c) - i (b - d)
  x->re[2] = ac_re - bd_re, x->im[2] = ac_im - bd_im;
  x->re[3] = a_c_re - b_d_im, x->im[3] = a_c_im + b_d_re;
}

// One step over a part of m numbers, m a multiple of 4, of B vectors of sequences.
template <class V, size_t B> IMUCAL_WIDE_PART void step_of_four(size_t m, const double* turns, double* re, double* im) {
  constexpr size_t width = sizeof(V) / sizeof(double);
  const size_t apart = m / 4 * B * width;
  for (size_t j = 0; j < m / 4; ++j, turns += kTurn)
    for (size_t b = 0; b < B; ++b, re += width, im += width) {
      Four<V> x;
      load_four(re, im, apart, &x);
      four_point(&x);
      store_lanes(x.re[0], re), store_lanes(x.im[0], im);
      unrolled<3>([&] IMUCAL_UNROLLED(q) {
        const double c = turns[2 * q], s = turns[2 * q + 1];
        store_lanes(V(x.re[q + 1] * c + x.im[q + 1] * s), re + (q + 1) * apart);
        store_lanes(V(x.im[q + 1] * c - x.re[q + 1] * s), im + (q + 1) * apart);
      });
    }
}
template <class V, size_t B> IMUCAL_WIDE_PART void step_of_two(double* re, double* im) {
  constexpr size_t width = sizeof(V) / sizeof(double);
  for (double* x : {re, im})
    for (size_t b = 0; b < B; ++b, x += width) {
      V first, second;
      load_lanes(&first, x), load_lanes(&second, x + B * width);
      store_lanes(V(first + second), x), store_lanes(V(first - second), x + B * width);
    }
}
// All steps of a part of m numbers, or only the first.
template <class V, size_t B>
IMUCAL_WIDE_PART void steps(size_t m, bool only_first, const double* turns, double* re, double* im) {
  constexpr size_t lanes = B * sizeof(V) / sizeof(double);
  const size_t n = m;
  for (; m >= 4; turns += m / 4 * kTurn, m /= 4) {
    for (size_t at = 0; at < n; at += m) step_of_four<V, B>(m, turns, re + at * lanes, im + at * lanes);
    if (only_first) return;
  }
  for (size_t at = 0; m == 2 && at < n; at += 2) step_of_two<V, B>(re + at * lanes, im + at * lanes);
}
template <class V>
IMUCAL_WIDE_PART void steps_of_lanes_by(size_t m, bool only_first, const double* turns, double* re, double* im) {
  steps<V, Fourier::kLanes * sizeof(double) / sizeof(V)>(m, only_first, turns, re, im);
}
IMUCAL_BY_LANES(steps_of_lanes, (size_t m, bool only_first, const double* turns, double* re, double* im),
                (m, only_first, turns, re, im))
void steps_of_one(size_t m, bool only_first, const double* turns, double* re, double* im) {
  steps<double, 1>(m, only_first, turns, re, im);
}

// A part that does not fit into the cache is cut into its quarters after its first step.
void all_steps(size_t lanes, size_t m, const double* turns, double* re, double* im) {
  const bool fits = m <= kInCache;
  (lanes == 1 ? steps_of_one : steps_of_lanes)(m, !fits, turns, re, im);
  for (size_t q = 0; q < 4 && !fits; ++q)
    all_steps(lanes, m / 4, turns + m / 4 * kTurn, re + q * (m / 4) * lanes, im + q * (m / 4) * lanes);
}

// The frequencies first, first + apart, .. stand in the part of m numbers from `at` on.
void set_places(size_t at, size_t m, size_t first, size_t apart, std::vector<size_t>* place) {
  if (m == 1) {
    (*place)[first] = at;
    return;
  }
  const size_t parts = m >= 4 ? 4 : 2;
  for (size_t q = 0; q < parts; ++q)
    set_places(at + q * (m / parts), m / parts, first + q * apart, apart * parts, place);
}

IMUCAL_WIDE void sum_squares(const double* re, const double* im, double scale, size_t n, double* sum) {
  for (size_t i = 0; i < n; ++i) sum[i] += (re[i] * re[i] + im[i] * im[i]) * scale;
}

} // namespace

Fourier::Fourier(size_t n) : n_(n), place_(n) {
  set_places(0, n, 0, 1, &place_);
  std::vector<double> cosine(n),
      sine(n); // only those of the longest step are computed: shorter steps take every fourth
  for (size_t j = 0; j < n - n / 4; ++j) {
    const double angle = 2 * kPi * static_cast<double>(j) / static_cast<double>(n);
    cosine[j] = std::cos(angle), sine[j] = std::sin(angle);
  }
  for (size_t m = n, apart = 1; m >= 4; m /= 4, apart *= 4)
    for (size_t j = 0; j < m / 4; ++j)
      for (size_t q = 1; q < 4; ++q) turns_.push_back(cosine[q * j * apart]), turns_.push_back(sine[q * j * apart]);
}

void Fourier::transform(size_t lanes, double* re, double* im) const {
  all_steps(lanes, n_, turns_.data(), re, im);
}

void add_squares(const std::vector<double>& re, const std::vector<double>& im, double scale, std::vector<double>* sum) {
  sum_squares(re.data(), im.data(), scale, sum->size(), sum->data());
}

// Of a + i b with real a and b, X_k and the conjugate of X_(n - k) are A_k + i B_k and A_k - i B_k.
void add_powers(const Fourier& fourier, double* sequence, double scale, double* other, double other_scale,
                std::vector<double>* sum) {
  const size_t n = fourier.n();
  std::vector<double> zero(other ? 0 : n, 0.0);
  double *re = sequence, *im = other ? other : zero.data();
  fourier.transform(re, im);
  sum->resize(n / 2 + 1, 0.0);
  for (size_t k = 0; k <= n / 2; ++k) {
    const size_t at = fourier.place(k), opposite = fourier.place(k > 0 ? n - k : 0);
    const double even_re = re[at] + re[opposite], odd_im = im[at] - im[opposite];
    const double even_im = im[at] + im[opposite], odd_re = re[at] - re[opposite];
    (*sum)[k] += 0.25 * scale * (even_re * even_re + odd_im * odd_im);
    (*sum)[k] += 0.25 * other_scale * (even_im * even_im + odd_re * odd_re);
  }
}

} // namespace imucal
