// SPDX-License-Identifier: MIT
#include "analysis/diagnose/search/slow_polish.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/evidence/fit.h"
#include "analysis/diagnose/evidence/maximise.h"

namespace imucal {

namespace {

constexpr int kPasses = 3;     // of neighbours of a shape
constexpr int kJumpLevels = 4; // of neighbours, each level a quarter as far apart
constexpr double kNearBound = 0.01, kNearInRange = 1e-3;

struct PolishAxis {
  double* value;
  double step, lo, hi;
  bool is_log;
};
// First step of a shape parameter: half the way to the next value of the grid that was scanned.
double first_step(const Candidate& c, size_t i, double value) {
  double nearest = 1e300;
  for (const Theta& shape : c.scan.shapes)
    if (const double way = std::fabs(shape[i] - value); way > 1e-9) nearest = std::min(nearest, way);
  const double usual = 0.15 * std::fabs(value);
  return std::max(0.05, nearest < 1e299 ? 0.5 * nearest : usual);
}
std::vector<PolishAxis> axes_of_noise(SlowModel* m) {
  std::vector<PolishAxis> axes;
  if (!m->is_believed)
    for (double& x : m->log_noise) axes.push_back({&x, 0.4, -15, 15, false});
  if (m->noise_effect) {
    const EffectEstimator& e = *m->noise_effect->estimator();
    for (size_t i = 0; i < m->noise_theta.size(); ++i)
      axes.push_back(
          {&m->noise_theta[i], e.is_logarithmic() ? 0.4 : 0.3, e.theta_lo()[i], e.theta_hi()[i], e.is_logarithmic()});
  }
  return axes;
}
std::vector<PolishAxis> axes_of(const SlowLikelihood& of, SlowModel* m) {
  std::vector<PolishAxis> axes = axes_of_noise(m);
  for (SlowModel::Name& name : m->names) {
    const EffectEstimator& e = *of.space().candidates[name.candidate].scan.estimator;
    const double near_s = EffectEstimator::kNearby_s;
    if (e.is_near_thermometer()) axes.push_back({&name.shape.back(), 0.25 * near_s, -near_s, near_s, false});
    if (!of.space().candidates[name.candidate].effect || !e.is_refined(name.shape)) continue;
    for (size_t i = 0; i < e.shape_lo().size(); ++i)
      axes.push_back({&name.shape[i], first_step(of.space().candidates[name.candidate], i, name.shape[i]),
                      e.shape_lo()[i], e.shape_hi()[i], false});
  }
  return axes;
}
// By a simplex from where they are; returns the largest value.
template <class Value> double climb(const std::vector<PolishAxis>& axes, int evaluations, const Value& value) {
  Theta x, lo, hi;
  for (const PolishAxis& a : axes) {
    const auto inward = [&](double v) { return (a.is_log ? std::log(v) : v) / a.step; };
    x.push_back(inward(*a.value)), lo.push_back(inward(a.lo)), hi.push_back(inward(a.hi));
  }
  const auto set = [&](const Theta& at) {
    for (size_t i = 0; i < axes.size(); ++i)
      *axes[i].value = axes[i].is_log ? std::exp(at[i] * axes[i].step) : at[i] * axes[i].step;
  };
  if (!axes.empty()) {
    SearchOptions options;
    options.step = 1, options.max_evaluations = evaluations, options.tolerance = 0.02;
    maximise(
        [&](const Theta& at) {
          set(at);
          return value();
        },
        &x, lo, hi, options);
    set(x);
  }
  return value();
}
// Within a hundredth of the bound itself, or a thousandth of the range: a search seldom ends at the very bound.  A lower bound
// of zero is where the physics ends, not where the search does.
bool is_near_bound(double value, double lo, double hi) {
  const auto margin = [&](double bound) { return std::max(kNearBound * std::fabs(bound), kNearInRange * (hi - lo)); };
  return (lo != 0 && value < lo + margin(lo)) || value > hi - margin(hi);
}
void mark_bounds(const SlowLikelihood& of, SlowModel* m) {
  for (SlowModel::Name& name : m->names) {
    const EffectEstimator& e = *of.space().candidates[name.candidate].scan.estimator;
    name.is_at_bound = !e.is_shown_in(of.space().longest_log_s(), name.shape);
    if (!of.space().candidates[name.candidate].effect || !e.is_refined(name.shape)) continue;
    for (size_t i = 0; i < e.shape_lo().size(); ++i)
      if (is_near_bound(name.shape[i], e.shape_lo()[i], e.shape_hi()[i])) name.is_at_bound = true;
  }
}
// A shape found between the places of the grid is one of many more.  The mean of the likelihood over shapes is that
// over the grid and, in the cell about the shape, that over its neighbours; the charge is the maximum over this mean.
void charge_finer(const SlowLikelihood& of, const SlowModel& from, double highest, double spacing, SlowModel* m) {
  SlowModel::Name& name = m->names.back();
  const Candidate& c = of.space().candidates[name.candidate];
  const size_t n_own = c.scan.estimator->shape_lo().size();
  std::vector<std::vector<double>> moved(name.shape.size(), {highest}); // by the first parameter that is moved
  for (const Theta& shape : c.scan.estimator->neighbours(name.shape, spacing)) {
    double way = 0;
    for (size_t i = 0; i < n_own; ++i) way = std::max(way, std::fabs(shape[i] - name.shape[i]));
    if (way > 0.51 * spacing) continue;
    SlowModel near = *m;
    near.names.back().shape = shape;
    const auto first = std::mismatch(shape.begin(), shape.end(), name.shape.begin()).first;
    moved[static_cast<size_t>(first - shape.begin())].push_back(of.evaluate(near));
  }
  double cell = highest; // mean over the cell
  for (const std::vector<double>& of_one : moved) cell += log_mean_exp(of_one) - highest;
  const double grid = from.value - from.names.back().charge; // mean over the grid
  name.charge = highest - log_sum_exp({grid, cell - std::log(static_cast<double>(c.scan.shapes.size()))});
  m->value = highest;
}

} // namespace

void polish(const SlowLikelihood& of, SlowModel* m, int evaluations) {
  m->value = climb(axes_of(of, m), evaluations, [&] { return of.evaluate(*m); });
  mark_bounds(of, m);
}
double value_on(const SlowLikelihood& of, const SlowData& all, SlowModel m) {
  const std::vector<MeanPart> parts = of.parts_on(all, m);
  const MeanColumns columns(all, pointers_of(parts));
  const auto value = [&] { return RunGrams(all, columns, of.noise(m)).log_marginal_any_scale() + of.noise_value(m); };
  double best = climb(axes_of_noise(&m), kQuickEvaluations, value);
  if (of.space().belief.has_believed) {
    m.is_believed = !m.is_believed;
    best = std::max(best, climb(axes_of_noise(&m), kQuickEvaluations, value));
  }
  return best;
}
SlowModel polished(const SlowLikelihood& of, SlowModel m, int evaluations) {
  if (of.space().belief.has_believed) {
    SlowModel believed = m;
    believed.is_believed = true;
    polish(of, &believed, evaluations / 2);
    m.is_believed = false;
    polish(of, &m, evaluations);
    return believed.value > m.value ? believed : m;
  }
  polish(of, &m, evaluations);
  return m;
}
void approach(const SlowLikelihood& of, SlowModel* m) {
  const Candidate& c = of.space().candidates[m->names.back().candidate];
  if (!c.effect || c.scan.shapes.size() < 2) return;
  const SlowModel from = *m;
  const double spacing = std::fabs(c.scan.shapes[1][0] - c.scan.shapes[0][0]);
  double highest = of.evaluate(*m);
  // A jump has no slope that a search could follow: it is placed ever finer.
  double apart = spacing;
  for (int level = 0; level < (c.scan.estimator->can_jump() ? kJumpLevels : 1); ++level, apart /= 4)
    for (int pass = 0; pass < kPasses; ++pass) {
      SlowModel best = *m;
      for (const Theta& shape : c.scan.estimator->neighbours(m->names.back().shape, apart)) {
        SlowModel near = *m;
        near.names.back().shape = shape;
        if (const double value = of.evaluate(near); value > highest) highest = value, best = near;
      }
      if (best.names.back().shape == m->names.back().shape) break;
      *m = best;
    }
  if (m->names.back().shape != from.names.back().shape) charge_finer(of, from, highest, spacing, m);
}
// The shape found counts as one of the shapes of the grid, which are compared under the noise of `m`.
SlowModel best_of(const SlowLikelihood& of, const SlowModel& m, const SlowModel& with,
                  const std::vector<Theta>& shapes) {
  SlowModel best, of_grid = m;
  of_grid.names.push_back(with.names.back());
  for (const Theta& shape : shapes) {
    SlowModel at = m;
    at.names.push_back(with.names.back());
    at.names.back().shape = shape;
    at.value = of.evaluate(at);
    if (at.value > best.value) best = at;
  }
  if (best.names.empty()) return best;
  const double n = static_cast<double>(of.space().candidates[best.names.back().candidate].scan.shapes.size());
  const double grid = of.evaluate(of_grid) - with.names.back().charge;
  best.names.back().charge = best.value - log_sum_exp({grid, best.value - std::log(n)});
  return best;
}

} // namespace imucal
