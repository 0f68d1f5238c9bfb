// SPDX-License-Identifier: MIT
#include "analysis/diagnose/judge/coefficients.h"

#include <algorithm>
#include <cmath>

#include "analysis/diagnose/evidence/maximise.h"
#include "analysis/diagnose/judge/bounded_start.h"
#include "analysis/diagnose/judge/start_sizes.h"
#include "analysis/diagnose/stages/mean_lines.h"
#include "analysis/diagnose/stages/sloped_noise.h"

namespace imucal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kLeastStep = 0.015, kLongerStep = 1.25, kFurthestTimes = 3; // of the search for other tops

// The shape of one name under the curvature of the marginal likelihood, the rest of the answer as found.
class NamedShape {
public:
  NamedShape(const SlowAnswer& slow, size_t name, const StartSizes& sizes)
      : slow_(slow), name_(name), sizes_(sizes),
        e_(*slow.candidate(slow.found.best.names[name].candidate).scan.estimator),
        shape_(slow.found.best.names[name].shape), lo_(e_.shape_lo()), hi_(e_.shape_hi()) {
    if (e_.is_near_thermometer()) lo_.push_back(-EffectEstimator::kNearby_s), hi_.push_back(EffectEstimator::kNearby_s);
  }

  MatrixXd covariance() const {
    MatrixXd out = curvature_covariance([&](const Theta& shape) { return value(shape); }, shape_, lo_, hi_);
    if (!e_.has_many_tops()) return out;
    const double spread = spread_about_found(std::sqrt(out(0, 0)));
    if (!(out(0, 0) > spread * spread)) out(0, 0) = spread * spread;
    return out;
  }
  // By how much each coefficient of the name follows each parameter of the shape, of this standard error.
  MatrixXd slopes(const Theta& errors) const {
    const long n = static_cast<long>(e_.n_columns());
    MatrixXd out(n, static_cast<long>(shape_.size()));
    for (size_t i = 0; i < shape_.size(); ++i) {
      const double way = std::min({errors[i], shape_[i] - lo_[i], hi_[i] - shape_[i]});
      Theta less = shape_, more = shape_;
      less[i] -= way, more[i] += way;
      out.col(static_cast<long>(i)) = (coefficients(more) - coefficients(less)) / (2 * way);
    }
    return out;
  }

private:
  double value(const Theta& shape) const { return grams(at(shape)).log_marginal(1); }
  // Root mean square of how far the parameter may be from the one found, each place as likely as the logs make it: steps that
  // become longer, from about the error of its curvature on.
  double spread_about_found(double error) const {
    const double least = kLeastStep * shape_[0];
    std::vector<double> places = {0};
    for (double step = std::isfinite(error) ? std::max(least, error) : least, off = step;
         off < std::log(kFurthestTimes) * shape_[0]; step *= kLongerStep, off += step)
      places.push_back(off), places.push_back(-off);
    std::sort(places.begin(), places.end());
    std::vector<double> where, values;
    for (double off : places) {
      const double x = shape_[0] * std::exp(off / shape_[0]);
      if (x > lo_[0] && x < hi_[0]) where.push_back(x - shape_[0]), values.push_back(value({x}));
    }
    const double top = *std::max_element(values.begin(), values.end());
    double sum = 0, squares = 0;
    for (size_t i = 0; i < where.size(); ++i) {
      const size_t before = i > 0 ? i - 1 : 0, after = std::min(i + 1, where.size() - 1);
      const double weight = 0.5 * (where[after] - where[before]) * std::exp(values[i] - top);
      sum += weight, squares += weight * where[i] * where[i];
    }
    return std::sqrt(squares / sum);
  }
  SlowModel at(const Theta& shape) const {
    SlowModel m = slow_.found.best;
    m.names[name_].shape = shape;
    return m;
  }
  RunGrams grams(const SlowModel& m) const { return slow_.search->grams_of(m); }
  VectorXd coefficients(const Theta& shape) const {
    const SlowModel m = at(shape);
    const RunGrams::Posterior at = grams(m).posterior(); // powers first, the names last
    long last = at.common.size();
    for (size_t i = m.names.size(); i-- > name_;) last -= n_common(m.names[i]);
    VectorXd out = at.common.segment(last, n_common(m.names[name_]));
    if (sizes_.runs.size() == at.local.size()) out[0] += start_of_largest(m, at);
    return out;
  }
  // What the start states add in the runs that have the largest size.
  double start_of_largest(const SlowModel& m, const RunGrams::Posterior& at) const {
    long column = at.local.front().size();
    const std::vector<MeanPart> parts = slow_.search->parts_on(*slow_.data, m);
    for (size_t i = m.names.size(); i-- > name_;)
      column -= parts[parts.size() - m.names.size() + i].local_precision.size();
    double sum = 0;
    for (size_t r = 0; r < at.local.size(); ++r) sum += sizes_.runs[r].weight * at.local[r][column];
    return sum;
  }
  long n_common(const SlowModel::Name& name) const {
    const EffectEstimator& e = *slow_.candidate(name.candidate).scan.estimator;
    return e.form() == Form::kColumns ? static_cast<long>(e.n_columns()) : 0;
  }

