// SPDX-License-Identifier: MIT
#include "analysis/errormodel/lp.h"

#include <coin/Clp_C_Interface.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <stdexcept>

namespace imucal {

namespace {

constexpr double kFeasible = 1e-9;

// Values A x per row.
void evaluate(const std::vector<const double*>& columns, const std::vector<double>& x, size_t n_rows,
              std::vector<double>* out) {
  out->assign(n_rows, 0.0);
  for (size_t j = 0; j < columns.size(); ++j)
    if (x[j] != 0)
      for (size_t i = 0; i < n_rows; ++i) (*out)[i] += columns[j][i] * x[j];
}

BoundingSolution finish(const std::vector<const double*>& columns, std::vector<double> x, size_t n_rows) {
  std::vector<double> value;
  evaluate(columns, x, n_rows, &value);
  const double least = *std::min_element(value.begin(), value.end());
  BoundingSolution s;
  if (!(least > 0)) {
    s.x = std::move(x);
    s.objective = std::numeric_limits<double>::infinity();
    return s;
  }
  for (double& v : x) v /= std::min(1.0, least);
  s.objective = -static_cast<double>(n_rows);
  for (double v : value) s.objective += v / std::min(1.0, least);
  s.x = std::move(x);
  return s;
}

// Local minima of the rows below 1: one row per violated stretch.
std::vector<size_t> violated_rows(const std::vector<double>& value, double limit) {
  std::vector<size_t> rows;
  for (size_t i = 0; i < value.size();) {
    if (value[i] >= 1 - limit) {
      ++i;
      continue;
    }
    size_t least = i;
    for (; i < value.size() && value[i] < 1 - limit; ++i)
      if (value[i] < value[least]) least = i;
    rows.push_back(least);
  }
  return rows;
}

// minimise c'x, A x >= 1, x >= 0 over the given rows, as its dual: maximise sum y, A'y <= c, y >= 0.  c > 0 makes y = 0
// feasible, so a tableau simplex starts at once; the x are the dual prices.
class SmallSimplex {
public:
  SmallSimplex(const std::vector<const double*>& columns, const std::vector<double>& cost,
               const std::vector<size_t>& rows)
      : cost_(cost), m_(columns.size()), k_(rows.size()), width_(k_ + m_ + 1), table_((m_ + 1) * width_, 0.0),
        basic_(m_) {
    for (size_t j = 0; j < m_; ++j) {
      for (size_t i = 0; i < k_; ++i) at(j, i) = columns[j][rows[i]] / cost[j];
      at(j, k_ + j) = 1;
      at(j, width_ - 1) = 1;
      basic_[j] = k_ + j;
    }
    for (size_t i = 0; i < k_; ++i) at(m_, i) = -1;
  }
  // False: some row has no component, or no end after 2000 steps.
  bool solve(std::vector<double>* x) {
    for (int step = 0; step < 2000; ++step) {
      const size_t enter = entering(step > kStepsBeforeBland);
      if (enter == width_) {
        for (size_t j = 0; j < m_; ++j) (*x)[j] = std::max(0.0, at(m_, k_ + j) / cost_[j]);
        return true;
      }
      const size_t leave = leaving(enter);
      if (leave == m_) return false;
      pivot(leave, enter);
    }
    return false;
  }

private:
  static constexpr int kStepsBeforeBland = 200; // then cycling could be at hand

  double& at(size_t row, size_t column) { return table_[row * width_ + column]; }
  // The column of the steepest gain; by Bland's rule the first that gains; width_: none does.
  size_t entering(bool by_bland) {
    size_t enter = width_;
    double best = -1e-12;
    for (size_t c = 0; c + 1 < width_; ++c)
      if (at(m_, c) < best) {
        enter = c;
        if (by_bland) break;
        best = at(m_, c);
      }
    return enter;
  }
  size_t leaving(size_t enter) {
    size_t leave = m_;
    double least = std::numeric_limits<double>::infinity();
    for (size_t j = 0; j < m_; ++j)
      if (at(j, enter) > 1e-13) {
        const double ratio = at(j, width_ - 1) / at(j, enter);
        if (ratio < least - 1e-15 || (ratio <= least + 1e-15 && leave < m_ && basic_[j] < basic_[leave]))
          least = ratio, leave = j;
      }
    return leave;
  }
  void pivot(size_t leave, size_t enter) {
    const double value = at(leave, enter);
    for (size_t c = 0; c < width_; ++c) at(leave, c) /= value;
    for (size_t j = 0; j <= m_; ++j) {
      const double factor = at(j, enter);
      if (j == leave || factor == 0) continue;
      for (size_t c = 0; c < width_; ++c) at(j, c) -= factor * at(leave, c);
    }
    basic_[leave] = enter;
  }

