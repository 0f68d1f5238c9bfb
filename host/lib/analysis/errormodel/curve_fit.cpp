// SPDX-License-Identifier: MIT
#include "analysis/errormodel/curve_fit.h"

#include <nlopt.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "analysis/errormodel/confidence.h"
#include "analysis/errormodel/lp.h"
#include "base/error.h"
#include "base/quantile.h"
#include "base/units.h"
#include "base/x87.h"
#include "linear/linear.h"

namespace imucal {

namespace {

constexpr double kGridPerDecade = 10;

// Minimise f over a box by Nelder-Mead from x; returns the value.
double nelder_mead(std::vector<double>* x, const std::vector<double>& lo, const std::vector<double>& hi, double step,
                   double tol, int max_evaluations, const std::function<double(const std::vector<double>&)>& f) {
  using Fn = std::function<double(const std::vector<double>&)>;
  nlopt_opt opt = nlopt_create(NLOPT_LN_NELDERMEAD, static_cast<unsigned>(x->size()));
  nlopt_set_min_objective(
      opt,
      [](unsigned n, const double* at, double*, void* data) {
        return (*static_cast<const Fn*>(data))(std::vector<double>(at, at + n));
      },
      const_cast<Fn*>(&f));
  nlopt_set_lower_bounds(opt, lo.data());
  nlopt_set_upper_bounds(opt, hi.data());
  nlopt_set_initial_step1(opt, step);
  nlopt_set_xtol_abs1(opt, tol);
  nlopt_set_ftol_rel(opt, 1e-7);
  nlopt_set_maxeval(opt, max_evaluations);
  for (size_t i = 0; i < x->size(); ++i) (*x)[i] = std::clamp((*x)[i], lo[i], hi[i]);
  double value = 0;
  const RoundsToDouble rounding;
  if (nlopt_optimize(opt, x->data(), &value) < 0) value = f(*x);
  nlopt_destroy(opt);
  return value;
}

ErrorModel make_model(const std::vector<double>& variance, const std::vector<double>& tau_s, double dt_s) {
  ErrorModel m;
  m.arw_deg_rt_h = arw_from_white_sigma(std::sqrt(variance[0] * dt_s));
  for (size_t i = 0; i < tau_s.size(); ++i)
    if (variance[i + 1] > 0) m.markov.push_back({std::sqrt(variance[i + 1]), tau_s[i]});
  std::sort(m.markov.begin(), m.markov.end(), [](const Markov& a, const Markov& b) { return a.tau_s < b.tau_s; });
  return m;
}

std::vector<double> divided(std::vector<double> a, const std::vector<double>& b) {
  for (size_t i = 0; i < a.size(); ++i) a[i] /= b[i];
  return a;
}

} // namespace

constexpr long kPerWindow = 8; // Windows::kSome: as many begin within the length of one

CurveData make_curve_data(const std::vector<Series>& series, const DpOperator& op, const Detrend& detrend,
                          const std::vector<double>& tau_s, Across across, Windows windows) {
  CurveData data;
  data.op = op;
  data.detrend = detrend;
  for (const Series& s : series) {
    const DpRecord record(s, op);
    const DpCurve curve = dp_curve(s, record, tau_s, DpEstimator::kRms, windows == Windows::kSome ? kPerWindow : 0);
    if (data.n.empty()) {
      for (double t : curve.tau_s) data.n.push_back(std::lround(t / s.dt_s));
      data.mean_square_dph2.assign(data.n.size(), 0.0);
      data.dof.assign(data.n.size(), 0.0);
    }
    for (size_t i = 0; i < data.n.size(); ++i) {
      const double square = 2 * curve.dp_dph[i] * curve.dp_dph[i];
      double& out = data.mean_square_dph2[i];
      out = across == Across::kMax ? std::max(out, square) : out + square / static_cast<double>(series.size());
      // A rule of thumb that needs no model: windows that do not overlap.  Those of a spaced curve stand for all between
      // them: refits must weigh the taus as the fit does.
      const long n = data.n[i], step = windows == Windows::kSome ? std::max(1L, n / kPerWindow) : 1;
      const auto n_windows = static_cast<double>(std::min(curve.n[i] * step, record.possible_windows(n)));
      data.dof[i] += std::max(1.0, n_windows / static_cast<double>(n));
    }
    data.shapes.push_back(&s);
    data.record_s = std::max(data.record_s, static_cast<double>(s.size()) * s.dt_s);
  }
  return data;
}

namespace {

// A record with its samples taken together, `step` at a time, and what acts on it.
struct Coarse {
  long step = 1;
  DpOperator op;
  Series shape;
};

constexpr long kCoarseSize = 1L << 14; // samples that a coarse record has at least
constexpr long kLongSize = 1L << 16;   // samples from which on a record is made coarse

// Means of the samples present; a block that lacks half of them is missing.
Coarse coarse_of(const CurveData& data, const Series& shape) {
  const long step = shape.size() / kCoarseSize, size = shape.size() / step;
  Coarse out{step, data.op, {}};
  Series& s = out.shape;
  out.op.dt_s = s.dt_s = shape.dt_s * static_cast<double>(step);
  for (long block = 0; block < size; ++block) {
    double rate = 0, temp = 0;
    long n = 0;
    for (long i = block * step; i < (block + 1) * step; ++i) {
      const auto k = static_cast<size_t>(i);
      if (std::isnan(shape.rate_dph[k])) continue;
      rate += shape.rate_dph[k], ++n;
      if (!shape.temp_degc.empty()) temp += shape.temp_degc[k];
    }
    const bool is_missing = 2 * n < step;
    s.n_missing += is_missing;
    const double nan = std::numeric_limits<double>::quiet_NaN();
    s.rate_dph.push_back(is_missing ? nan : rate / static_cast<double>(n));
    if (!shape.temp_degc.empty()) s.temp_degc.push_back(is_missing ? nan : temp / static_cast<double>(n));
  }
  return out;
}

// Whole numbers, evenly spaced in their logarithm.
std::vector<long> nodes_between(double first, double last, size_t count) {
  std::vector<long> nodes;
  for (size_t k = 0; k < count; ++k) {
    const double place = static_cast<double>(k) / static_cast<double>(count - 1);
    const long n = std::lround(std::exp(std::log(first) * (1 - place) + std::log(last) * place));
    if (nodes.empty() || n > nodes.back()) nodes.push_back(n);
  }
  return nodes;
}

// Lagrange on four nodes.
double interpolated(const std::vector<double>& x, const std::vector<double>& y, double at) {
  const auto above = static_cast<size_t>(std::lower_bound(x.begin(), x.end(), at) - x.begin());
  const size_t first = std::min(above < 2 ? 0 : above - 2, x.size() - 4);
  double sum = 0;
  for (size_t a = first; a < first + 4; ++a) {
    double weight = 1;
    for (size_t b = first; b < first + 4; ++b)
      if (b != a) weight *= (at - x[b]) / (x[a] - x[b]);
    sum += weight * y[a];
  }
  return sum;
}

} // namespace

// Expectations of a detrended record at every n.  After a polynomial they cost much; what it takes away is a smooth function
// of ln n, so many n are served by 40 of them and cubic interpolation of the ratio to the closed form (to about 1e-5).
// What a smooth polynomial takes away depends on lengths over that of the record: a long record is made coarse for the ratio
// (Allan deviation; to 2e-4), twice as many n serve, and below one coarse sample, where next to nothing is taken away, the
// part taken grows with n.
static std::vector<std::vector<double>> record_squares(const std::vector<NoiseComponent>& components,
                                                       const CurveData& data, const Series& shape) {
  constexpr size_t kNodes = 40, kCoarseNodes = 80;
  const bool polynomial = data.detrend.order > 0;
  const bool is_long = data.op.type == DpType::kAv && shape.size() >= kLongSize;
  if (!polynomial || (!is_long && data.n.size() <= kNodes + 8))
    return expected_record_squares(components, data.op, shape, data.detrend, data.n);
  const Coarse coarse = is_long ? coarse_of(data, shape) : Coarse{1, data.op, shape};
  const auto step = static_cast<double>(coarse.step);
  const double last = static_cast<double>(data.n.back()) / step;
  const auto nodes = nodes_between(std::max(1.0, static_cast<double>(data.n.front()) / step), std::max(last, 8.0),
                                   is_long ? kCoarseNodes : kNodes);
  std::vector<double> x;
  for (long n : nodes) x.push_back(std::log(static_cast<double>(n)));
  std::vector<NoiseComponent> slowed = components;
  for (NoiseComponent& c : slowed) c.alpha *= step;
  auto ratio = expected_record_squares(slowed, coarse.op, coarse.shape, data.detrend, nodes);
  for (size_t c = 0; c < components.size(); ++c) {
    for (size_t k = 0; k < nodes.size(); ++k) ratio[c][k] /= expected_square(slowed[c], coarse.op, nodes[k]);
    std::vector<double> squares;
    for (long n : data.n) {
      const double at = static_cast<double>(n) / step;
      const double part = at < 1 ? 1 - at * (1 - ratio[c][0]) : interpolated(x, ratio[c], std::log(at));
      squares.push_back(part * expected_square(components[c], data.op, n));
    }
    ratio[c] = std::move(squares);
  }
  return ratio;
}

CurveBasis::CurveBasis(const CurveData& data) : op_(data.op), n_(data.n) {
  // Nothing is known of time constants beyond a third of the record.
  const double dt_s = data.op.dt_s, last_s = std::max(data.record_s / 3, 4 * dt_s);
  const double first_s = dt_s * 1.5;
  const int points = std::max(2, static_cast<int>(std::ceil(std::log10(last_s / first_s) * kGridPerDecade)) + 1);
  std::vector<NoiseComponent> components = {white_component(1)};
  for (int k = 0; k < points; ++k) {
    grid_tau_s_.push_back(first_s * std::pow(last_s / first_s, k / (points - 1.0)));
    components.push_back(markov_component(1, grid_tau_s_.back(), dt_s));
  }
  // Records of the same shape are expected the same.
  std::vector<std::pair<const Series*, double>> kinds;
  const bool by_temperature = data.detrend.kind == Detrend::Kind::kPolyTemperature && data.detrend.order > 0;
  for (const Series* s : data.shapes) {
    const auto known = std::find_if(kinds.begin(), kinds.end(), [&](const auto& k) {
      return !by_temperature && k.first->size() == s->size() && k.first->n_missing == 0 && s->n_missing == 0;
    });
    const double share = 1.0 / static_cast<double>(data.shapes.size());
    if (known != kinds.end())
      known->second += share;
    else
      kinds.emplace_back(s, share);
  }
  columns_.assign(components.size(), std::vector<double>(data.n.size(), 0.0));
  for (const auto& [shape, share] : kinds) {
    const auto squares = record_squares(components, data, *shape);
    for (size_t c = 0; c < squares.size(); ++c)
      for (size_t i = 0; i < data.n.size(); ++i) columns_[c][i] += share * squares[c][i];
  }
  if (data.detrend.kind == Detrend::Kind::kNone) return;
  for (size_t g = 0; g < grid_tau_s_.size(); ++g)
    ratio_.push_back(divided(columns_[g + 1], closed_markov(grid_tau_s_[g])));
}

std::vector<double> CurveBasis::closed_markov(double tau_s) const {
  const NoiseComponent c = markov_component(1, tau_s, op_.dt_s);
  std::vector<double> out;
  for (long n : n_) out.push_back(expected_square(c, op_, n));
  return out;
}

std::vector<double> CurveBasis::markov(double tau_s) const {
  std::vector<double> out = closed_markov(tau_s);
  if (ratio_.empty()) return out;
  const double step = std::log(grid_tau_s_[1] / grid_tau_s_[0]), last = static_cast<double>(grid_tau_s_.size() - 1);
  const double place = std::clamp(std::log(tau_s / grid_tau_s_[0]) / step, 0.0, last);
  const auto k = static_cast<size_t>(std::min(place, last - 1));
  const double x = place - static_cast<double>(k);
  const size_t before = k > 0 ? k - 1 : k, after = k + 2 < ratio_.size() ? k + 2 : k + 1;
  for (size_t i = 0; i < out.size(); ++i) { // cubic Hermite (Catmull-Rom)
    const double a = ratio_[before][i], b = ratio_[k][i], c = ratio_[k + 1][i], d = ratio_[after][i];
    out[i] *= b + 0.5 * x * (c - a + x * (2 * a - 5 * b + 4 * c - d + x * (3 * (b - c) + d - a)));
  }
  return out;
}

std::vector<double> CurveBasis::model(const ErrorModel& m) const {
  const double white = white_sigma_dph(m.arw_deg_rt_h, op_.dt_s);
  std::vector<double> out(n_.size(), 0.0);
  for (size_t i = 0; i < out.size(); ++i) out[i] = white * white * columns_[0][i];
  for (const Markov& term : m.markov) {
    const auto column = markov(term.tau_s);
    for (size_t i = 0; i < out.size(); ++i) out[i] += term.sigma_dph * term.sigma_dph * column[i];
  }
  return out;
}

static std::shared_ptr<const CurveBasis> basis_of(const CurveData& data) {
  return data.basis ? data.basis : std::make_shared<const CurveBasis>(data);
}

Excess excess_of(const CurveData& data, const std::vector<double>& model_square) {
  Excess e;
  e.worst_ratio = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < data.n.size(); ++i) {
    const double ratio = std::sqrt(model_square[i] / data.mean_square_dph2[i]);
    const double tau_s = static_cast<double>(data.n[i]) * data.op.dt_s;
    e.mean += (ratio - 1) / static_cast<double>(data.n.size());
    e.worst = std::max(e.worst, ratio - 1);
    if (ratio < e.worst_ratio) e.worst_ratio = ratio, e.at_tau_s = tau_s;
    if (std::fabs(ratio - 1) < 1e-6) e.active_tau_s.push_back(tau_s);
  }
  return e;
}

