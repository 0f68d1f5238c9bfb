// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/smoothing.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <optional>

namespace imucal {
namespace {

// Part of white noise that the smoother keeps: the mean of 1 / (1 + tau^4 (2 - 2 cos w)^2) over all frequencies w, which is that
// of the real part of 1 / (1 + i tau^2 (2 - 2 cos w)).
double kept_part(double tau) {
  return std::real(1.0 / std::sqrt(std::complex<double>(1, 4 * tau * tau)));
}

// Mean square of the means of y - z over blocks, of which at least half was seen; nullopt: there is no such block.
std::optional<double> block_error(const std::vector<double>& y, const std::vector<double>& z, size_t block) {
  double squares = 0, n = 0;
  for (size_t first = 0; first + block <= y.size(); first += block) {
    double sum = 0;
    size_t n_seen = 0;
    for (size_t t = first; t < first + block; ++t)
      if (std::isfinite(y[t])) sum += y[t] - z[t], ++n_seen;
    if (2 * n_seen < block) continue;
    squares += std::pow(sum / static_cast<double>(n_seen), 2), n += 1;
  }
  if (n == 0) return std::nullopt;
  return squares / n;
}

} // namespace

// (W + tau^4 D'D) z = W y with five diagonals, by the factors L D L' (no pivots: the matrix is positive definite).
std::vector<double> whittaker(const std::vector<double>& y, double tau) {
  const size_t n = y.size();
  if (n < 3) return y;
  const double weight = std::pow(tau, 4);
  std::vector<double> pivot(n), next(n, 0.0), after(n, 0.0), z(n);
  for (size_t t = 0; t < n; ++t) {
    const bool is_seen = std::isfinite(y[t]);
    // D'D: a number stands in the second differences that begin two and one before it and at it, as 1, -2 and 1.
    const int last = t >= 2, middle = t >= 1 && t + 1 < n, first = t + 2 < n;
    const int centre = last + 4 * middle + first, beside = -2 * (middle + first);
    double p = (is_seen ? 1 : 0) + weight * centre, b = weight * beside, x = is_seen ? y[t] : 0;
    if (t >= 1) p -= next[t - 1] * next[t - 1] * pivot[t - 1], b -= next[t - 1] * after[t - 1] * pivot[t - 1];
    if (t >= 2) p -= after[t - 2] * after[t - 2] * pivot[t - 2];
    if (t >= 1) x -= next[t - 1] * z[t - 1];
    if (t >= 2) x -= after[t - 2] * z[t - 2];
    pivot[t] = p, z[t] = x;
    if (t + 1 < n) next[t] = b / p;
    if (t + 2 < n) after[t] = weight / p;
  }
  for (size_t t = n; t-- > 0;) {
    z[t] /= pivot[t];
    if (t + 1 < n) z[t] -= next[t] * z[t + 1];
    if (t + 2 < n) z[t] -= after[t] * z[t + 2];
  }
  return z;
}

double best_tau(const std::vector<double>& y, const std::vector<double>& candidates, size_t block) {
  double best = candidates.front(), least = std::numeric_limits<double>::infinity();
  for (double tau : candidates) {
    const double kept = kept_part(tau) * static_cast<double>(block); // of the noise of a mean
    if (kept >= 1) continue;
    const std::optional<double> error = block_error(y, whittaker(y, tau), block);
    if (!error) break;
    const double validated = *error / ((1 - kept) * (1 - kept));
    if (validated < least) best = tau, least = validated;
  }
  return best;
}

} // namespace imucal
