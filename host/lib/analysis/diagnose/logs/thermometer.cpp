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
constexpr double kMostHeld = 0.5;                        // of the rows
constexpr double kFastest_degc = 5, kFastest_degc_s = 1; // of a board: from row to row; where rows are further apart
constexpr size_t kMostWrong = 10;                        // readings in a row
constexpr size_t kFewestReadings = 20;
constexpr long kShortestRepeat = 3, kLongestRepeat = 600; // rows
constexpr double kOnGrid = 0.95;                          // of the changes come at one row of so many
constexpr double kBeyondStep = 1.5,
                 kSame_degc = 1e-6; // times the least distance of two readings; of two that are the same

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

// Of two different readings.
double least_distance(std::vector<double> temp_degc) {
  std::sort(temp_degc.begin(), temp_degc.end());
  double least = 1e300;
  for (size_t i = 1; i < temp_degc.size(); ++i)
    if (const double d = temp_degc[i] - temp_degc[i - 1]; d > kSame_degc) least = std::min(least, d);
  return least;
}

// Rows with readings, cut where one is further from the one before than the temperature can go.
std::vector<std::vector<size_t>> cut_at_jumps(const std::vector<double>& t_s, const std::vector<double>& temp_degc,
                                              const std::vector<size_t>& rows) {
  std::vector<std::vector<size_t>> pieces;
  for (size_t k = 0; k < rows.size(); ++k) {
    const size_t row = rows[k], last = k ? rows[k - 1] : row;
    const double furthest_degc = std::max(kFastest_degc, kFastest_degc_s * (t_s[row] - t_s[last]));
    if (k == 0 || std::fabs(temp_degc[row] - temp_degc[last]) > furthest_degc) pieces.emplace_back();
    pieces.back().push_back(row);
  }
  return pieces;
}

} // namespace

RepeatedReadings repeated_readings(const std::vector<long>& ticks, const std::vector<double>& temp_degc) {
  std::vector<long> rows; // ticks at which the reading changes
  std::vector<double> sizes, readings;
  for (size_t i = 0; i < ticks.size(); ++i) {
    if (!std::isfinite(temp_degc[i])) continue;
    const double change = readings.empty() ? 0 : std::fabs(temp_degc[i] - readings.back());
    if (change > 0) rows.push_back(ticks[i]), sizes.push_back(change);
    readings.push_back(temp_degc[i]);
  }
  if (rows.size() < kFewestReadings || kShortestRepeat * rows.size() > readings.size()) return {};
  if (median(sizes) < kBeyondStep * least_distance(readings)) return {}; // one step of a converter
  const double enough = kOnGrid * static_cast<double>(rows.size());
  const long at_most = std::min(kLongestRepeat, (ticks.back() - ticks.front()) / static_cast<long>(kFewestReadings));
  RepeatedReadings out;
  for (long every = kShortestRepeat; every <= at_most; ++every) {
    std::vector<size_t> at(static_cast<size_t>(every), 0);
    for (const long row : rows) ++at[static_cast<size_t>(row % every)];
    const auto most = std::max_element(at.begin(), at.end());
    if (static_cast<double>(*most) >= enough) out = {every, most - at.begin()};
  }
  return out;
}

ImpossibleReadings impossible_readings(const std::vector<double>& t_s, const std::vector<double>& temp_degc) {
  ImpossibleReadings out;
  std::vector<size_t> rows, right;
  for (size_t row = 0; row < temp_degc.size(); ++row)
    if (std::isfinite(temp_degc[row])) rows.push_back(row);
  for (const std::vector<size_t>& piece : cut_at_jumps(t_s, temp_degc, rows)) {
    std::vector<size_t>& to = piece.size() > kMostWrong ? right : out.wrong;
    to.insert(to.end(), piece.begin(), piece.end());
  }
  if (right.empty()) return {}; // readings that jump all the time are no thermometer's
  for (const std::vector<size_t>& piece : cut_at_jumps(t_s, temp_degc, right))
    if (piece.front() != right.front()) out.pauses.push_back(piece.front());
  return out;
}

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
