// SPDX-License-Identifier: MIT
// How samples lie around their local level: what tells a clipped or emptied range from a wrong reading.
#pragma once
#include <utility>
#include <vector>

#include "physics/effects/estimation.h"

namespace imucal {

// Running medians over 41 rows and the noise from second to second about them.
struct LocalLevels {
  std::vector<std::vector<double>> level_dph; // per run and row; NaN where the rate is
  double sigma_dph = 0;                       // robust; 0: the samples do not move
};
LocalLevels local_levels(const std::vector<RunInput>& runs);

// How many samples normal noise about the local levels would put between lo and hi.
double expected_between(const LocalLevels& levels, double lo, double hi);

// Are two rates the same but for the rounding of doubles?  A mean may be a million times the noise about it, and the steps of a
// file finer than that: no digit of a rate may count as rounding.
bool is_same_rate(double a, double b);

// Median of |N(0, 2 sigma^2)| over sigma: of the jumps between samples of white noise.
constexpr double kMedianJump = 0.9539;

// The finite rates of a run, or of all runs.
std::vector<double> finite_rates(const RunInput& run);
std::vector<double> finite_rates(const std::vector<RunInput>& runs);

// Each of the values, in order of size, and how often it is found.
std::vector<std::pair<double, size_t>> values_with_counts(std::vector<double> values);

// Samples at one value: how many, and how many of them lie more than five sigma from their local level.
size_t count_at(const RunInput& run, double value);
size_t count_at(const std::vector<RunInput>& runs, double value);
size_t count_far_at(const std::vector<RunInput>& runs, const LocalLevels& levels, double value);

// How often the value that is found most often, other than `value`, is found.
size_t most_common_other(const std::vector<RunInput>& runs, double value);

// Per run and row: which samples are at `value`.
std::vector<std::vector<char>> samples_at(const std::vector<RunInput>& runs, double value);

} // namespace imucal