namespace {

// Searches the time constants of n terms for the least objective of a function of them.
struct TimeConstantSearch {
  double lo, hi; // logarithms
  std::function<double(const std::vector<double>&)> objective;

  double refine(std::vector<double>* log_tau) const {
    if (log_tau->empty()) return objective(*log_tau);
    const std::vector<double> lower(log_tau->size(), lo), upper(log_tau->size(), hi);
    return nelder_mead(log_tau, lower, upper, 0.15, 1e-4, 120, objective);
  }
};

// Bound with a given number of terms: everything about the columns is relative to the data.
class BoundSearch {
public:
  BoundSearch(const CurveData& data, const CurveBasis& basis) : data_(data), basis_(basis) {
    white_ = divided(basis.white(), data.mean_square_dph2);
    for (size_t g = 0; g < basis.grid_tau_s().size(); ++g)
      grid_.push_back(divided(basis.grid_column(g), data.mean_square_dph2));
  }

  BoundingSolution at_grid(const std::vector<size_t>& terms) const {
    std::vector<const double*> columns = {white_.data()};
    for (size_t g : terms) columns.push_back(grid_[g].data());
    return solve_bounding_small(columns, white_.size());
  }
  BoundingSolution at(const std::vector<double>& log_tau) const {
    std::vector<std::vector<double>> own;
    for (double t : log_tau) own.push_back(divided(basis_.markov(std::exp(t)), data_.mean_square_dph2));
    std::vector<const double*> columns = {white_.data()};
    for (const auto& c : own) columns.push_back(c.data());
    return solve_bounding_small(columns, white_.size());
  }
  BoundingSolution whole_grid() const {
    BoundingProgram program;
    program.columns.push_back(white_);
    program.columns.insert(program.columns.end(), grid_.begin(), grid_.end());
    return solve_bounding(program);
  }

