// SPDX-License-Identifier: MIT
#include "analysis/diagnose/evidence/reduction.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/evidence/kalman.h"
#include "base/rng.h"
#include "base/units.h"
#include "linear/linear.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr size_t kDraws = 2000;
constexpr int kTimeCosines = 2;
constexpr double kAddsNothing = 1e-6; // of its norm: what is left of a column that the others give
constexpr double kLeastPart = 0.05;   // of what the answer changes: the least that it is thought to get wrong
constexpr double kRatio = 2;          // between the sizes of what it may get wrong
constexpr double kLow = 0.025, kHigh = 0.975;
constexpr uint64_t kSeed = 1;

// Puts what a column adds to orthogonal ones behind them, with a mean square of one; false: it adds nothing.
bool add_column(VectorXd column, std::vector<VectorXd>* to) {
  const double before = column.norm(), n = static_cast<double>(column.size());
  for (int pass = 0; pass < 2; ++pass)
    for (const VectorXd& other : *to) column -= other * (other.dot(column) / n);
  const double after = column.norm();
  if (!(after > kAddsNothing * before)) return false;
  to->push_back(column * (std::sqrt(n) / after));
  return true;
}

std::vector<VectorXd> time_cosines(const CampaignRun& run) {
  std::vector<VectorXd> out;
  const double first = run.input.t_s[static_cast<size_t>(run.used.front())];
  const double length = std::max(1.0, run.input.t_s[static_cast<size_t>(run.used.back())] - first);
  for (int j = 1; j <= kTimeCosines; ++j) {
    VectorXd x(static_cast<long>(run.n()));
    for (size_t k = 0; k < run.n(); ++k)
      x[static_cast<long>(k)] = std::cos(kPi * j * (run.input.t_s[static_cast<size_t>(run.used[k])] - first) / length);
    out.push_back(std::move(x));
  }
  return out;
}

// One unit: what its rates say of c, and what was known before.
struct Seen {
  double n = 0;       // rows
  double left2 = 0;   // mean square of what is left, about its mean
  MatrixXd precision; // of c: B'V^-1 B
  VectorXd product;   // B'V^-1 times the rates
  MatrixXd of_fit;    // K
  VectorXd change;    // what the answer changes
  // What it changes in start states: fitted to the rates themselves, so partly to their noise.
  VectorXd of_starts, of_starts_sd;
};

// [free, B]: orthogonal columns of unit rms; `n_free` of them are free.
struct Basis {
  std::vector<VectorXd> columns;
  long n_free = 0;
};
Basis basis_of(const HeldOutUnit& unit) {
  Basis out;
  add_column(VectorXd::Ones(unit.left.size()), &out.columns);
  for (long c = 0; c < unit.starts.cols(); ++c) add_column(unit.starts.col(c), &out.columns);
  out.n_free = static_cast<long>(out.columns.size());
  add_column(unit.change, &out.columns);
  for (long c = 0; c < unit.shapes.cols(); ++c) add_column(unit.shapes.col(c), &out.columns);
  for (const VectorXd& x : time_cosines(unit.run)) add_column(x, &out.columns);
  return out;
}

// K in orthogonal columns of unit rms.
MatrixXd left_by_fit(const HeldOutUnit& unit, const MatrixXd& basis) {
  if (unit.fitted.cols() == 0) return MatrixXd::Zero(basis.cols(), basis.cols());
  const MatrixXd to_basis = basis.transpose() * unit.fitted / static_cast<double>(basis.rows());
  return to_basis * unit.covariance * to_basis.transpose();
}

Seen seen(const HeldOutUnit& unit, const Basis& basis, const NoiseModel& noise) {
  const long f = basis.n_free, k = static_cast<long>(basis.columns.size()) - f, n = unit.left.size();
  MatrixXd columns(n, f + k + 1);
  VectorXd change(f + k);
  for (long c = 0; c < f + k; ++c) {
    const VectorXd& column = basis.columns[static_cast<size_t>(c)];
    columns.col(c) = column;
    change[c] = column.dot(unit.change) / static_cast<double>(n);
  }
  columns.col(f + k) = unit.left;
  const double strength = unit.run.own_strength; // of the noise of this log
  const MatrixXd g = WideColumns(columns).whitened_gram(compute_gains(unit.run, noise)) / (strength * strength);
  const MatrixXd of_free = inverse_symmetric(g.topLeftCorner(f, f));
  const MatrixXd rest = g.bottomRightCorner(k + 1, k + 1) - g.block(f, 0, k + 1, f) * of_free * g.block(0, f, f, k + 1);
  Seen out;
  out.n = static_cast<double>(n);
  out.left2 = (unit.left.array() - unit.left.mean()).square().mean();
  out.precision = rest.topLeftCorner(k, k);
  out.product = rest.block(0, k, k, 1);
  out.of_fit = left_by_fit(unit, columns.middleCols(f, k));
  out.change = change.tail(k);
  out.of_starts = out.of_starts_sd = VectorXd::Zero(f - 1); // the constant is no start state
  for (long c = 1; c < f; ++c) {
    const double noise2 = of_free(c, c), part = std::max(0.0, 1 - noise2 / (change[c] * change[c])); // empirical Bayes
    if (part > 0) out.of_starts[c - 1] = part * change[c], out.of_starts_sd[c - 1] = std::sqrt(part * noise2);
  }
  return out;
}