  const SlowAnswer& slow_;
  const size_t name_;
  const StartSizes& sizes_;
  const EffectEstimator& e_;
  const Theta shape_;
  Theta lo_, hi_;
};

bool has_shape(const SlowAnswer& slow, size_t name, const SelectedEffect& effect) {
  const EffectEstimator& e = *slow.candidate(slow.found.best.names[name].candidate).scan.estimator;
  return &e == effect.term.estimator && e.is_refined(slow.found.best.names[name].shape) && !e.shape_lo().empty();
}

// What errors of the shape add to those of coefficients that follow it so.
void add_errors(const MatrixXd& slopes, const MatrixXd& covariance, std::vector<double>* errors) {
  const VectorXd added = (slopes * covariance * slopes.transpose()).diagonal();
  for (size_t k = 0; k < errors->size() && static_cast<long>(k) < added.size(); ++k)
    (*errors)[k] = std::hypot((*errors)[k], std::sqrt(std::max(0.0, added[static_cast<long>(k)])));
}

} // namespace

void add_errors_of_shapes(const SlowAnswer& slow, std::vector<SelectedEffect>* effects) {
  for (SelectedEffect& effect : *effects) {
    tell_largest(&effect);
    for (size_t i = 0; i < slow.found.best.names.size(); ++i) {
      if (!has_shape(slow, i, effect)) continue;
      const NamedShape shape(slow, i, effect.start_sizes);
      const MatrixXd covariance = shape.covariance();
      effect.term.shape_errors = roots_of_diagonal(covariance);
      std::vector<double>& errors = effect.term.coefficient_errors;
      if (effect.term.form() != Form::kColumns || effect.term.estimator->can_jump())
        continue; // a jump is as high wherever it is
      if (covariance.allFinite())
        add_errors(shape.slopes(effect.term.shape_errors), covariance, &errors);
      else
        std::fill(errors.begin(), errors.end(), kUnknown);
      if (effect.term.estimator->is_start_bounded()) tell_bounded(slow, i, &effect);
    }
  }
}

void add_errors_of_noise(const AxisQuestion& question, const Found& found, std::vector<SelectedEffect>* effects) {
  const SlowModel& best = found.slow.found.best;
  if (!is_noise_sloped(best)) return;
  for (SelectedEffect& effect : *effects) {
    if (effect.term.effect != best.noise_effect || effect.is_family) continue;
    FastFinding slope;
    slope.effect = best.noise_effect, slope.theta = effect.term.shape, slope.base = found.seconds.own_base;
    if (const FastFinding* fast = found.fast.best(question.constants))
      slope.other = fast->effect->estimator(), slope.other_theta = fast->theta;
    set_errors(ResidualLikelihood(question.campaign, found.seconds.fit.residual), &slope);
    effect.term.shape_errors = slope.theta_errors;
  }
}

void fill_coefficients(const AxisQuestion& question, const Fit& fit, Found* found,
                       std::vector<SelectedEffect>* effects) {
  Hypothesis& h = found->seconds.final;
  const Design design = make_design(question.campaign, h);
  for (size_t t = 0; t < h.terms.size(); ++t) {
    Term& term = h.terms[t];
    term.coefficients.clear(), term.coefficient_errors.clear();
    term.starts.clear(), term.start_errors.clear(), term.start_covariances.clear();
    const std::vector<long> own = columns_of(design, t);
    const long first = own.empty() ? -1 : own.front();
    for (const long c : own) {
      term.coefficients.push_back(fit.beta[c]);
      term.coefficient_errors.push_back(std::sqrt(fit.beta_covariance(c, c)));
    }
    for (long c = 0; c < fit.beta.size(); ++c)
      if (design.start_of_column[static_cast<size_t>(c)] == static_cast<int>(t)) {
        term.starts.push_back(fit.beta[c]), term.start_errors.push_back(std::sqrt(fit.beta_covariance(c, c)));
        term.start_covariances.push_back(first < 0 ? 0 : fit.beta_covariance(c, first));
      }
    for (SelectedEffect& effect : *effects)
      if (effect.term.estimator == term.estimator && (term.form() != Form::kTone || effect.term.shape == term.shape)) {
        effect.term.coefficients = term.coefficients;
        effect.term.coefficient_errors = term.coefficient_errors;
        effect.term.starts = term.starts, effect.term.start_errors = term.start_errors;
        effect.term.start_covariances = term.start_covariances;
        effect.start_sizes = start_sizes(question.campaign, design, fit, term, t);
        if (term.form() == Form::kTone)
          effect.term.shape_errors = line_errors(question.campaign, design, fit, found->seconds.final.noise(), term, t);
      }
  }
}

} // namespace imucal