  // Best time constants for n terms; `previous`: those of n - 1 terms.
  std::vector<double> best(size_t n, const std::vector<double>& previous) const {
    struct Start {
      double objective;
      std::vector<double> log_tau;
    };
    std::vector<Start> starts;
    const auto consider = [&](const std::vector<size_t>& terms) {
      Start s{at_grid(terms).objective, {}};
      for (size_t g : terms) s.log_tau.push_back(std::log(basis_.grid_tau_s()[g]));
      starts.push_back(s);
    };
    const size_t points = grid_.size();
    if (n == 1)
      for (size_t a = 0; a < points; ++a) consider({a});
    if (n == 2)
      for (size_t a = 0; a < points; a += 2)
        for (size_t b = a + 2; b < points; b += 2) consider({a, b});
    if (n >= 3) // one more beside those of before
      for (size_t a = 0; a < points; a += 2) {
        Start s{0, previous};
        s.log_tau.push_back(std::log(basis_.grid_tau_s()[a]));
        s.objective = at(s.log_tau).objective;
        starts.push_back(s);
      }
    std::sort(starts.begin(), starts.end(), [](const Start& a, const Start& b) { return a.objective < b.objective; });
    TimeConstantSearch search{std::log(basis_.grid_tau_s().front()), std::log(basis_.grid_tau_s().back()),
                              [&](const std::vector<double>& t) {
                                const double value = at(t).objective;
                                return std::isfinite(value) ? value : 1e9;
                              }};
    std::vector<double> winner;
    double least = std::numeric_limits<double>::infinity();
    for (size_t k = 0; k < std::min<size_t>(2, starts.size()); ++k) {
      std::vector<double> log_tau = starts[k].log_tau;
      const double value = search.refine(&log_tau);
      if (value < least) least = value, winner = log_tau;
    }
    return winner;
  }

