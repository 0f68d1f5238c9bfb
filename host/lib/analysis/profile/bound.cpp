// SPDX-License-Identifier: MIT
#include "analysis/profile/bound.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <queue>

#include "analysis/profile/covariance.h"
#include "base/error.h"
#include "base/units.h"
#include "linear/linear.h"
#include "noise/whiten.h"

namespace imucal {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

double slow_ramp_bound(const ErrorModel& model, int order, double duration_s) {
  return std::sqrt((order + 1) * model.slow_density_dph2_s() / duration_s);
}

namespace {

constexpr int kChebyshev = 400; // N of step (e)
constexpr int kDesignPoints = 100;
constexpr int kSaddleSteps = 400;

// Legendre polynomials P_0 … P_M and their derivatives at tn.
void legendre(double tn, VectorXd* value, VectorXd* slope) {
  const Index p = value->size();
  (*value)(0) = 1;
  (*slope)(0) = 0;
  if (p > 1) {
    (*value)(1) = tn;
    (*slope)(1) = 1;
  }
  for (Index i = 2; i < p; ++i) {
    const double n = static_cast<double>(i);
    (*value)(i) = ((2 * n - 1) * tn * (*value)(i - 1) - (n - 1) * (*value)(i - 2)) / n;
    (*slope)(i) = (*slope)(i - 2) + (2 * n - 1) * (*value)(i - 1);
  }
}

// One noise term of step (b): coefficients of sum x^2, of the two ends, and of sum (dx)^2, and its share L_m.
struct Term {
  double level, ends, steps;
  double density, tau_s; // for the choice of the split
  VectorXd share;
};

// Information per second and matrices of the ends at one temperature, as rows of tables (flattened matrices).
struct Tables {
  MatrixXd all;   // G: level and rate parts
  MatrixXd ends;  // E
  MatrixXd slope; // d/dTn of the level part: slack of step (c)
};

class Prover {
public:
  Prover(const BoundRequest& request, double corner_rad_s) : request_(request), p_(request.order + 1) {
    rho_ = request.max_rate_degc_per_min > 0
               ? request.max_rate_degc_per_min / kSecondsPerMinute / (request.span_degc / 2)
               : std::numeric_limits<double>::infinity();
    make_terms(corner_rad_s);
    span_ = MatrixXd(101, p_ * p_);
    VectorXd f(p_), slope(p_);
    for (int j = 0; j <= 100; ++j) {
      legendre(-std::cos(kPi * j / 100.0), &f, &slope);
      put(&span_, j, f * f.transpose());
    }
  }

  // One point of the saddle problem min over (design, ends) max over mu of tr(M^-1 A).
  struct Point {
    VectorXd design, ends, mu;
  };

  struct Box {
    double u0, u1, v0, v1; // the profile's extremes are -1 + u and 1 - v
    double lower = 0, upper = 0;
    std::shared_ptr<const Point>
        near; // where the saddle of the box that this one was cut from lies (may be null); then its own
    bool operator<(const Box& other) const { return lower > other.lower; } // smallest first in the queue
  };

