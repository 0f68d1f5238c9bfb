// SPDX-License-Identifier: MIT
#include "base/repeats.h"

#include <algorithm>
#include <cmath>

#include "base/format.h"
#include "base/median.h"

namespace imucal {

namespace {

constexpr size_t kChanges = 64, kLeastChanges = 16;
constexpr double kQuantumAt = 0.05;     // quantile of the changes
constexpr double kLeastTurns = 0.25;    // of the changes; those of noise turn two times in three, of a walk one in two
constexpr double kFineChance = 0.06;    // what that quantile makes of values that are not rounded
constexpr double kMostOneQuantum = 0.8; // share of the changes
constexpr double kFinest = 64;          // quanta: there P(0) is below 1 %
constexpr double kInvRootTwoPi = 0.3989422804014327, kRootHalf = 0.7071067811865476;

// Second integral of the density of N(0, s^2): x Phi(x/s) + s phi(x/s).
double twice_integrated(double x, double s) {
  const double u = x / s;
  return x * 0.5 * std::erfc(-u * kRootHalf) + s * kInvRootTwoPi * std::exp(-0.5 * u * u);
}

// Of a step of j quanta.
double probability(double j, double s) {
  return twice_integrated(j + 1, s) - 2 * twice_integrated(j, s) + twice_integrated(j - 1, s);
}

// P(0) where such a part of the other steps is one quantum; the part falls as s grows.
double chance_of_equal(double one_quantum) {
  double lo = 0.1, hi = kFinest;
  for (int k = 0; k < 40; ++k) {
    const double s = std::sqrt(lo * hi);
    (2 * probability(1, s) > one_quantum * (1 - probability(0, s)) ? lo : hi) = s;
  }
  const double chance = probability(0, lo);
  return chance < kFineChance ? 0 : chance;
}

std::vector<double> steps_of(const std::vector<double>& values) {
  std::vector<double> steps;
  for (size_t k = 1; k < values.size(); ++k)
    if (const double step = values[k] - values[k - 1]; std::isfinite(step)) steps.push_back(step);
  return steps;
}

double quantum_of(const std::vector<double>& steps) {
  std::vector<double> changes;
  for (const double step : steps)
    if (step != 0) changes.push_back(std::abs(step));
  if (changes.size() < kLeastChanges) return 0;
  const auto at = changes.begin() + static_cast<long>(kQuantumAt * static_cast<double>(changes.size()));
  std::nth_element(changes.begin(), at, changes.end());
  return *at;
}

struct Stretch {
  size_t n = 0, n_changes = 0, n_one_quantum = 0, n_turns = 0; // turns: changes against the one before
  double last = 0;

  void take(double step, double quantum) {
    ++n;
    if (step == 0) return;
    ++n_changes;
    n_one_quantum += std::abs(step) < 1.5 * quantum;
    n_turns += step * last < 0;
    last = step;
  }
  // Beyond chance.
  double excess() const {
    const auto changes = static_cast<double>(n_changes);
    const double one_quantum = static_cast<double>(n_one_quantum) / changes;
    if (one_quantum > kMostOneQuantum || static_cast<double>(n_turns) < kLeastTurns * changes) return 0;
    return std::max(0.0, 1 - changes / static_cast<double>(n) - chance_of_equal(one_quantum));
  }
};

} // namespace

std::string repeated_text(double share, double dt_s) {
  const double rows = 1 / (1 - share);
  return format(
      "%.0f %% of the rows repeat the one before, beyond chance: the sensor is read more often than it measures, a "
      "reading stands for about %.2g rows, and there are so many times fewer measurements than rows; take means "
      "over whole readings (rows of %.2g s), or set the sensor to measure at least once a row",
      100 * share, rows, std::ceil(rows - 0.1) * dt_s);
}

double repeated_share(const std::vector<double>& values) {
  const std::vector<double> steps = steps_of(values);
  const double quantum = quantum_of(steps);
  if (!(quantum > 0)) return 0;
  std::vector<double> excesses;
  Stretch stretch;
  for (const double step : steps) {
    stretch.take(step, quantum);
    if (stretch.n_changes < kChanges) continue;
    excesses.push_back(stretch.excess());
    stretch = {};
  }
  return excesses.empty() ? stretch.excess() : median(excesses);
}

} // namespace imucal