  CurveFit finished(const std::vector<double>& log_tau) const {
    const BoundingSolution s = at(log_tau);
    std::vector<double> tau_s;
    for (double t : log_tau) tau_s.push_back(std::exp(t));
    CurveFit fit;
    fit.model = make_model(s.x, tau_s, data_.op.dt_s);
    fit.objective = s.objective;
    fit.excess = excess_of(data_, basis_.model(fit.model));
    fit.bounded = fit.excess.worst_ratio >= 1 - 1e-9;
    return fit;
  }

private:
  const CurveData& data_;
  const CurveBasis& basis_;
  std::vector<double> white_;
  std::vector<std::vector<double>> grid_;
};

} // namespace

CurveFit fit_bound(const CurveData& data, int n_markov, double enough) {
  const std::shared_ptr<const CurveBasis> shared = basis_of(data);
  const CurveBasis& basis = *shared;
  const BoundSearch search(data, basis);
  const BoundingSolution grid = search.whole_grid();
  const ErrorModel grid_model = make_model(grid.x, basis.grid_tau_s(), data.op.dt_s);
  const double grid_mean = excess_of(data, basis.model(grid_model)).mean;
  std::vector<double> log_tau, objectives, means;
  CurveFit fit;
  const int most = n_markov < 0 ? 4 : n_markov;
  for (int n = 0; n <= most; ++n) {
    // A given number goes there directly where it can: two are searched as pairs, more need those before.
    if (n_markov >= 0 && n < n_markov && (n < 2 || n_markov < 3)) continue;
    log_tau = n == 0 ? std::vector<double>() : search.best(static_cast<size_t>(n), log_tau);
    fit = search.finished(log_tau);
    objectives.resize(static_cast<size_t>(n), std::numeric_limits<double>::quiet_NaN());
    means.resize(static_cast<size_t>(n), std::numeric_limits<double>::quiet_NaN());
    objectives.push_back(fit.objective);
    means.push_back(fit.excess.mean);
    if (n_markov < 0 && fit.bounded && fit.excess.mean <= grid_mean + enough) break;
  }
  fit.grid_objective = grid.objective;
  fit.grid_model = grid_model;
  fit.objective_by_terms = objectives;
  fit.mean_excess_by_terms = means;
  return fit;
}

