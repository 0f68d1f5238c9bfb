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
constexpr double kShortestRepeat = 3, kLongestRepeat = 600; // rows
constexpr double kOnGrid = 0.95;              // of the steps between changes are whole times of one period,
constexpr double kARow = 1.01, kNoRow = 0.25; // to a row, where that says something and no converter's steps are near
constexpr double kLooseRepeat = 10, kFarBeyondStep = 3;
constexpr int kRefinements = 3;
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

namespace {

// Steps of time that are whole times of one period: the period, to which it is refined from `guess`; 0: too few of them are.
double period_of(const std::vector<long>& steps, double guess, double tolerance) {
  double period = guess, on_it = 0;
  for (int pass = 0; pass < kRefinements; ++pass) {
    double sum = 0, times = 0;
    on_it = 0;
    for (const long step : steps) {
      const double n = std::max(1.0, std::round(static_cast<double>(step) / period));
      if (std::fabs(static_cast<double>(step) - n * period) > tolerance) continue;
      sum += static_cast<double>(step), times += n, on_it += 1;
    }
    if (on_it == 0) return 0;
    period = sum / times;
  }
  return on_it >= kOnGrid * static_cast<double>(steps.size()) ? period : 0;
}
// Where a reading is new: where it changes, and, between two changes, where it would have.
std::vector<size_t> new_readings(const std::vector<long>& ticks, const std::vector<size_t>& changes, double period) {
  std::vector<size_t> rows = {0};
  for (size_t k = 0; k < changes.size(); ++k) {
    const size_t last = rows.back(), next = changes[k];
    const double n = std::round(static_cast<double>(ticks[next] - ticks[last]) / period);
    for (int i = 1; k > 0 && i < n; ++i) {
      const double at = static_cast<double>(ticks[last]) + i * static_cast<double>(ticks[next] - ticks[last]) / n;
      const auto row = std::lower_bound(ticks.begin(), ticks.end(), std::lround(at)) - ticks.begin();
      if (static_cast<size_t>(row) > rows.back() && static_cast<size_t>(row) < next)
        rows.push_back(static_cast<size_t>(row));
    }
    if (next > rows.back()) rows.push_back(next);
  }
  return rows;
}

} // namespace

RepeatedReadings repeated_readings(const std::vector<long>& ticks, const std::vector<double>& temp_degc) {
  std::vector<size_t> changes; // rows
  std::vector<double> sizes, readings, lengths;
  std::vector<long> steps;
  for (size_t i = 0; i < ticks.size(); ++i) {
    if (!std::isfinite(temp_degc[i])) continue;
    const double change = readings.empty() ? 0 : std::fabs(temp_degc[i] - readings.back());
    readings.push_back(temp_degc[i]);
    if (!(change > 0)) continue;
    if (!changes.empty())
      steps.push_back(ticks[i] - ticks[changes.back()]), lengths.push_back(static_cast<double>(steps.back()));
    changes.push_back(i), sizes.push_back(change);
  }
  if (changes.size() < kFewestReadings ||
      kShortestRepeat * static_cast<double>(changes.size()) > static_cast<double>(readings.size()))
    return {};
  const double beyond = median(sizes) / least_distance(readings);
  if (beyond < kBeyondStep) return {}; // one step of a converter
  const double usual = median(lengths);
  for (const double parts : {1.0, 2.0, 3.0}) {
    const double guess = usual / parts;
    if (guess < kShortestRepeat || guess > kLongestRepeat) continue;
    const bool is_loose = guess >= kLooseRepeat && beyond > kFarBeyondStep;
    const double period = period_of(steps, guess, is_loose ? kARow : kNoRow);
    if (period > 0) return {period, new_readings(ticks, changes, period)};
  }
  return {};
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