  // Fills lower and upper [dph^2]; stops where lower has reached `enough` (the box then cannot be the one
  // that decides); false where no profile of the duration has its extremes in the box.
  bool bound_box(Box* box, double enough) const {
    const double forced_lo = -1 + box->u1, forced_hi = 1 - box->v1;
    const double free_lo = -1 + box->u0, free_hi = 1 - box->v0;
    const double forced = std::isfinite(rho_) ? std::max(0.0, forced_hi - forced_lo) : 0;
    const double forced_s = std::isfinite(rho_) ? forced / rho_ : 0;
    const double left_s = request_.duration_s - forced_s;
    if (left_s < 0) return false;
    MatrixXd fixed = MatrixXd::Zero(p_, p_);
    // The prior's information in Legendre coefficients: C C' / sigma^2 with C the powers of P_0 … P_5, whose
    // squared norms sum to 188; more information only lowers the bound.
    fixed.diagonal().setConstant(200 / (request_.prior_sigma_dph * request_.prior_sigma_dph));
    if (forced > 0) fixed += integral(forced_lo, forced_hi) / rho_;
    const Tables coarse = make_tables(free_lo, free_hi, kDesignPoints);
    saddle(coarse, make_tables(free_lo, free_hi, kChebyshev), fixed, left_s, enough, box);
    return true;
  }

private:
  void make_terms(double corner_rad_s) {
    const double dt = request_.dt_s;
    for (const Markov& m : request_.model.markov) {
      if (m.sigma_dph <= 0) continue;
      const double var = m.sigma_dph * m.sigma_dph, phi = m.phi(dt), q = m.q_dph2(dt);
      const double density = var * (1 + phi) / m.step(dt).m();
      terms_.push_back({1 / density, phi / (var * (1 + phi)), phi / q, density, m.tau_s, VectorXd::Ones(p_)});
    }
    const double white = white_sigma_dph(request_.model.arw_deg_rt_h, dt);
    if (white > 0) terms_.push_back({1 / (white * white), 0, 0, white * white, 0, VectorXd::Ones(p_)});
    for (Index i = 0; i < p_; ++i) {
      // The split that is exact for a signal of frequency w: in proportion to the terms' densities there.
      const double w = i == 0 ? 0 : corner_rad_s * static_cast<double>(i);
      double sum = 0;
      for (Term& t : terms_) {
        t.share(i) = std::isfinite(w) ? t.density / (1 + w * w * t.tau_s * t.tau_s) : (t.tau_s == 0 ? 1 : 0);
        sum += t.share(i);
      }
      for (Term& t : terms_) t.share(i) /= sum;
    }
  }

  static void put(MatrixXd* table, Index row, const MatrixXd& matrix) {
    table->row(row) = Eigen::Map<const Eigen::RowVectorXd>(matrix.data(), matrix.size());
  }

  // G at tn, [1/(dph^2 s)].
  MatrixXd rate_of_information(const VectorXd& f, const VectorXd& slope) const {
    MatrixXd g = MatrixXd::Zero(p_, p_);
    for (const Term& t : terms_) {
      const VectorXd level = t.share.cwiseProduct(f);
      g += t.level / request_.dt_s * level * level.transpose();
      if (t.steps > 0) {
        const VectorXd rate = t.share.cwiseProduct(slope);
        if (std::isfinite(rho_)) g += t.steps * request_.dt_s * rho_ * rho_ * rate * rate.transpose();
      }
    }
    return g;
  }

  // On the n + 1 Chebyshev points of [lo, hi].
  Tables make_tables(double lo, double hi, int n) const {
    Tables t{MatrixXd(n + 1, p_ * p_), MatrixXd(n + 1, p_ * p_), MatrixXd(n + 1, p_ * p_)};
    VectorXd f(p_), slope(p_);
    for (int j = 0; j <= n; ++j) {
      const double tn = (lo + hi) / 2 - (hi - lo) / 2 * std::cos(kPi * j / n);
      legendre(tn, &f, &slope);
      put(&t.all, j, rate_of_information(f, slope));
      MatrixXd ends = MatrixXd::Zero(p_, p_), change = MatrixXd::Zero(p_, p_);
      for (const Term& term : terms_) {
        const VectorXd level = term.share.cwiseProduct(f), rate = term.share.cwiseProduct(slope);
        ends += term.ends * level * level.transpose();
        change += term.level / request_.dt_s * (level * rate.transpose() + rate * level.transpose());
      }
      put(&t.ends, j, ends);
      put(&t.slope, j, change);
    }
    return t;
  }

  // int G over [lo, hi], polynomials of degree <= 10: composite Simpson would do, Gauss-Legendre is exact.
  MatrixXd integral(double lo, double hi) const {
    static const double node[3] = {0.2386191860831969, 0.6612093864662645, 0.9324695142031521};
    static const double weight[3] = {0.4679139345726910, 0.3607615730481386, 0.1713244923791704};
    MatrixXd sum = MatrixXd::Zero(p_, p_);
    VectorXd f(p_), slope(p_);
    for (int i = 0; i < 6; ++i) {
      const double x = i < 3 ? node[i] : -node[i - 3];
      legendre((lo + hi) / 2 + (hi - lo) / 2 * x, &f, &slope);
      sum += (hi - lo) / 2 * weight[i % 3] * rate_of_information(f, slope);
    }
    return sum;
  }