CurveData raised_to_confidence(CurveData data, double confidence) {
  if (confidence <= 0) return data;
  for (size_t i = 0; i < data.n.size(); ++i)
    data.mean_square_dph2[i] *= std::max(1.0, data.dof[i] / chi2_quantile(1 - confidence, data.dof[i]));
  return data;
}

namespace {

// Levenberg-Marquardt on ln DP^2 in the logarithms of variances and time constants.
class LeastSquares {
public:
  LeastSquares(const CurveData& data, const CurveBasis& basis) : data_(data), basis_(basis) {
    for (double w : data.dof) weight_.push_back(std::sqrt(0.5 * w / static_cast<double>(data.n.size())));
  }

  double run(std::vector<double>* x) const {
    Eigen::VectorXd r = residual(*x);
    double damping = 1e-2, cost = r.squaredNorm();
    const auto n = static_cast<long>(x->size());
    for (int step = 0; step < 60; ++step) {
      Eigen::MatrixXd jacobian(r.size(), n);
      for (long j = 0; j < n; ++j) {
        std::vector<double> moved = *x;
        moved[static_cast<size_t>(j)] += 1e-5;
        jacobian.col(j) = (residual(moved) - r) / 1e-5;
      }
      const Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
      const Eigen::VectorXd gradient = jacobian.transpose() * r;
      bool better = false;
      for (int attempt = 0; attempt < 12 && !better; ++attempt, damping *= better ? 1 : 4) {
        Eigen::MatrixXd damped = normal;
        damped.diagonal() += damping * normal.diagonal() + Eigen::VectorXd::Constant(n, 1e-12);
        const Eigen::VectorXd delta = -solve_symmetric(damped, gradient);
        std::vector<double> tried = *x;
        for (long j = 0; j < n; ++j)
          tried[static_cast<size_t>(j)] = bounded(j, (*x)[static_cast<size_t>(j)] + std::clamp(delta[j], -1.0, 1.0));
        const Eigen::VectorXd next = residual(tried);
        if (next.squaredNorm() < cost) {
          better = true;
          const double gain = cost - next.squaredNorm();
          *x = tried, r = next, cost = next.squaredNorm();
          damping = std::max(1e-9, damping * 0.2);
          if (gain < 1e-10 * (1 + cost)) return cost;
        }
      }
      if (!better) break;
    }
    return cost;
  }