// Of a mean square of each unit, over all rows.
template <class F> double mean_over_rows(const std::vector<Seen>& units, F mean_square) {
  double sum = 0, n = 0;
  for (const Seen& u : units) sum += u.n * mean_square(u), n += u.n;
  return n > 0 ? sum / n : 0;
}

// The posterior of c of one unit under one size, and ln p(rates | g) without what all g share.
struct Posterior {
  VectorXd mean;
  MatrixXd root; // root root' is its covariance
  double log_evidence = 0;
};
Posterior posterior_of(const Seen& u, double g2) {
  const long k = u.precision.rows();
  // With c = R z, z ~ N(0, 1): the precision of z is 1 + R'AR, which is safe however small or singular A is.
  const Spectrum prior = symmetric_spectrum(u.of_fit + g2 * MatrixXd::Identity(k, k));
  const MatrixXd r = prior.vectors * prior.values.cwiseMax(0).cwiseSqrt().asDiagonal();
  const Spectrum seen = symmetric_spectrum(r.transpose() * u.precision * r);
  const VectorXd precision = seen.values.cwiseMax(0).array() + 1;
  const MatrixXd axes = r * seen.vectors;
  const VectorXd product = axes.transpose() * u.product;
  Posterior out;
  out.mean = axes * product.cwiseQuotient(precision);
  out.root = axes * precision.cwiseSqrt().cwiseInverse().asDiagonal();
  out.log_evidence =
      0.5 * product.cwiseProduct(product).cwiseQuotient(precision).sum() - 0.5 * precision.array().log().sum();
  return out;
}

// What c may be under one size, each size as likely as the others before the rates are looked at, and its share after.
struct Size {
  std::vector<Posterior> units;
  double share = 0;
};
std::vector<Size> sizes_of(const std::vector<Seen>& units, double change2, double left2) {
  std::vector<Size> out;
  double columns = 1;
  for (const Seen& u : units) columns = std::max(columns, static_cast<double>(u.precision.rows()));
  const double most = 2 * std::sqrt(std::max(change2, left2));
  double top = -1e300, sum = 0;
  for (double rms = kLeastPart * std::sqrt(change2); rms < kRatio * most; rms *= kRatio) {
    Size size;
    for (const Seen& u : units) {
      size.units.push_back(posterior_of(u, rms * rms / columns));
      size.share += size.units.back().log_evidence;
    }
    top = std::max(top, size.share);
    out.push_back(std::move(size));
  }
  for (Size& size : out) size.share = std::exp(size.share - top), sum += size.share;
  for (Size& size : out) size.share /= sum;
  return out;
}

// Mean squares of c and of c + change, drawn from the posterior under one size.
struct Draw {
  double before = 0, after = 0;
};
Draw drawn(const std::vector<Seen>& units, const Size& size, const double* normals) {
  Draw out;
  double n = 0;
  for (size_t i = 0; i < units.size(); ++i) {
    const Seen& u = units[i];
    double before = 0;
    for (long c = 0; c < u.of_starts.size(); ++c)
      before += std::pow(u.of_starts[c] + u.of_starts_sd[c] * *normals++, 2);
    const long k = u.change.size();
    const VectorXd value = size.units[i].mean + size.units[i].root * Eigen::Map<const VectorXd>(normals, k);
    normals += k;
    out.after += u.n * value.squaredNorm(), out.before += u.n * (before + (value + u.change).squaredNorm()), n += u.n;
  }
  out.before /= n, out.after /= n;
  return out;
}

double quantile(const std::vector<double>& sorted, double p) {
  return sorted[static_cast<size_t>(p * static_cast<double>(sorted.size() - 1) + 0.5)];
}

} // namespace

Reduction reduction_of(const std::vector<HeldOutUnit>& units, const NoiseModel& noise) {
  std::vector<Seen> all;
  size_t width = 0;
  for (const HeldOutUnit& unit : units) {
    if (unit.left.size() == 0) continue;
    const Basis basis = basis_of(unit);
    if (static_cast<long>(basis.columns.size()) == basis.n_free) continue;
    all.push_back(seen(unit, basis, noise));
    width += static_cast<size_t>(all.back().change.size() + all.back().of_starts.size());
  }
  Reduction out;
  const double change2 =
      mean_over_rows(all, [](const Seen& u) { return u.change.squaredNorm() + u.of_starts.squaredNorm(); });
  if (!(change2 > 0)) return out;
  const std::vector<Size> sizes = sizes_of(all, change2, mean_over_rows(all, [](const Seen& u) { return u.left2; }));
  std::vector<double> normals(width), values;
  const Rng rng(kSeed, 0, 0, static_cast<uint32_t>(Stream::kTool) + 10);
  double sum = 0, mean = 0;
  for (size_t i = 0, d = 0; i < sizes.size(); ++i) {
    sum += sizes[i].share;
    for (; static_cast<double>(d) + 0.5 < sum * kDraws && d < kDraws; ++d) {
      rng.normals(static_cast<uint32_t>(d * width), width, normals.data());
      const Draw one = drawn(all, sizes[i], normals.data());
      out.before_dph2 += one.before / kDraws, out.after_dph2 += one.after / kDraws;
      values.push_back(std::max(-1.0, 1 - one.after / std::max(1e-300, one.before)));
      mean += values.back() / kDraws;
    }
  }
  std::sort(values.begin(), values.end());
  out.lo = quantile(values, kLow), out.hi = quantile(values, kHigh);
  out.shrinkage = std::clamp(mean, out.lo, out.hi);
  return out;
}

} // namespace imucal