  const std::vector<double>& cost_;
  size_t m_, k_, width_;
  std::vector<double> table_;
  std::vector<size_t> basic_;
};

} // namespace

BoundingSolution solve_bounding_small(const std::vector<const double*>& columns, size_t n_rows) {
  std::vector<double> cost(columns.size(), 0.0), x(columns.size(), 0.0), value;
  for (size_t j = 0; j < columns.size(); ++j)
    for (size_t i = 0; i < n_rows; ++i) cost[j] += columns[j][i];
  std::vector<size_t> rows;
  for (size_t k = 0; k <= 6; ++k) rows.push_back(k * (n_rows - 1) / 6);
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  for (int round = 0; round < 60; ++round) {
    if (!SmallSimplex(columns, cost, rows).solve(&x)) break;
    evaluate(columns, x, n_rows, &value);
    const auto more = violated_rows(value, kFeasible);
    if (more.empty()) break;
    rows.insert(rows.end(), more.begin(), more.end());
  }
  return finish(columns, x, n_rows);
}

namespace {

// A linear program in Clp that grows by rows: minimise sum x, rows >= 1, x >= 0.
class GrowingProgram {
public:
  explicit GrowingProgram(size_t n_columns) : lp_(Clp_newModel()), index_(n_columns) {
    for (size_t j = 0; j < n_columns; ++j) index_[j] = static_cast<int>(j);
    const std::vector<CoinBigIndex> starts(n_columns + 1, 0);
    const std::vector<double> cost(n_columns, 1.0);
    Clp_setLogLevel(lp_.get(), 0);
    Clp_loadProblem(lp_.get(), static_cast<int>(n_columns), 0, starts.data(), nullptr, nullptr, nullptr, nullptr,
                    cost.data(), nullptr, nullptr);
    Clp_setPrimalTolerance(lp_.get(), kFeasible);
    Clp_setDualTolerance(lp_.get(), kFeasible);
  }
  void add(const std::vector<double>& row) {
    const double lower = 1, upper = std::numeric_limits<double>::max();
    const CoinBigIndex starts[2] = {0, static_cast<CoinBigIndex>(row.size())};
    Clp_addRows(lp_.get(), 1, &lower, &upper, starts, index_.data(), row.data());
  }
  // Valid until the next call.  The dual method goes on from the last optimum: a new row keeps it dual feasible.
  const double* solve() {
    if (Clp_dual(lp_.get(), 0) != 0) throw std::runtime_error("the bounding program has no solution");
    return Clp_primalColumnSolution(lp_.get());
  }

private:
  struct Delete {
    void operator()(Clp_Simplex* lp) const { Clp_deleteModel(lp); }
  };
  std::unique_ptr<Clp_Simplex, Delete> lp_;
  std::vector<int> index_;
};

// Columns scaled to a mean of one: variances of very different size.
std::vector<double> scales(const BoundingProgram& program) {
  std::vector<double> out;
  for (const auto& column : program.columns)
    out.push_back(static_cast<double>(column.size()) / std::accumulate(column.begin(), column.end(), 0.0));
  return out;
}

} // namespace

BoundingSolution solve_bounding(const BoundingProgram& program) {
  const size_t n_columns = program.columns.size(), n_rows = program.columns.at(0).size();
  const std::vector<double> scale = scales(program);
  std::vector<const double*> columns;
  for (const auto& c : program.columns) columns.push_back(c.data());
  std::vector<double> row(n_columns), x(n_columns, 0.0), value;
  GrowingProgram lp(n_columns);
  const auto add = [&](size_t i) {
    for (size_t j = 0; j < n_columns; ++j) row[j] = columns[j][i] * scale[j];
    lp.add(row);
  };
  const size_t first = std::min<size_t>(n_rows, 12);
  for (size_t k = 0; k < first; ++k) add(first > 1 ? k * (n_rows - 1) / (first - 1) : 0);
  for (int round = 0; round < 200; ++round) {
    const double* solution = lp.solve();
    for (size_t j = 0; j < n_columns; ++j) x[j] = std::max(0.0, solution[j]) * scale[j];
    evaluate(columns, x, n_rows, &value);
    const auto more = violated_rows(value, 1e-8);
    if (more.empty()) break;
    for (size_t i : more) add(i);
  }
  return finish(columns, x, n_rows);
}

} // namespace imucal