  // x: ln white variance, then ln variance and ln tau per term.
  ErrorModel model(const std::vector<double>& x) const {
    std::vector<double> variance = {std::exp(x[0])}, tau_s;
    for (size_t k = 1; k + 1 < x.size(); k += 2)
      variance.push_back(std::exp(x[k])), tau_s.push_back(std::exp(x[k + 1]));
    return make_model(variance, tau_s, data_.op.dt_s);
  }

private:
  double bounded(long j, double value) const {
    if (j == 0 || j % 2 == 1) return std::clamp(value, -60.0, 60.0);
    return std::clamp(value, std::log(basis_.grid_tau_s().front()), std::log(basis_.grid_tau_s().back()));
  }
  Eigen::VectorXd residual(const std::vector<double>& x) const {
    const auto square = basis_.model(model(x));
    Eigen::VectorXd r(static_cast<long>(square.size()));
    for (size_t i = 0; i < square.size(); ++i)
      r[static_cast<long>(i)] = weight_[i] * std::log(square[i] / data_.mean_square_dph2[i]);
    return r;
  }

  const CurveData& data_;
  const CurveBasis& basis_;
  std::vector<double> weight_;
};

} // namespace

CurveFit fit_least_squares(const CurveData& data, int n_markov) {
  const std::shared_ptr<const CurveBasis> shared = basis_of(data);
  const CurveBasis& basis = *shared;
  const LeastSquares squares(data, basis);
  const BoundSearch search(data, basis);
  CurveFit best;
  std::vector<double> log_tau, objectives, means;
  double before = std::numeric_limits<double>::infinity();
  const int first = n_markov < 0 ? 1 : std::min(n_markov, 2), last = n_markov < 0 ? 3 : n_markov;
  for (int n = n_markov == 0 ? 0 : std::max(1, first); n <= last; ++n) {
    // The tightest bound with as many terms is the start; spread starts guard against its touching points.
    std::vector<std::vector<double>> starts;
    if (n > 0) log_tau = search.best(static_cast<size_t>(n), log_tau);
    const ErrorModel bound = search.finished(log_tau).model;
    const auto as_vector = [&](double spread) {
      const double white = white_sigma_dph(bound.arw_deg_rt_h, data.op.dt_s);
      std::vector<double> x = {std::log(std::max(1e-12, white * white * 0.9))};
      for (int k = 0; k < n; ++k) {
        const bool has = static_cast<size_t>(k) < bound.markov.size();
        const Markov m = has ? bound.markov[static_cast<size_t>(k)] : Markov{std::max(1.0, white / 10), 30.0 * (k + 1)};
        x.push_back(std::log(0.9 * m.sigma_dph * m.sigma_dph));
        x.push_back(std::log(m.tau_s) + (k + 1 == n ? spread : -0.3 * spread));
      }
      return x;
    };
    for (double spread : {0.0, 0.8, -0.8}) starts.push_back(as_vector(spread));
    double least = std::numeric_limits<double>::infinity();
    std::vector<double> winner;
    for (auto& x : starts) {
      const double cost = squares.run(&x);
      if (cost < least) least = cost, winner = x;
    }
    CurveFit fit;
    fit.model = squares.model(winner);
    fit.objective = least;
    fit.excess = excess_of(data, basis.model(fit.model));
    fit.bounded = fit.excess.worst_ratio >= 1 - 1e-9;
    objectives.resize(static_cast<size_t>(n), std::numeric_limits<double>::quiet_NaN());
    means.resize(static_cast<size_t>(n), std::numeric_limits<double>::quiet_NaN());
    objectives.push_back(least);
    means.push_back(fit.excess.mean);
    // Two more parameters must earn the 95 % point of chi-squared with two degrees of freedom (of the weighted sum, times
    // the effective number of independent tau: about two per octave).
    const double points =
        2 * std::max(1.0, std::log2(static_cast<double>(data.n.back()) / static_cast<double>(data.n.front())) + 1);
    const bool earned = !std::isfinite(before) || points * (before - least) > 5.99;
    if (n_markov >= 0 || earned) best = fit, before = least;
    if (n_markov < 0 && !earned) break;
  }
  best.objective_by_terms = objectives;
  best.mean_excess_by_terms = means;
  return best;
}

