// SPDX-License-Identifier: MIT
#include "physics/effects/lattice.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "physics/effects/sample_shape.h"

namespace imucal {
namespace {

constexpr size_t kFewestSamples = 200, kFewestValues = 3;
constexpr double kMostValues = 0.5; // per sample: rates with more digits than samples show no steps
constexpr double kFarSteps = 5.5;   // between neighbours that are so far apart a step is not known well enough
constexpr double kOffStep = 0.05;   // of a step: digits of a file that are few beside it
constexpr double kMostOff = 0.02, kFewestNear = 0.5; // of the gaps
constexpr double kSameStep = 0.01;                   // relative

// Between neighbours of the values that are found, in order of size.
std::vector<double> gaps_of(const std::vector<std::pair<double, size_t>>& found) {
  std::vector<double> out;
  for (size_t i = 1; i < found.size(); ++i) out.push_back(found[i].first - found[i - 1].first);
  return out;
}
bool are_whole_steps(const std::vector<double>& gaps, double step) {
  double near = 0, off = 0;
  for (const double gap : gaps) {
    if (gap > kFarSteps * step) continue;
    const double steps = std::round(gap / step);
    near += 1, off += steps < 1 || std::fabs(gap / step - steps) > kOffStep;
  }
  return near > 0 && near >= kFewestNear * static_cast<double>(gaps.size()) && off <= kMostOff * near;
}
// From gaps that are one step or few, of which the smallest is the first guess.
double refined(const std::vector<double>& gaps, double step) {
  double length = 0, steps = 0;
  for (const double gap : gaps)
    if (gap <= kFarSteps * step) length += gap, steps += std::round(gap / step);
  return length / steps;
}
double step_of(std::vector<double> rates) {
  const double n = static_cast<double>(rates.size());
  const std::vector<std::pair<double, size_t>> found = values_with_counts(std::move(rates));
  if (n < kFewestSamples || found.size() < kFewestValues || static_cast<double>(found.size()) > kMostValues * n)
    return 0;
  const std::vector<double> gaps = gaps_of(found);
  const double step = refined(gaps, *std::min_element(gaps.begin(), gaps.end()));
  return are_whole_steps(gaps, step) ? step : 0;
}
bool lies_on(const RunInput& run, double step) {
  return are_whole_steps(gaps_of(values_with_counts(finite_rates(run))), step);
}

template <class F> void add_where(F is_it, size_t r, std::vector<Lattice>* list) {
  const auto it = std::find_if(list->begin(), list->end(), is_it);
  if (it != list->end()) it->runs.push_back(r);
}

} // namespace

std::vector<Lattice> lattices(const std::vector<RunInput>& runs) {
  std::vector<Lattice> out;
  std::vector<size_t> open;
  for (size_t r = 0; r < runs.size(); ++r) {
    const double step = step_of(finite_rates(runs[r]));
    const auto is_same = [&](const Lattice& l) { return std::fabs(l.step_dph - step) <= kSameStep * l.step_dph; };
    if (!(step > 0))
      open.push_back(r);
    else if (std::none_of(out.begin(), out.end(), is_same))
      out.push_back({step, {r}});
    else
      add_where(is_same, r, &out);
  }
  for (const size_t r : open) add_where([&](const Lattice& l) { return lies_on(runs[r], l.step_dph); }, r, &out);
  for (Lattice& l : out) std::sort(l.runs.begin(), l.runs.end());
  if (!out.empty()) return out;
  if (const double step = step_of(finite_rates(runs)); step > 0) out.push_back({step, std::move(open)});
  return out;
}

} // namespace imucal
