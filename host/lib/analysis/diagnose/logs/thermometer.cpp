// SPDX-License-Identifier: MIT
#include "analysis/diagnose/logs/thermometer.h"

#include <algorithm>
#include <cmath>

#include "base/median.h"

namespace imucal {
namespace {

constexpr double kFewestHeld = 30; // rows
constexpr double kUnusual = 5;     // times the median number of rows with one reading
constexpr double kJump = 3;        // times the median change, and every change within the next rows:
constexpr size_t kAfterwards = 60;
constexpr double kMostHeld = 0.5; // of the rows

// By how much the reading changes at each row; the first row: 0.
std::vector<double> changes(const std::vector<double>& temp_degc) {
  std::vector<double> out(temp_degc.size(), 0.0);
  for (size_t i = 1; i < out.size(); ++i) out[i] = std::fabs(temp_degc[i] - temp_degc[i - 1]);
  return out;
}

// Largest of the changes after this row, of those within reach.
double largest_after(const std::vector<double>& change, size_t row) {
  double largest = 0;
  for (size_t i = row + 1; i <= row + kAfterwards && i < change.size(); ++i) largest = std::fmax(largest, change[i]);
  return largest;
}

} // namespace

std::vector<Hold> stuck_thermometer(const std::vector<double>& t_s, double dt_s, const std::vector<double>& temp_degc) {
  const std::vector<double> change = changes(temp_degc);
  std::vector<Hold> rests, holds; // all between two changes; those that are far too long
  std::vector<double> lengths, moves;
  for (size_t first = 0, i = 1; i < change.size(); ++i) {
    if (change[i] == 0) continue;
    rests.push_back({first, i});
    lengths.push_back(static_cast<double>(i - first));
    if (std::isfinite(change[i])) moves.push_back(change[i]);
    first = i;
  }
  if (moves.empty()) return {};
  const double least_length = std::max(kFewestHeld, kUnusual * median(lengths)), usual_move = median(moves);
  double held = 0;
  for (const Hold& rest : rests) {
    const double length = static_cast<double>(rest.end - rest.first);
    if (length < least_length || t_s[rest.end] - t_s[rest.end - 1] > 1.5 * dt_s) continue;
    if (!(change[rest.end] > kJump * std::max(usual_move, largest_after(change, rest.end)))) continue;
    holds.push_back(rest);
    held += length;
  }
  if (held > kMostHeld * static_cast<double>(temp_degc.size())) return {};
  return holds;
}

} // namespace imucal