  struct Gradient {
    VectorXd design, ends, mu; // relative to the value
    double value = 0, worst = 0;
    MatrixXd b; // M^-1 A M^-1
  };

  Gradient gradient(const Tables& tables, const MatrixXd& fixed, double left_s, const Point& at) const {
    Gradient g;
    const VectorXd flat = left_s * (tables.all.transpose() * at.design) + 2 * (tables.ends.transpose() * at.ends);
    const MatrixXd m = fixed + Eigen::Map<const MatrixXd>(flat.data(), p_, p_);
    const MatrixXd inverse = inverse_symmetric(m);
    const Eigen::Map<const VectorXd> inverse_flat(inverse.data(), p_ * p_);
    g.mu = span_ * inverse_flat;
    g.worst = g.mu.maxCoeff();
    const VectorXd a_flat = span_.transpose() * at.mu;
    const Eigen::Map<const MatrixXd> a(a_flat.data(), p_, p_);
    g.value = (inverse * a).trace();
    g.b = inverse * a * inverse;
    const Eigen::Map<const VectorXd> b_flat(g.b.data(), p_ * p_);
    g.design = left_s / g.value * (tables.all * b_flat);
    g.ends = 2 / g.value * (tables.ends * b_flat);
    g.mu /= g.value;
    return g;
  }

  // tr(M^-1 A)^2 / max tr(B M) with B = M^-1 A M^-1: valid for any mu and any design (step e).
  double certificate(const Tables& tables, const MatrixXd& fixed, double left_s, const Gradient& g) const {
    const double degree = 2.0 * (static_cast<double>(p_) - 1);
    const double cheb = std::cos(degree * kPi / (2.0 * kChebyshev));
    const Eigen::Map<const VectorXd> b_flat(g.b.data(), p_ * p_);
    double most = fixed.cwiseProduct(g.b).sum() + left_s * (tables.all * b_flat).maxCoeff() / cheb +
                  2 * (tables.ends * b_flat).maxCoeff() / cheb;
    // Step (c).  Without a rate limit the samples themselves are the design: no integral is compared with.
    if (std::isfinite(rho_))
      most += request_.duration_s * rho_ * request_.dt_s / 4 * (tables.slope * b_flat).cwiseAbs().maxCoeff() / cheb;
    return g.value * g.value / most;
  }

  // Weights and the logarithm of what a step multiplied them by: the distance between steps then needs no logarithm.
  struct Weights {
    VectorXd value, log_factor;
  };
  struct Step {
    Weights design, ends, mu;
    Point point() const { return {design.value, ends.value, mu.value}; }
  };
  // from * exp(step direction), normalised; no weight dies out for good.
  static Weights stepped(const VectorXd& from, const VectorXd& direction, double step) {
    Weights out;
    out.log_factor = step * (direction.array() - direction.maxCoeff());
    out.value = (from.array() * out.log_factor.array().exp()).max(1e-12);
    const double sum = out.value.sum();
    out.value /= sum;
    out.log_factor.array() -= std::log(sum);
    return out;
  }
  static Step moved(const Point& from, const Gradient& g, double step) {
    return {stepped(from.design, g.design, step), stepped(from.ends, g.ends, step), stepped(from.mu, g.mu, step)};
  }
  // Relative entropies of a against where it came from, and of b against a; both came from the same weights.  It only sizes
  // the steps: weights held at 1e-12 may make it inexact.
  static double divergence(const Weights& a, const Weights& b) {
    return a.value.dot(a.log_factor) + b.value.dot(b.log_factor - a.log_factor);
  }
  static double divergence(const Step& a, const Step& b) {
    return divergence(a.design, b.design) + divergence(a.ends, b.ends) + divergence(a.mu, b.mu);
  }