std::vector<Information> curve_information(const CurveData& data, const ErrorModel& model) {
  const std::shared_ptr<const CurveBasis> shared = basis_of(data);
  const CurveBasis& basis = *shared;
  struct Parameter {
    std::string name;
    double* value;
  };
  ErrorModel moved = model;
  std::vector<Parameter> parameters;
  if (model.arw_deg_rt_h > 0) parameters.push_back({"arw_deg_rt_h", &moved.arw_deg_rt_h});
  for (size_t k = 0; k < moved.markov.size(); ++k) {
    parameters.push_back({"markov[" + std::to_string(k) + "].sigma_dph", &moved.markov[k].sigma_dph});
    parameters.push_back({"markov[" + std::to_string(k) + "].tau_s", &moved.markov[k].tau_s});
  }
  const auto centre = basis.model(model);
  std::vector<Information> out;
  for (const Parameter& p : parameters) {
    const double value = *p.value, step = 1e-4;
    *p.value = value * std::exp(step);
    const auto changed = basis.model(moved);
    *p.value = value;
    std::vector<double> z;
    for (size_t i = 0; i < centre.size(); ++i)
      z.push_back(0.5 * std::fabs(std::log(changed[i] / centre[i])) / step * std::sqrt(2 * data.dof[i]));
    Information info;
    info.parameter = p.name;
    info.largest = *std::max_element(z.begin(), z.end());
    for (size_t i = 0; i < z.size(); ++i) {
      if (z[i] < 0.5 * info.largest) continue;
      const double tau_s = static_cast<double>(data.n[i]) * data.op.dt_s;
      if (info.tau_lo_s == 0) info.tau_lo_s = tau_s;
      info.tau_hi_s = tau_s;
    }
    out.push_back(info);
  }
  return out;
}

} // namespace imucal
