// SPDX-License-Identifier: MIT
#include "analysis/fit/renewal.h"

#include <algorithm>
#include <cmath>

#include "base/format.h"
#include "base/median.h"

namespace imucal {

namespace {

constexpr double kFarQuanta = 10; // of one move
constexpr size_t kFewestMoves = 10;
constexpr double kHeldRows = 0.6;  // part of the rows in holds: every third second may be a mixed one
constexpr double kFarTravel = 0.8; // part of all travel that far moves make
constexpr size_t kFewestLevels = 8;
constexpr double kOffLattice = 0.75;     // quanta: a level of a converter is rounded to half a quantum
constexpr double kMostOffLattice = 0.01; // part of a converter's levels
constexpr size_t kBins = 16;
constexpr double kLeastHalf_s = 32; // half of the stretch over which dT/dt is taken

// Rows with one and the same reading, at least two.
struct Held {
  double degc, first_s, last_s;
};

// A move from one held reading to the next, with at most one second between them that saw both.
struct Move {
  size_t to; // place in the holds
  double degc;
};

std::vector<Held> holds_of(const std::vector<double>& t_s, const std::vector<double>& temp_degc, size_t* n_rows) {
  std::vector<Held> holds;
  for (size_t first = 0, end = 0; first < t_s.size(); first = end) {
    for (end = first + 1; end < t_s.size() && temp_degc[end] == temp_degc[first] && t_s[end] - t_s[end - 1] < 1.5;)
      ++end;
    if (end - first < 2) continue;
    holds.push_back({temp_degc[first], t_s[first], t_s[end - 1]});
    *n_rows += end - first;
  }
  return holds;
}

std::vector<Move> far_moves(const std::vector<Held>& holds, double quantum_degc) {
  std::vector<Move> moves;
  for (size_t k = 1; k < holds.size(); ++k) {
    const double degc = std::abs(holds[k].degc - holds[k - 1].degc);
    if (degc > (kFarQuanta - 0.5) * quantum_degc && holds[k].first_s - holds[k - 1].last_s < 2.5)
      moves.push_back({k, degc});
  }
  return moves;
}

double total_travel(const std::vector<double>& temp_degc) {
  double travel = 0;
  for (size_t k = 1; k < temp_degc.size(); ++k) travel += std::abs(temp_degc[k] - temp_degc[k - 1]);
  return travel;
}

// Different readings, in increasing order; of holds of three rows where most are, for two rows alike may be a mixture, twice.
std::vector<double> levels_of(const std::vector<Held>& holds) {
  const auto is_long = [](const Held& hold) { return hold.last_s - hold.first_s > 1.5; };
  const bool are_most = 2 * std::count_if(holds.begin(), holds.end(), is_long) > static_cast<long>(holds.size());
  std::vector<double> levels;
  for (const Held& hold : holds)
    if (!are_most || is_long(hold)) levels.push_back(hold.degc);
  std::sort(levels.begin(), levels.end());
  levels.erase(std::unique(levels.begin(), levels.end()), levels.end());
  return levels;
}

// How many levels lie off the lattice of about this pitch: a line through the levels over their places.
double off_lattice(const std::vector<double>& levels, double pitch_degc, double quantum_degc) {
  std::vector<double> place = {0};
  for (size_t k = 1; k < levels.size(); ++k)
    place.push_back(place.back() + std::round((levels[k] - levels[k - 1]) / pitch_degc));
  double mean_place = 0, mean_degc = 0, both = 0, squares = 0;
  const auto n = static_cast<double>(levels.size());
  for (size_t k = 0; k < levels.size(); ++k) mean_place += place[k] / n, mean_degc += levels[k] / n;
  for (size_t k = 0; k < levels.size(); ++k) {
    both += (place[k] - mean_place) * (levels[k] - mean_degc);
    squares += (place[k] - mean_place) * (place[k] - mean_place);
  }
  const double slope = squares > 0 ? both / squares : 0;
  double n_off = 0;
  for (size_t k = 0; k < levels.size(); ++k)
    n_off += std::abs(levels[k] - mean_degc - slope * (place[k] - mean_place)) > kOffLattice * quantum_degc;
  return n_off;
}

// All readings lie on one lattice, as those of a converter do; its pitch is a usual move, or the usual or the least distance
// of two.
bool is_converter(const std::vector<Held>& holds, double usual_move_degc, double quantum_degc) {
  const std::vector<double> levels = levels_of(holds);
  if (levels.size() < kFewestLevels) return true;
  std::vector<double> steps;
  for (size_t k = 1; k < levels.size(); ++k) steps.push_back(levels[k] - levels[k - 1]);
  const double most = std::max(1.0, kMostOffLattice * static_cast<double>(levels.size()));
  for (const double pitch_degc : {usual_move_degc, median(steps), *std::min_element(steps.begin(), steps.end())})
    if (pitch_degc > (kFarQuanta - 0.5) * quantum_degc && off_lattice(levels, pitch_degc, quantum_degc) <= most)
      return true;
  return false;
}

// Mean time between two moves in a row, of those that are within a row of the usual one.
double period_of(const std::vector<Held>& holds, const std::vector<Move>& moves) {
  std::vector<double> times;
  for (size_t m = 1; m < moves.size(); ++m)
    if (moves[m].to == moves[m - 1].to + 1)
      times.push_back(holds[moves[m].to].first_s - holds[moves[m - 1].to].first_s);
  if (times.empty()) return 0;
  const double usual = median(times);
  double sum = 0, n = 0;
  for (const double time : times)
    if (std::abs(time - usual) < 1.5) sum += time, ++n;
  return sum / n;
}

} // namespace

Renewal thermometer_renewal(const std::vector<double>& t_s, const std::vector<double>& temp_degc,
                            double degc_per_count) {
  size_t n_held = 0;
  const std::vector<Held> holds = holds_of(t_s, temp_degc, &n_held);
  const std::vector<Move> moves = far_moves(holds, degc_per_count);
  if (moves.size() < kFewestMoves || static_cast<double>(n_held) < kHeldRows * static_cast<double>(t_s.size()))
    return {};
  double travel = 0;
  std::vector<double> sizes;
  for (const Move& move : moves) travel += move.degc, sizes.push_back(move.degc);
  if (travel < kFarTravel * total_travel(temp_degc)) return {};
  const double usual_degc = median(sizes);
  if (is_converter(holds, usual_degc, degc_per_count)) return {};
  return {period_of(holds, moves), usual_degc};
}

double renewal_cost(const Renewal& renewal, const std::vector<double>& t_s, const std::vector<double>& temp_degc,
                    const std::vector<double>& coeff, double t0_degc, double range_degc) {
  struct Bin {
    double n = 0, temp_degc = 0, ramp_degc_per_s = 0;
  };
  if (renewal.every_s <= 0) return 0;
  const auto [lo, hi] = std::minmax_element(temp_degc.begin(), temp_degc.end());
  const double half_s = std::max(kLeastHalf_s, 2 * renewal.every_s);
  std::vector<Bin> bins(kBins);
  for (size_t k = 0, a = 0, b = 0; k < t_s.size(); ++k) {
    while (t_s[a] < t_s[k] - half_s) ++a;
    while (b + 1 < t_s.size() && t_s[b + 1] <= t_s[k] + half_s) ++b;
    if (b == a) continue;
    const double place = (temp_degc[k] - *lo) / std::max(1e-9, *hi - *lo);
    Bin& bin = bins[std::min(kBins - 1, static_cast<size_t>(place * kBins))];
    bin.n += 1;
    bin.temp_degc += temp_degc[k];
    bin.ramp_degc_per_s += (temp_degc[b] - temp_degc[a]) / (t_s[b] - t_s[a]);
  }
  double most = 0;
  for (const Bin& bin : bins) {
    if (bin.n == 0) continue;
    const double tn = (bin.temp_degc / bin.n - t0_degc) / range_degc;
    double slope = 0, power = 1;
    for (size_t i = 1; i < coeff.size(); ++i, power *= tn) slope += static_cast<double>(i) * coeff[i] * power;
    most = std::max(most, std::abs(slope / range_degc * bin.ramp_degc_per_s / bin.n) * renewal.delay_s());
  }
  return most;
}

std::string renewal_text(const Renewal& renewal, double cost, double predicted, const std::string& unit) {
  return format(
      "the thermometer is renewed only every %.3g s, by %.3g degC at a time: %.3g s of delay may have cost %.3g %s on "
      "these ramps (predicted error %.3g); read it at least once a second, or ramp more slowly (if its steps are "
      "that coarse, declare them: degc_per_count)",
      renewal.every_s, renewal.move_degc, renewal.delay_s(), cost, unit.c_str(), predicted);
}

} // namespace imucal