  // Mirror-prox (Nemirovski 2004) with entropy as distance and a step that adapts; averages of its steps
  // approach the saddle point.  Every 25 steps a certificate is drawn from the averages; the best is kept.
  void saddle(const Tables& tables, const Tables& fine, const MatrixXd& fixed, double left_s, double enough,
              Box* box) const {
    const auto even = [](Index n) { return VectorXd(VectorXd::Constant(n, 1.0 / static_cast<double>(n))); };
    Point at{even(tables.all.rows()), even(tables.ends.rows()), even(span_.rows())};
    if (box->near) // a part of the even weights lets what has nearly died out there come back
      at = {0.9 * box->near->design + 0.1 * at.design, 0.9 * box->near->ends + 0.1 * at.ends,
            0.9 * box->near->mu + 0.1 * at.mu};
    Point mean{0 * at.design, 0 * at.ends, 0 * at.mu};
    double total = 0, step = 1;
    box->lower = 0;
    box->upper = std::numeric_limits<double>::infinity();
    for (int k = 1, renewed = 0; k <= kSaddleSteps; ++k) {
      const Gradient here = gradient(tables, fixed, left_s, at);
      const Step first = moved(at, here, step);
      const Point half = first.point();
      const Gradient there = gradient(tables, fixed, left_s, half);
      const Step second = moved(at, there, step);
      Point next = second.point();
      const double drift =
          step * ((here.design - there.design).dot(half.design - next.design) +
                  (here.ends - there.ends).dot(half.ends - next.ends) + (here.mu - there.mu).dot(half.mu - next.mu));
      if (drift > divergence(first, second)) {
        step *= 0.5;
        continue;
      }
      at = std::move(next);
      mean.design += step * half.design;
      mean.ends += step * half.ends;
      mean.mu += step * half.mu;
      total += step;
      step = std::min(20.0, 1.2 * step);
      if (k / 25 == renewed) continue;
      renewed = k / 25;
      const Point average{mean.design / total, mean.ends / total, mean.mu / total};
      const Gradient g = gradient(tables, fixed, left_s, average);
      box->near = std::make_shared<const Point>(average);
      box->lower = std::max(box->lower, certificate(fine, fixed, left_s, g));
      box->upper = std::min(box->upper, g.worst);
      if (box->upper < 1.004 * box->lower || box->lower > enough) break;
      if (renewed == 1 || renewed == 2 || renewed == 6) { // forget the way from the start
        mean = {0 * at.design, 0 * at.ends, 0 * at.mu};
        total = 0;
      }
    }
  }

  BoundRequest request_;
  Index p_;
  double rho_; // normalised temperature per second
  std::vector<Term> terms_;
  MatrixXd span_;
};

// Branch and bound over the profile's extremes, step (d).
Bound prove(const BoundRequest& request, double corner_rad_s, int max_boxes) {
  const Prover prover(request, corner_rad_s);
  std::priority_queue<Prover::Box> queue;
  Bound result;
  double enough = std::numeric_limits<double>::infinity();
  const auto add = [&](Prover::Box box) {
    ++result.boxes;
    if (!prover.bound_box(&box, enough)) return;
    enough = std::min(enough, box.upper);
    queue.push(box);
  };
  if (request.max_rate_degc_per_min <= 0) {
    add({0, 0, 0, 0, 0, 0, nullptr});
  } else {
    static const double edge[] = {0, 0.02, 0.08, 0.25, 2};
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j) add({edge[i], edge[i + 1], edge[j], edge[j + 1], 0, 0, nullptr});
    while (!queue.empty() && result.boxes < max_boxes) {
      const Prover::Box top = queue.top();
      const double du = top.u1 - top.u0, dv = top.v1 - top.v0;
      if (std::max(du, dv) < 2e-4) break;
      queue.pop();
      // The first cut of a box lies at a quarter: what matters lies near the full range.
      const double cut = std::max(du, dv) > 0.5 ? 0.25 : 0.5;
      if (du >= dv) {
        add({top.u0, top.u0 + cut * du, top.v0, top.v1, 0, 0, top.near});
        add({top.u0 + cut * du, top.u1, top.v0, top.v1, 0, 0, top.near});
      } else {
        add({top.u0, top.u1, top.v0, top.v0 + cut * dv, 0, 0, top.near});
        add({top.u0, top.u1, top.v0 + cut * dv, top.v1, 0, 0, top.near});
      }
    }
  }
  if (queue.empty()) return result; // cannot be: the whole range left out always fits
  result.proven_dph = std::sqrt(queue.top().lower);
  result.relaxation_dph = std::sqrt(queue.top().upper);
  result.inset_low_frac = queue.top().u0 / 2;
  result.inset_high_frac = queue.top().v0 / 2;
  return result;
}

} // namespace

