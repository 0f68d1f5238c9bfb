// SPDX-License-Identifier: MIT
#include "noise/whiten.h"

#include <algorithm>
#include <cmath>

#include "noise/filter.h"

namespace imucal {
namespace {

constexpr size_t kChunk = 128; // samples that stay in the first cache

// f(gains of a part, its first sample) for the samples first .. first + n, stretch by stretch.
template <class F> void for_stretches(const RunGains& g, size_t first, size_t n, const F& f) {
  const auto ends_before = [](const RunGains::Stretch& s, size_t sample) { return s.end <= sample; };
  auto stretch = std::lower_bound(g.stretches.begin(), g.stretches.end(), first, ends_before);
  for (size_t k = first; k < first + n; k = stretch++->end) {
    const size_t end = std::min(stretch->end, first + n), row = g.row_of(*stretch, k);
    f(FilterGains{end - k, g.n_states, g.phi.data() + row * g.n_states, g.gain.data() + row * g.n_states,
                  &g.inv_sqrt_s[row], stretch->is_settled},
      k);
  }
}

// Samples first .. first + n of `lanes` columns; `rows` points to the first of them.
void filter(const RunGains& g, size_t first, size_t n, size_t lanes, double* rows, size_t stride, double* state) {
  for_stretches(g, first, n, [&](const FilterGains& part, size_t k) {
    filter_lanes(part, lanes, rows + (k - first) * stride, stride, state);
  });
}

// f(columns, lanes) for groups of 8 or 4 of them; the last group is filled up with its own last column.
template <class F> void for_groups(const std::vector<const double*>& columns, const F& f) {
  for (size_t first = 0; first < columns.size(); first += 8) {
    const size_t left = columns.size() - first, lanes = left > 4 ? 8 : 4;
    const double* group[8];
    for (size_t c = 0; c < lanes; ++c) group[c] = columns[first + std::min(c, left - 1)];
    f(first, lanes, group);
  }
}

// f(sample, gain, phi, inv_sqrt_s), from the first sample to the last.
template <class F> void for_samples(const RunGains& g, const F& f) {
  for (const RunGains::Stretch& s : g.stretches)
    for (size_t k = s.begin; k < s.end; ++k) {
      const size_t row = g.row_of(s, k);
      f(k, g.gain.data() + row * g.n_states, g.phi.data() + row * g.n_states, g.inv_sqrt_s[row]);
    }
}

// Whitens a group of columns chunk by chunk; load(first sample, samples, chunk) brings its rows.
template <class F> void whiten_group(const RunGains& gains, size_t n, size_t lanes, const F& load, double** out) {
  double chunk[kChunk * 8];
  std::vector<double> state(std::max<size_t>(1, gains.n_states) * lanes, 0.0);
  for (size_t k = 0; k < n; k += kChunk) {
    const size_t rows = std::min(kChunk, n - k);
    load(k, rows, chunk);
    filter(gains, k, rows, lanes, chunk, lanes, state.data());
    rows_to_columns(lanes, chunk, lanes, rows, out);
    for (size_t c = 0; c < lanes; ++c) out[c] += rows;
  }
}

// Where the columns of a group go: `first` of `p` columns of n samples, the last of them for lanes that fill up.
void place_group(size_t first, size_t lanes, size_t p, size_t n, double* to, double** out) {
  for (size_t c = 0; c < lanes; ++c) out[c] = to + std::min(first + c, p - 1) * n;
}

// Column after column of `n` samples; may be in place.
void whiten_to(const RunGains& gains, size_t n, const std::vector<const double*>& columns, double* to) {
  for_groups(columns, [&](size_t first, size_t lanes, const double** group) {
    double* out[8];
    place_group(first, lanes, columns.size(), n, to, out);
    const auto load = [&](size_t, size_t rows, double* chunk) {
      columns_to_rows(lanes, group, rows, chunk, lanes);
      for (size_t c = 0; c < lanes; ++c) group[c] += rows;
    };
    whiten_group(gains, n, lanes, load, out);
  });
}

std::vector<const double*> pointers_to(const Eigen::MatrixXd& columns) {
  std::vector<const double*> list;
  for (long c = 0; c < columns.cols(); ++c) list.push_back(columns.data() + c * columns.rows());
  return list;
}

} // namespace

void whiten(const RunGains& gains, Eigen::MatrixXd* columns) {
  const size_t n = static_cast<size_t>(columns->rows());
  if (columns->cols() == 1) return whiten(gains, columns->data(), n);
  whiten_to(gains, n, pointers_to(*columns), columns->data());
}

void whiten(const RunGains& gains, double* column, size_t n) {
  std::vector<double> state(std::max<size_t>(1, gains.n_states), 0.0);
  filter(gains, 0, n, 1, column, 1, state.data());
}

void whiten_rows(const RunGains& gains, size_t width, double* rows) {
  std::vector<double> state;
  for (size_t first = 0; first < width;) {
    const size_t left = width - first, lanes = left >= 8 ? 8 : left >= 4 ? 4 : 1;
    state.assign(std::max<size_t>(1, gains.n_states) * lanes, 0.0);
    filter(gains, 0, gains.n, lanes, rows + first, width, state.data());
    first += lanes;
  }
}

// u_k = v_k / s_k - K_k' r_k,  r_{k-1} = 1 u_k + Phi' r_k,  K = Phi gain.
void solve_rows(const RunGains& gains, size_t width, double* rows) {
  whiten_rows(gains, width, rows);
  const size_t m = gains.n_states;
  std::vector<double> r(m * width, 0.0);
  for (auto s = gains.stretches.rbegin(); s != gains.stretches.rend(); ++s)
    for (size_t k = s->end; k-- > s->begin;) {
      const size_t at = gains.row_of(*s, k);
      const double *gain = gains.gain.data() + at * m, *phi = gains.phi.data() + at * m;
      double* row = rows + k * width;
      for (size_t c = 0; c < width; ++c) {
        double u = row[c] * gains.inv_sqrt_s[at];
        for (size_t i = 0; i < m; ++i) u -= phi[i] * gain[i] * r[i * width + c];
        for (size_t i = 0; i < m; ++i) r[i * width + c] = u + phi[i] * r[i * width + c];
        row[c] = u;
      }
    }
}

// Filtered with the states x at sample k, the samples k.. of the step have a sum of squared innovations that is a quadratic
// of x: x'Ax - 2 b'x + c.  At the start of the step x is 0.  Backwards, with the innovation (1 - 1'x) and the states
// Phi (x + gain (1 - 1'x)) = F x + d of the next sample.
Eigen::VectorXd step_norms(const RunGains& gains) {
  using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostStates, kMostStates>;
  using State = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostStates, 1>;
  const auto m = static_cast<long>(gains.n_states);
  Eigen::VectorXd norms(static_cast<long>(gains.n));
  Small a = Small::Zero(m, m), f(m, m), af(m, m);
  State b = State::Zero(m), d(m);
  double c = 0;
  for (auto s = gains.stretches.rbegin(); s != gains.stretches.rend(); ++s)
    for (size_t k = s->end; k-- > s->begin;) {
      const size_t row = gains.row_of(*s, k);
      const Eigen::Map<const Eigen::VectorXd> gain(gains.gain.data() + row * gains.n_states, m),
          phi(gains.phi.data() + row * gains.n_states, m);
      const double information = gains.inv_sqrt_s[row] * gains.inv_sqrt_s[row];
      d = phi.cwiseProduct(gain);
      f = -d.replicate(1, m);
      f.diagonal() += phi;
      af.noalias() = a.lazyProduct(f);
      c += information - 2 * b.dot(d) + d.dot(a.lazyProduct(d));
      const State rest = b - a.lazyProduct(d);
      b = State::Constant(m, information) + f.transpose().lazyProduct(rest);
      a = Small::Constant(m, m, information) + f.transpose().lazyProduct(af);
      norms[static_cast<long>(k)] = c;
    }
  return norms;
}

void colour(const RunGains& gains, double* column, size_t) {
  std::vector<double> m(gains.n_states, 0.0);
  for_samples(gains, [&](size_t k, const double* gain, const double* phi, double inv_sqrt_s) {
    const double nu = column[k] / inv_sqrt_s;
    double prediction = 0;
    for (const double state : m) prediction += state;
    column[k] = prediction + nu;
    for (size_t i = 0; i < m.size(); ++i) m[i] = phi[i] * (m[i] + gain[i] * nu);
  });
}

Eigen::MatrixXd column_products(const Eigen::Ref<const Eigen::MatrixXd>& a,
                                const Eigen::Ref<const Eigen::MatrixXd>& b) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(a.cols(), b.cols());
  add_column_products(a.data(), static_cast<size_t>(a.outerStride()), static_cast<size_t>(a.cols()), b.data(),
                      static_cast<size_t>(b.outerStride()), static_cast<size_t>(b.cols()),
                      static_cast<size_t>(a.rows()), out.data());
  return out;
}

