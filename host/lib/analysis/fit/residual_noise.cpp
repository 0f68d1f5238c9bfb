// SPDX-License-Identifier: MIT
#include "analysis/fit/residual_noise.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "linear/linear.h"
#include "noise/whiten.h"

namespace imucal {

namespace {

// Of the grid, in logarithms.  A density of a twentieth of the white noise changes no predicted error by more than 3 %; of
// e^10 times there is no white noise left to see.  Steps are near to the standard error of either on a test of 8400 s.
constexpr double kLeastLogDensity = -3, kMostLogDensity = 10, kStep = 0.5;
constexpr double kLeastTau_dt = 3;   // shorter ones are white noise to a thermal test
constexpr double kNegligible = 1e-3; // weight over that of the likeliest point
constexpr size_t kFewPoints = 16;    // a quarter of the step is then a quarter of the standard errors

class Restricted {
public:
  Restricted(const std::vector<ResidualRun>& runs, double dt_s, bool is_shared)
      : runs_(runs), dt_s_(dt_s), n_constants_(is_shared ? 1 : static_cast<Eigen::Index>(runs.size())) {
    for (const ResidualRun& run : runs) {
      columns_.emplace_back(run.columns);
      n_rows_ += run.columns.rows();
      rows_longest_ = std::max(rows_longest_, static_cast<double>(run.columns.rows()));
    }
  }

  double longest_s() const { return rows_longest_ * dt_s_; }

  // -2 ln L at the best scale, and that scale: the variance of the white noise.
  struct Point {
    double deviance = 0, white_variance = 0;
    double log_g = 0, log_tau = 0;
    NoiseModel relative; // white variance 1 of a row
  };
  Point at(double density, double tau_s) const;

private:
  const std::vector<ResidualRun>& runs_;
  std::vector<WideColumns> columns_;
  double dt_s_, rows_longest_ = 0;
  Eigen::Index n_constants_, n_rows_ = 0;
};

Restricted::Point Restricted::at(double density, double tau_s) const {
  Point out;
  out.relative.white_sigma_dph = std::sqrt(dt_s_);
  if (density > 0) out.relative.markov = {{std::sqrt(density / (2 * tau_s / dt_s_)), tau_s}};
  const Eigen::Index order = runs_[0].columns.cols() - 2, p = n_constants_ + order;
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(p, p);
  Eigen::VectorXd cross = Eigen::VectorXd::Zero(p);
  double rss = 0, log_s = 0, log_det = 0;
  for (size_t l = 0; l < runs_.size(); ++l) {
    const std::vector<int>& steps = runs_[l].steps;
    const RunGains gains = compute_gains({steps.size(), steps.data(), dt_s_}, out.relative);
    const Eigen::MatrixXd g = columns_[l].whitened_gram(gains);
    const Eigen::Index c = n_constants_ == 1 ? 0 : static_cast<Eigen::Index>(l);
    log_s += gains.sum_log_s;
    rss += g(0, 0);
    cross[c] += g(1, 0);
    cross.tail(order) += g.col(0).tail(order);
    gram(c, c) += g(1, 1);
    gram.row(c).tail(order) += g.row(1).tail(order);
    gram.col(c).tail(order) += g.col(1).tail(order);
    gram.bottomRightCorner(order, order) += g.bottomRightCorner(order, order);
  }
  rss -= cross.dot(solve_symmetric(gram, cross, &log_det));
  const auto dof = static_cast<double>(std::max<Eigen::Index>(1, n_rows_ - p));
  out.white_variance = std::max(rss / dof, std::numeric_limits<double>::min());
  out.deviance = log_s + log_det + dof * (std::log(out.white_variance) + 1);
  return out;
}

NoiseModel scaled(NoiseModel noise, double variance) {
  noise.white_sigma_dph *= std::sqrt(variance);
  for (Markov& m : noise.markov) m.sigma_dph *= std::sqrt(variance);
  return noise;
}

using Point = Restricted::Point;

// Of the logarithms of g and of the time constant in rows of the grid.
struct Box {
  double lo_g = 0, hi_g = 0, lo_tau = 0, hi_tau = 0;
};

// The points of a grid that have weight, the likeliest one first; white noise alone among them.
std::vector<Point> weighty_points(const Restricted& likelihood, const Box& box, double step) {
  std::vector<Point> points = {likelihood.at(0, 1)};
  for (double log_tau = box.lo_tau; log_tau <= box.hi_tau; log_tau += step)
    for (double log_g = box.lo_g; log_g <= box.hi_g; log_g += step) {
      points.push_back(likelihood.at(std::exp(log_g), std::exp(log_tau)));
      points.back().deviance += 2 * std::log(std::cosh(0.5 * log_g)); // the prior of sqrt(g)
      points.back().log_g = log_g, points.back().log_tau = log_tau;
    }
  std::stable_sort(points.begin(), points.end(),
                   [](const Point& a, const Point& b) { return a.deviance < b.deviance; });
  size_t n = 1;
  while (n < points.size() && points[n].deviance - points[0].deviance < -2 * std::log(kNegligible)) ++n;
  points.resize(n);
  return points;
}

// Around the points, a step of the grid wider.
Box box_of(const std::vector<Point>& points, double step) {
  Box box = {kMostLogDensity, kLeastLogDensity, 1e9, 0};
  for (const Point& p : points) {
    if (p.relative.markov.empty()) continue;
    box.lo_g = std::min(box.lo_g, p.log_g - step), box.hi_g = std::max(box.hi_g, p.log_g + step);
    box.lo_tau = std::min(box.lo_tau, p.log_tau - step), box.hi_tau = std::max(box.hi_tau, p.log_tau + step);
  }
  return box;
}

} // namespace

NoiseBelief believe_residuals(const std::vector<ResidualRun>& runs, double dt_s, bool is_shared) {
  const Restricted likelihood(runs, dt_s, is_shared);
  const double most_tau_s = std::max(kLeastTau_dt * dt_s, likelihood.longest_s() / 3);
  std::vector<Point> points = weighty_points(
      likelihood, {kLeastLogDensity, kMostLogDensity, std::log(kLeastTau_dt * dt_s), std::log(most_tau_s)}, kStep);
  // Of long records few points have weight: a finer grid around them.
  if (points.size() <= kFewPoints && !points[0].relative.markov.empty())
    points = weighty_points(likelihood, box_of(points, kStep), kStep / 4);
  NoiseBelief belief;
  double sum = 0;
  for (const Point& point : points) {
    belief.noise.push_back(scaled(point.relative, point.white_variance));
    belief.weight.push_back(std::exp(-0.5 * (point.deviance - points[0].deviance)));
    sum += belief.weight.back();
  }
  for (double& weight : belief.weight) weight /= sum;
  return belief;
}

} // namespace imucal
