// SPDX-License-Identifier: MIT
#include "analysis/errormodel/lp.h"

#include <glpk.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>

namespace imucal {

namespace {

constexpr double kFeasible = 1e-9;

struct DeleteProgram {
  void operator()(glp_prob* p) const { glp_delete_prob(p); }
};

// Values A x per row.
void evaluate(const std::vector<const double*>& columns, const std::vector<double>& x, size_t n_rows, std::vector<double>* out) {
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
// feasible, so a tableau simplex starts at once; the x are the dual prices.  Bland's rule.
bool small_simplex(const std::vector<const double*>& columns, const std::vector<double>& cost, const std::vector<size_t>& rows,
                   std::vector<double>* x) {
  const size_t m = columns.size(), k = rows.size(), width = k + m + 1;
  std::vector<double> table((m + 1) * width, 0.0);
  const auto at = [&](size_t r, size_t c) -> double& { return table[r * width + c]; };
  std::vector<size_t> basic(m);
  for (size_t j = 0; j < m; ++j) {
    for (size_t i = 0; i < k; ++i) at(j, i) = columns[j][rows[i]] / cost[j];
    at(j, k + j) = 1;
    at(j, width - 1) = 1;
    basic[j] = k + j;
  }
  for (size_t i = 0; i < k; ++i) at(m, i) = -1;
  for (int step = 0; step < 2000; ++step) {
    size_t enter = width;
    double best = -1e-12;
    for (size_t c = 0; c + 1 < width; ++c)
      if (at(m, c) < best) {
        enter = c;
        if (step > 200) break;  // Bland once cycling could be at hand
        best = at(m, c);
      }
    if (enter == width) {
      for (size_t j = 0; j < m; ++j) (*x)[j] = std::max(0.0, at(m, k + j) / cost[j]);
      return true;
    }
    size_t leave = m;
    double least = std::numeric_limits<double>::infinity();
    for (size_t j = 0; j < m; ++j)
      if (at(j, enter) > 1e-13) {
        const double ratio = at(j, width - 1) / at(j, enter);
        if (ratio < least - 1e-15 || (ratio <= least + 1e-15 && leave < m && basic[j] < basic[leave])) least = ratio, leave = j;
      }
    if (leave == m) return false;  // unbounded dual: some row has no component
    const double pivot = at(leave, enter);
    for (size_t c = 0; c < width; ++c) at(leave, c) /= pivot;
    for (size_t j = 0; j <= m; ++j) {
      if (j == leave) continue;
      const double factor = at(j, enter);
      if (factor == 0) continue;
      for (size_t c = 0; c < width; ++c) at(j, c) -= factor * at(leave, c);
    }
    basic[leave] = enter;
  }
  return false;
}

}  // namespace

BoundingSolution solve_bounding_small(const std::vector<const double*>& columns, size_t n_rows) {
  std::vector<double> cost(columns.size(), 0.0), x(columns.size(), 0.0), value;
  for (size_t j = 0; j < columns.size(); ++j)
    for (size_t i = 0; i < n_rows; ++i) cost[j] += columns[j][i];
  std::vector<size_t> rows;
  for (size_t k = 0; k <= 6; ++k) rows.push_back(k * (n_rows - 1) / 6);
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  for (int round = 0; round < 60; ++round) {
    if (!small_simplex(columns, cost, rows, &x)) break;
    evaluate(columns, x, n_rows, &value);
    const auto more = violated_rows(value, kFeasible);
    if (more.empty()) break;
    rows.insert(rows.end(), more.begin(), more.end());
  }
  return finish(columns, x, n_rows);
}

BoundingSolution solve_bounding(const BoundingProgram& program) {
  const size_t n_columns = program.columns.size(), n_rows = program.columns.at(0).size();
  std::vector<const double*> columns;
  for (const auto& c : program.columns) columns.push_back(c.data());
  const std::unique_ptr<glp_prob, DeleteProgram> lp(glp_create_prob());
  glp_set_obj_dir(lp.get(), GLP_MIN);
  glp_add_cols(lp.get(), static_cast<int>(n_columns));
  // Columns scaled to a mean of one: variances of very different size.
  std::vector<double> scale(n_columns);
  for (size_t j = 0; j < n_columns; ++j) {
    double sum = 0;
    for (double v : program.columns[j]) sum += v;
    scale[j] = static_cast<double>(n_rows) / sum;
    glp_set_col_bnds(lp.get(), static_cast<int>(j) + 1, GLP_LO, 0, 0);
    glp_set_obj_coef(lp.get(), static_cast<int>(j) + 1, 1);
  }
  std::vector<int> index(n_columns + 1);
  std::vector<double> row(n_columns + 1), x(n_columns, 0.0), value;
  for (size_t j = 0; j < n_columns; ++j) index[j + 1] = static_cast<int>(j) + 1;
  const auto add = [&](size_t i) {
    for (size_t j = 0; j < n_columns; ++j) row[j + 1] = program.columns[j][i] * scale[j];
    const int r = glp_add_rows(lp.get(), 1);
    glp_set_row_bnds(lp.get(), r, GLP_LO, 1, 0);
    glp_set_mat_row(lp.get(), r, static_cast<int>(n_columns), index.data(), row.data());
  };
  const size_t first = std::min<size_t>(n_rows, 12);
  for (size_t k = 0; k < first; ++k) add(first > 1 ? k * (n_rows - 1) / (first - 1) : 0);
  glp_smcp options;
  glp_init_smcp(&options);
  options.msg_lev = GLP_MSG_OFF;
  options.meth = GLP_DUALP;
  options.tol_bnd = 1e-9, options.tol_dj = 1e-9;
  for (int round = 0; round < 200; ++round) {
    if (glp_simplex(lp.get(), &options) != 0 || glp_get_status(lp.get()) != GLP_OPT)
      throw std::runtime_error("the bounding program has no solution");
    for (size_t j = 0; j < n_columns; ++j)
      x[j] = std::max(0.0, glp_get_col_prim(lp.get(), static_cast<int>(j) + 1)) * scale[j];
    evaluate(columns, x, n_rows, &value);
    const auto more = violated_rows(value, 1e-8);
    if (more.empty()) break;
    for (size_t i : more) add(i);
  }
  return finish(columns, x, n_rows);
}

}  // namespace imucal
