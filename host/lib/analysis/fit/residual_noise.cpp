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
constexpr size_t kMostTerms = 3;
constexpr double kSeekStep = 1, kFirstStep = 0.5, kLastStep = 0.1; // of the search for one more process

// A Markov process: the logarithms of g and of its time constant in seconds.
struct Term {
  double log_g = 0, log_tau = 0;
};

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
    std::vector<Term> terms;
    NoiseModel relative; // white variance 1 of a row
  };
  Point at(const std::vector<Term>& terms) const;
  Eigen::Index n_rows() const { return n_rows_; }

private:
  const std::vector<ResidualRun>& runs_;
  std::vector<WideColumns> columns_;
  double dt_s_, rows_longest_ = 0;
  Eigen::Index n_constants_, n_rows_ = 0;
};

Restricted::Point Restricted::at(const std::vector<Term>& terms) const {
  Point out;
  out.terms = terms;
  out.relative.white_sigma_dph = std::sqrt(dt_s_);
  for (const Term& term : terms) {
    const double tau_s = std::exp(term.log_tau);
    out.relative.markov.push_back({std::sqrt(std::exp(term.log_g) / (2 * tau_s / dt_s_)), tau_s});
  }
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

// Of the logarithms of g and of the time constant.
struct Box {
  double lo_g = 0, hi_g = 0, lo_tau = 0, hi_tau = 0;
  bool holds(const Term& t) const {
    return t.log_g >= lo_g && t.log_g <= hi_g && t.log_tau >= lo_tau && t.log_tau <= hi_tau;
  }
};

std::vector<Term> with(std::vector<Term> terms, const Term& more) {
  terms.push_back(more);
  return terms;
}

double prior_of(const Term& term) { // of sqrt(g), as a deviance
  return 2 * std::log(std::cosh(0.5 * term.log_g));
}

// The points of a grid of one process, beside those that are `known`, that have weight, the likeliest one first; without that
// process among them.
std::vector<Point> weighty_points(const Restricted& likelihood, const std::vector<Term>& known, const Box& box,
                                  double step) {
  std::vector<Point> points = {likelihood.at(known)};
  for (double log_tau = box.lo_tau; log_tau <= box.hi_tau; log_tau += step)
    for (double log_g = box.lo_g; log_g <= box.hi_g; log_g += step) {
      points.push_back(likelihood.at(with(known, {log_g, log_tau})));
      points.back().deviance += prior_of({log_g, log_tau});
    }
  std::stable_sort(points.begin(), points.end(),
                   [](const Point& a, const Point& b) { return a.deviance < b.deviance; });
  size_t n = 1;
  while (n < points.size() && points[n].deviance - points[0].deviance < -2 * std::log(kNegligible)) ++n;
  points.resize(n);
  return points;
}

// Around the points, a step of the grid wider; n_known: their terms that the grid does not move.
Box box_of(const std::vector<Point>& points, size_t n_known, double step) {
  Box box = {kMostLogDensity, kLeastLogDensity, 1e9, 0};
  for (const Point& p : points) {
    if (p.terms.size() == n_known) continue;
    const Term& term = p.terms.back();
    box.lo_g = std::min(box.lo_g, term.log_g - step), box.hi_g = std::max(box.hi_g, term.log_g + step);
    box.lo_tau = std::min(box.lo_tau, term.log_tau - step), box.hi_tau = std::max(box.hi_tau, term.log_tau + step);
  }
  return box;
}

// Downhill along the axes, with steps that are halved where none of them leads down.
Point descend(const Restricted& likelihood, const Box& box, Point best) {
  for (double step = kFirstStep; step >= kLastStep; step /= 2) {
    for (bool is_lower = true; is_lower;) {
      is_lower = false;
      for (size_t i = 0; i < 2 * best.terms.size(); ++i)
        for (const double move : {step, -step}) {
          std::vector<Term> terms = best.terms;
          (i % 2 == 0 ? terms[i / 2].log_g : terms[i / 2].log_tau) += move;
          if (!box.holds(terms[i / 2])) continue;
          const Point trial = likelihood.at(terms);
          if (trial.deviance < best.deviance) best = trial, is_lower = true;
        }
    }
  }
  return best;
}

// The likeliest noise with one process more.
Point with_one_more(const Restricted& likelihood, const Box& box, const Point& from) {
  Point best = from;
  for (double log_tau = box.lo_tau; log_tau <= box.hi_tau; log_tau += kSeekStep)
    for (double log_g = box.lo_g; log_g <= box.hi_g; log_g += kSeekStep) {
      const Point trial = likelihood.at(with(from.terms, {log_g, log_tau}));
      if (trial.deviance < best.deviance) best = trial;
    }
  return descend(likelihood, box, best);
}

// All processes but the slowest that the residuals show by BIC, where they show more than one.
std::vector<Term> known_beside_slowest(const Restricted& likelihood, const Box& box, const Point& one) {
  const double cost = 2 * std::log(static_cast<double>(likelihood.n_rows()));
  Point best = likelihood.at(one.terms);
  while (best.terms.size() < kMostTerms) {
    const Point more = with_one_more(likelihood, box, best);
    if (!(best.deviance - more.deviance > cost) || more.terms.size() == best.terms.size()) break;
    best = more;
  }
  std::sort(best.terms.begin(), best.terms.end(), [](const Term& a, const Term& b) { return a.log_tau < b.log_tau; });
  best.terms.pop_back();
  return best.terms;
}

// The grid of one process beside those that are known; of long records few points have weight: then a finer grid around them.
std::vector<Point> points_beside(const Restricted& likelihood, const std::vector<Term>& known, Box box) {
  if (!known.empty()) box.lo_tau = known.back().log_tau; // it is the slowest
  const std::vector<Point> points = weighty_points(likelihood, known, box, kStep);
  if (points.size() > kFewPoints || points[0].terms.size() == known.size()) return points;
  return weighty_points(likelihood, known, box_of(points, known.size(), kStep), kStep / 4);
}

// What the prior adds up to over a grid.
double prior_of_grid(const Box& box, double step) {
  double sum = 0;
  for (double log_tau = box.lo_tau; log_tau <= box.hi_tau; log_tau += step)
    for (double log_g = box.lo_g; log_g <= box.hi_g; log_g += step) sum += std::exp(-0.5 * prior_of({log_g, log_tau}));
  return sum;
}

// One process more, slower than all of the likeliest point: as likely beforehand as none.  It alone joins the belief, with the
// weight that the residuals leave it.
void add_unseen(const Restricted& likelihood, Box box, const std::vector<Term>& known, NoiseBelief* belief) {
  if (known.empty()) return;
  box.lo_tau = known.back().log_tau + kStep;
  const double prior = prior_of_grid(box, kStep);
  if (!(prior > 0)) return; // nothing slower would be seen
  const double none = likelihood.at(known).deviance;
  std::vector<double> odds; // against none
  double sum = 1;
  const std::vector<Point> points = weighty_points(likelihood, known, box, kStep);
  for (const Point& point : points) {
    odds.push_back(point.terms.size() == known.size() ? 0 : std::exp(-0.5 * (point.deviance - none)) / prior);
    sum += odds.back();
  }
  for (size_t i = 0; i < points.size(); ++i) {
    if (odds[i] == 0) continue;
    NoiseModel unseen = scaled(points[i].relative, points[i].white_variance);
    unseen.white_sigma_dph = 0;
    unseen.markov = {unseen.markov.back()};
    belief->noise.push_back(unseen);
    belief->weight.push_back(odds[i] / sum);
  }
}

} // namespace

NoiseBelief believe_residuals(const std::vector<ResidualRun>& runs, double dt_s, bool is_shared) {
  const Restricted likelihood(runs, dt_s, is_shared);
  const double most_tau_s = std::max(kLeastTau_dt * dt_s, likelihood.longest_s() / 3);
  const Box box = {kLeastLogDensity, kMostLogDensity, std::log(kLeastTau_dt * dt_s), std::log(most_tau_s)};
  std::vector<Point> points = points_beside(likelihood, {}, box);
  if (!points[0].terms.empty())
    if (const std::vector<Term> known = known_beside_slowest(likelihood, box, points[0]); !known.empty())
      points = points_beside(likelihood, known, box);
  NoiseBelief belief;
  double sum = 0;
  for (const Point& point : points) {
    belief.noise.push_back(scaled(point.relative, point.white_variance));
    belief.weight.push_back(std::exp(-0.5 * (point.deviance - points[0].deviance)));
    sum += belief.weight.back();
  }
  for (double& weight : belief.weight) weight /= sum;
  add_unseen(likelihood, box, points[0].terms, &belief);
  return belief;
}

} // namespace imucal
