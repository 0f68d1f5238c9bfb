// SPDX-License-Identifier: MIT
#include "physics/effects/estimation.h"

#include <algorithm>

namespace imucal {

namespace {

template <class T> std::vector<T> rows_of(const std::vector<T>& column, size_t first, size_t end) {
  if (column.empty()) return {};
  return {column.begin() + static_cast<long>(first), column.begin() + static_cast<long>(end)};
}
// Rows [first, end) as a run of their own.
RunInput part_of(const RunInput& run, size_t first, size_t end) {
  RunInput part;
  part.log = run.log, part.dt_s = run.dt_s, part.t0_degc = run.t0_degc, part.range_degc = run.range_degc;
  part.start_halvings = run.start_halvings;
  part.path_degc = rows_of(run.path_degc, first * run.path_per_row, end * run.path_per_row);
  part.path_per_row = run.path_per_row;
  part.t_s = rows_of(run.t_s, first, end), part.tick = rows_of(run.tick, first, end);
  for (double& t : part.t_s) t -= run.t_s[first];
  for (long& tick : part.tick) tick -= run.tick[first];
  part.temp_degc = rows_of(run.temp_degc, first, end), part.smooth_degc = rows_of(run.smooth_degc, first, end);
  part.rate_degc_min = rows_of(run.rate_degc_min, first, end), part.tn = rows_of(run.tn, first, end);
  part.rate_dph = rows_of(run.rate_dph, first, end);
  for (const auto& [name, values] : run.auxiliary) part.auxiliary[name] = rows_of(values, first, end);
  return part;
}

} // namespace

std::vector<Column> free_states(const EffectEstimator& effect, const RunInput& run, const Theta& shape) {
  if (run.restarts.empty()) return effect.start_columns(run, shape);
  std::vector<size_t> edges = {0};
  edges.insert(edges.end(), run.restarts.begin(), run.restarts.end());
  edges.push_back(run.size());
  std::vector<Column> out;
  for (size_t k = 0; k + 1 < edges.size(); ++k) {
    if (edges[k] >= edges[k + 1]) continue;
    for (const Column& own : effect.start_columns(part_of(run, edges[k], edges[k + 1]), shape)) {
      out.emplace_back(run.size(), 0.0);
      std::copy(own.begin(), own.end(), out.back().begin() + static_cast<long>(edges[k]));
    }
  }
  return out;
}

} // namespace imucal