static void check_request(const BoundRequest& request) {
  if (request.order < 0 || request.order > kMaxOrder)
    throw usage_error("--order " + std::to_string(request.order) + ": must be 0 to " + std::to_string(kMaxOrder));
  if (!(request.duration_s >= request.dt_s * (request.order + 1)))
    throw usage_error("--duration-s: an order-" + std::to_string(request.order) + " polynomial needs at least " +
                      std::to_string(request.order + 1) + " samples; give --duration-s " +
                      std::to_string(request.order + 1) + " or more");
  check_noise(request.model, "model");
}

Bound calibration_bound(const BoundRequest& request) {
  check_request(request);
  const bool limited = request.max_rate_degc_per_min > 0;
  if (limited && !(request.span_degc > 0)) throw usage_error("--max-rate needs --range A:B with A < B for the bound");
  Bound best;
  const bool has_white = request.model.arw_deg_rt_h > 0;
  if (limited) {
    // The split's corner: any is valid, the highest bound counts.  Few boxes for the search, the best one in
    // full.
    double best_corner = 0, best_value = -1;
    double longest_s = 1;
    for (const Markov& m : request.model.markov)
      if (m.sigma_dph > 0) longest_s = std::max(longest_s, m.tau_s);
    for (double corner : {0.0, 0.3, 1.0, 3.0}) {
      const double value = prove(request, corner / longest_s, 16).proven_dph;
      if (value < best_value) break;
      best_value = value;
      best_corner = corner / longest_s;
      if (request.model.markov.empty()) break;
    }
    best = prove(request, best_corner, 100);
  }
  if (has_white) { // a limited rate is a special case of an unlimited one
    BoundRequest unlimited = request;
    unlimited.max_rate_degc_per_min = 0;
    const Bound other = prove(unlimited, std::numeric_limits<double>::infinity(), 1);
    if (other.proven_dph > best.proven_dph) best = other;
  }
  // Whatever the profile does, the constant is known no better than from the whole record:
  // max_T f' M^-1 f >= (c' e0)^2 / (e0' M e0) with c = int f dmu, c_0 = 1, and e0' M e0 = 1' V^-1 1.
  std::vector<double> ones(static_cast<size_t>(request.duration_s / request.dt_s), 1.0);
  whiten(compute_gains({ones.size(), nullptr, request.dt_s}, noise_of(request.model)), ones.data(), ones.size());
  double information = 1 / (request.prior_sigma_dph * request.prior_sigma_dph);
  for (double e : ones) information += e * e;
  const double constant_dph = 1 / std::sqrt(information);
  if (constant_dph > best.proven_dph) best.proven_dph = best.relaxation_dph = constant_dph;

  best.slow_ramp_dph = slow_ramp_bound(request.model, request.order, request.duration_s);
  best.assumptions = {
      "worst one-sigma error over the calibrated range, no knowledge of the coefficients before the test",
      "the filter knows the error model",
      "ramps slow against every time constant: noise acts as white noise of density S0 = sum 2 sigma^2 "
      "tau + (60 arw)^2",
      "any division of the time over the temperatures, no time lost on the way between them",
      "end effects neglected: duration long against every time constant"};
  best.proven_assumptions = {
      "worst one-sigma error over the calibrated range, prior sigma of the coefficients as stated",
      "the filter knows the error model; Gaussian or not, every linear unbiased estimate",
      limited ? "any temperature curve inside the range that never changes faster than the maximum rate"
              : "any temperature curve inside the range, jumps included",
      "one run without interruption, stationary noise from its start"};
  return best;
}

} // namespace imucal
