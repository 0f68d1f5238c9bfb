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

// One unit in coordinates in which what its rates say of c is independent from one to the next.
struct Seen {
  double n = 0;                // rows
  double left2 = 0;            // mean square of what is left, about its mean
  double fit2 = 0;             // mean square error of the answer that the fit leaves
  VectorXd precision, product; // of c: B'V^-1 B is diagonal, and B'V^-1 times the rates
  VectorXd change;             // what the answer changes, in the same coordinates
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
  const MatrixXd g = WideColumns(columns).whitened_gram(compute_gains(unit.run, noise));
  const MatrixXd of_free = inverse_symmetric(g.topLeftCorner(f, f));
  const MatrixXd rest = g.bottomRightCorner(k + 1, k + 1) - g.block(f, 0, k + 1, f) * of_free * g.block(0, f, f, k + 1);
  const Spectrum spectrum = symmetric_spectrum(rest.topLeftCorner(k, k));
  Seen out;
  out.n = static_cast<double>(n);
  out.fit2 = unit.error_of_fit_dph2;
  out.left2 = (unit.left.array() - unit.left.mean()).square().mean();
  out.precision = spectrum.values.cwiseMax(0);
  out.product = spectrum.vectors.transpose() * rest.block(0, k, k, 1);
  out.change = spectrum.vectors.transpose() * change.tail(k);
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

// ln p(rates | g), without what all g share.
double log_evidence(const std::vector<Seen>& units, double g2) {
  double sum = 0;
  for (const Seen& u : units)
    for (long c = 0; c < u.precision.size(); ++c)
      sum += 0.5 * (u.product[c] * u.product[c] / (u.precision[c] + 1 / g2) - std::log1p(g2 * u.precision[c]));
  return sum;
}

// Sizes of c per column, each as likely as the others before the rates are looked at, and their share of the draws after.
struct Sizes {
  std::vector<double> g2, share;
};
Sizes sizes_of(const std::vector<Seen>& units, double change2, double left2, double fit2) {
  Sizes out;
  double columns = 1;
  for (const Seen& u : units) columns = std::max(columns, static_cast<double>(u.precision.size()));
  const double most = 2 * std::sqrt(std::max({change2, left2, fit2}));
  for (double rms = std::max(kLeastPart * std::sqrt(change2), std::sqrt(fit2)); rms < kRatio * most; rms *= kRatio)
    out.g2.push_back(rms * rms / columns);
  double top = -1e300, sum = 0;
  for (double g2 : out.g2) out.share.push_back(log_evidence(units, g2)), top = std::max(top, out.share.back());
  for (double& s : out.share) s = std::exp(s - top), sum += s;
  for (double& s : out.share) s /= sum;
  return out;
}

// Mean squares of c and of c + change, drawn from the posterior under one size.
struct Draw {
  double before = 0, after = 0;
};
Draw drawn(const std::vector<Seen>& units, double g2, const double* normals) {
  Draw out;
  double n = 0;
  for (const Seen& u : units) {
    double before = 0, after = 0;
    for (long c = 0; c < u.of_starts.size(); ++c)
      before += std::pow(u.of_starts[c] + u.of_starts_sd[c] * *normals++, 2);
    for (long c = 0; c < u.precision.size(); ++c) {
      const double precision = u.precision[c] + 1 / g2;
      const double value = u.product[c] / precision + *normals++ / std::sqrt(precision);
      after += value * value, before += (value + u.change[c]) * (value + u.change[c]);
    }
    out.before += u.n * before, out.after += u.n * after, n += u.n;
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
    width += static_cast<size_t>(all.back().precision.size() + all.back().of_starts.size());
  }
  Reduction out;
  const double change2 =
      mean_over_rows(all, [](const Seen& u) { return u.change.squaredNorm() + u.of_starts.squaredNorm(); });
  if (!(change2 > 0)) return out;
  const Sizes sizes = sizes_of(all, change2, mean_over_rows(all, [](const Seen& u) { return u.left2; }),
                               mean_over_rows(all, [](const Seen& u) { return u.fit2; }));
  std::vector<double> normals(width), values;
  const Rng rng(kSeed, 0, 0, static_cast<uint32_t>(Stream::kTool) + 10);
  double sum = 0, mean = 0;
  for (size_t i = 0, d = 0; i < sizes.g2.size(); ++i) {
    sum += sizes.share[i];
    for (; static_cast<double>(d) + 0.5 < sum * kDraws && d < kDraws; ++d) {
      rng.normals(static_cast<uint32_t>(d * width), width, normals.data());
      const Draw one = drawn(all, sizes.g2[i], normals.data());
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