Eigen::MatrixXd column_gram(const Eigen::Ref<const Eigen::MatrixXd>& a) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(a.cols(), a.cols());
  add_column_gram(a.data(), static_cast<size_t>(a.outerStride()), static_cast<size_t>(a.cols()),
                  static_cast<size_t>(a.rows()), out.data());
  return out;
}

WideColumns::WideColumns(const Eigen::MatrixXd& columns)
    : WideColumns(pointers_to(columns), static_cast<size_t>(columns.rows())) {}

WideColumns::WideColumns(const std::vector<const double*>& columns, size_t n)
    : n_(n), p_(columns.size()), width_((p_ + 3) / 4 * 4), data_(n_ * width_) {
  for_groups(columns, [&](size_t first, size_t lanes, const double** group) {
    columns_to_rows(lanes, group, n_, &data_[first], width_);
  });
}

Eigen::MatrixXd WideColumns::whitened_gram(const RunGains& gains) const {
  const size_t states = std::max<size_t>(1, gains.n_states);
  std::vector<double> chunk(kChunk * width_), state(states * width_, 0.0), sums(width_ * width_, 0.0);
  for (size_t k = 0; k < n_; k += kChunk) {
    const size_t n = std::min(kChunk, n_ - k);
    std::copy_n(&data_[k * width_], n * width_, chunk.data());
    for (size_t first = 0; first < width_; first += 16)
      filter(gains, k, n, std::min<size_t>(16, width_ - first), &chunk[first], width_, &state[first * states]);
    add_gram(chunk.data(), width_, n, sums.data());
  }
  const auto p = static_cast<long>(p_);
  Eigen::MatrixXd gram(p, p);
  for (size_t i = 0; i < p_; ++i)
    for (size_t j = i; j < p_; ++j)
      gram(static_cast<long>(i), static_cast<long>(j)) = gram(static_cast<long>(j), static_cast<long>(i)) =
          sums[i * width_ + j];
  return gram;
}

LaneColumns::LaneColumns(const Eigen::MatrixXd& columns)
    : n_(static_cast<size_t>(columns.rows())), p_(static_cast<size_t>(columns.cols())), data_(n_ * ((p_ + 3) / 4 * 4)) {
  for_groups(pointers_to(columns), [&](size_t first, size_t lanes, const double** group) {
    columns_to_rows(lanes, group, n_, data_.data() + first * n_, lanes);
  });
}

Eigen::MatrixXd LaneColumns::whitened(const RunGains& gains) const {
  Eigen::MatrixXd columns(static_cast<long>(n_), static_cast<long>(p_));
  for (size_t first = 0; first < p_; first += 8) {
    const size_t lanes = p_ - first > 4 ? 8 : 4;
    double* out[8];
    place_group(first, lanes, p_, n_, columns.data(), out);
    const auto load = [&](size_t k, size_t rows, double* chunk) {
      std::copy_n(data_.data() + first * n_ + k * lanes, rows * lanes, chunk);
    };
    whiten_group(gains, n_, lanes, load, out);
  }
  return columns;
}

} // namespace imucal
